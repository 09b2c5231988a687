"""What a bundle of a run holds: its model, what the model expects, and how well it did.

The model is the run's `model.onnx`, byte for byte: training has proved there, input by input, that
the file computes what the trained object computes. The golden inputs are held-out rows from the
least to the most believed one, and three that no recording gives. A set's manifest holds arrays as
hashes only, so microphones and probe come from the configuration of the scene, and must be those
the set was made with.
"""

import platform
from collections.abc import Callable, Mapping
from csv import DictReader
from importlib.metadata import version
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

import echolearn
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import check
from echolearn.classifiers.inputs import as_input, is_tensor, stack_inputs, view_of
from echolearn.classifiers.operating_point import BALANCED
from echolearn.dataset.labelled_set import RECORDED, Dataset
from echolearn.evaluation import metrics, scoring
from echolearn.evaluation.calibration_rows import score_calibration
from echolearn.localization.columns import COVARIANCE_BANDS, STRIPS, UNITS, tensor_shape
from echolearn.robot import bundle, schema
from echolearn.storage.identity import KIND, plain
from echolearn.survey import audio
from echolearn.training.predictions import held_out_rows, label_rows, load_scorer, predict_rows
from echolearn.training.runs import Run

LIBRARIES = ("numpy", "scipy", "onnxruntime", "torch", "scikit-learn")
"""Libraries whose versions a bundle tells."""

OF_WALKS = {KIND: "joint"}
"""Localizer of single poses whose responses a walk sums (`walls.walk`)."""

MAPS = ("precision", "true_retention", "spurious_removal")
"""Metrics of maps that a bundle tells."""


def bundle_description(
    run: Run, dataset: Dataset, *, array: MicArray, probe: Probe, resamples: int
) -> dict[str, Any]:
    """Return the content of `bundle.json` but for names and checksums.

    Args:
        run: finished run.
        dataset: set that it was trained on.
        array: microphones that the set was made with.
        probe: burst that the set was made with.
        resamples: bootstrap draws behind intervals.
    """
    model = run.metrics["model"]
    target = run.model.target
    versions = {"echolearn": echolearn.__version__, "python": platform.python_version()}
    versions |= {library: version(library) for library in LIBRARIES}
    about = {
        "kind": "bundle",
        "schema": schema.SCHEMA,
        "classifier": run.model.classifier,
        "run": run.identity,
        "seed": run.seed,
        "trained_on": run.model.training,
        "data": {"plan": dataset.name, "digest": dataset.digest, "rows": len(dataset)},
        "view": view_of(run.inputs),
        "columns": [{"name": name, "unit": UNITS.get(name, "1")} for name in run.inputs],
        "bands": COVARIANCE_BANDS,
        "input_shape": _input_shape(run, dataset, microphones=len(array)),
        "label": {"name": target, "true": (schema.LABELS | schema.WALL_LABELS)[target]},
        "threshold": {"value": run.threshold, "chosen": rule_of(run)},
        "calibration": run.metrics["calibration"],
        "parity": {"difference": model["parity"], "trials": model["trials"]},
        "golden": schema.GOLDEN,
        "metrics": {"held_out": held_out_figures(run, dataset, resamples=resamples)},
        "versions": versions,
    } | {key: run.metrics[key] for key in ("adapted_from",) if key in run.metrics}
    plan = dataset.manifest["plan"]
    if target in schema.WALL_LABELS:
        about |= {"schema": schema.OF_WALLS, "hypotheses": {"count": plan["count"]}}
        plan = plan["walks"] | {"localizer": OF_WALKS | {"window": plan["walks"]["window"]}}
    return about | recording_description(plan, array=array, probe=probe)


def _input_shape(run: Run, dataset: Dataset, *, microphones: int) -> list[int]:
    """Return the shape of one input of a run's model.

    Args:
        run: finished run.
        dataset: set that it was trained on.
        microphones: their number.
    """
    if not is_tensor(run.inputs):
        return [len(run.inputs)]
    if view_of(run.inputs) == STRIPS:
        return list(dataset.gather(STRIPS, np.arange(1)).shape[1:])
    return [*tensor_shape(run.inputs[0], microphones)]


def rule_of(run: Run) -> str:
    """Return how the threshold of a run was chosen; runs of before know balanced cuts alone."""
    rows = run.metrics["rows"]["validation"]
    point = run.metrics.get("operating_point", {"aim": BALANCED})
    rule = f"largest balanced accuracy on {rows} validation rows"
    if point["aim"] != BALANCED:
        shares = f"precision {point['precision']:.3g}, retention {point['retention']:.3g}"
        rule = f"{point['aim']} on {rows} validation rows: {shares}"
    elif point.get("missed"):
        rule += f", as {point['missed']}"
    return f"{rule}; kept if confidence >= value"


def recording_description(
    plan: Mapping[str, Any], *, array: MicArray, probe: Probe
) -> dict[str, Any]:
    """Return what a robot needs to record and localize as the set's plan does.

    Args:
        plan: plan in the set's manifest, which holds arrays as hashes.
        array: microphones that the set was made with.
        probe: burst that the set was made with.

    Raises:
        BadValue: another array or probe than the set's, or a localizer that cannot travel.
    """
    scene = plan["scene"]
    # The manifest holds arrays as hashes, so the values come from the command and are compared.
    hint = "give the scene.* overrides that the set was generated with"
    if plan.get("kind") == RECORDED:
        hint = "give its survey: scene=survey scene.folder=<folder>"
    for name, given in (("array", array), ("probe", probe)):
        allowed = f"must be the {name} of the run's set"
        same = plain(given) == scene[name]
        check(same, f"scene.{name}", "another", allowed=allowed, hint=hint)
    return {
        "sample_rate": float(probe.sample_rate),
        "speed_of_sound": float(scene["speed_of_sound"]),
        "array": array.positions.tolist(),
        "probe": {"file": "probe.wav", "burst": len(probe.samples), "length": probe.length},
        "window": {key: value for key, value in plan["window"].items() if key != KIND},
        "localizer": localizer_description(plan["localizer"], window=plan["window"]),
    }


def localizer_description(about: Mapping[str, Any], *, window: Any) -> dict[str, Any]:
    """Return a set's localizer as a bundle names it: without its window, which stands beside it."""
    name = str(about[KIND])
    arguments = {key: value for key, value in about.items() if key not in (KIND, "window")}
    known = bundle.localizer_names()
    allowed = f"must be one that travels: {', '.join(known)}"
    check(name in known, "localizer", name, allowed=allowed)
    for key, value in arguments.items():
        schema.check_argument(f"localizer.{key}", value)
    same = about["window"] == window
    check(same, "localizer.window", about["window"], allowed="must be the plan's window")
    return {"name": name, "arguments": arguments}


def held_out_figures(run: Run, dataset: Dataset, *, resamples: int) -> dict[str, Any]:
    """Return every metric of labels on held-out rows, with 95 % intervals over positions.

    They are judged by the label that the run has learned.

    Args:
        run: finished run.
        dataset: set that it was trained on.
        resamples: bootstrap draws.
    """
    predicted = predict_rows(run, dataset)
    labelled = label_rows(dataset, resamples=resamples, target=run.model.target)
    figures = {}
    about: Any = {"predictions": [predicted], "labelled": labelled}
    judged = scoring.score_labels(run.model, **about), score_calibration(run.model, **about)
    for row in chain(*judged):
        # Rows of one band of SNR are of no use to a robot, which does not know its SNR.
        if not row["snr_db"] and not row["metric"].startswith("own_"):
            figures[row["metric"]] = _figure(row)
    return {"set": dataset.name, "rows": len(predicted.rows), "figures": figures}


def map_figures(comparison: Path, run: Run) -> list[dict[str, Any]]:
    """Return what a comparison says of the maps that a classifier leaves, mean over its seeds."""
    # Rows without a seed are means over seeds; only surveys leave maps.
    wanted = {**run.model._asdict(), "seed": "", "kind": "survey"}
    found = []
    with (comparison / "results.csv").open(newline="") as file:
        for row in DictReader(file):
            # Comparisons of before have no columns for what was usual then.
            same = all(row.get(key, "") == value for key, value in wanted.items())
            if row["metric"] in MAPS and same:
                where = f"{row['tested_on']}/{row['localizer']}"
                found.append({"tested_on": where, "metric": row["metric"], **_figure(row)})
    return found


def _figure(row: Mapping[str, Any]) -> dict[str, float | None]:
    """Return value and interval of a row of `results.csv`."""
    return {key: metrics.finite(row[key]) for key in schema.FIGURE}


def bundle_files(run: Run, dataset: Dataset, *, probe: Probe) -> dict[str, bytes]:
    """Return the files of a bundle besides `bundle.json`, by name.

    Args:
        run: finished run.
        dataset: set that it was trained on.
        probe: burst, which is padded to its recording's length.
    """
    score = load_scorer(run.folder)
    rows = held_out_rows(run, dataset)
    x = as_input(stack_inputs(run.inputs, dataset)[rows], run.inputs)
    x = golden_inputs(x, score=score)
    buffer = BytesIO()
    np.savez(buffer, x=x, confidence=np.asarray(score(x), dtype=float))
    padded = np.pad(probe.samples, (0, probe.length - len(probe.samples)))
    return {
        "model.onnx": (run.folder / "model.onnx").read_bytes(),
        "golden.npz": buffer.getvalue(),
        "probe.wav": audio.wav_bytes(padded, probe.sample_rate),
    }


def golden_inputs(x: Array, *, score: Callable[[Array], Array]) -> Array:
    """Return inputs, float32, shape (32, ...), whose confidences a robot must reproduce.

    They are rows of `x` (B, ...) by growing confidence, zeros, and the largest floats.
    """
    # Rows over the whole range of confidences: a model that is wrong anywhere is found out.
    ranked = np.argsort(score(x), kind="stable")
    spread = np.linspace(0, len(x) - 1, schema.GOLDEN - 3).round().astype(int)
    largest = np.full(x[:1].shape, np.finfo(np.float32).max)
    return np.concatenate([x[ranked[spread]], 0 * largest, largest, -largest]).astype("<f4")
