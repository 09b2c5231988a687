"""From a trained run to a bundle (`bundle.py` has the format): its model, what it expects, and how
it was judged.

The model is the run's `model.onnx`, byte for byte: training has proved there, input by input, that
the file computes what the trained object computes. The golden inputs are held-out rows from the
least to the most believed one, and three that no recording gives. A set's manifest holds arrays as
hashes only, so microphones and probe come from the configuration of the scene, and must be those
the set was made with.
"""

import platform
from collections.abc import Mapping
from csv import DictReader
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

import echolearn
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import BadValue, check, check_name, check_whole
from echolearn.classifiers.inputs import COVARIANCE, as_input, view_of
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics, stats
from echolearn.localization import features
from echolearn.robot import bundle, schema, scorer
from echolearn.robot.schema import FIGURE
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import KIND, plain
from echolearn.storage.once import locked
from echolearn.survey import audio
from echolearn.training.runs import Run, label_rows, predict_rows, read_run

LIBRARIES = ("numpy", "scipy", "onnxruntime", "torch", "scikit-learn")
"""Those whose versions a bundle tells."""

MAPS = ("precision", "true_retention", "spurious_removal")
"""Metrics of maps that a bundle tells."""

Files = dict[str, bytes]


def export(
    *,
    run: Path | None,
    best: Path | None,
    array: MicArray,
    probe: Probe,
    runs: Path,
    name: str | None = None,
    resamples: int = 1000,
    command: str | None = None,
) -> Path:
    """Write the bundle of a run, and prove that it loads; a finished one is only proved.

    Args:
        run: folder of a finished run, or None.
        best: folder of a comparison, whose chosen classifier is exported, or None; one of the two.
        array: microphones that the run's set was made with.
        probe: burst that it was made with.
        runs: the bundle goes to `runs/bundles`.
        name: of the bundle's folder; that of the run unless given.
        resamples: bootstrap draws behind the intervals of its metrics.
        command: what makes the bundle again; None says nothing about it.

    Returns:
        The bundle's folder.

    Raises:
        BadValue: a run, set or comparison that is missing or damaged, other microphones or another
            probe than the set's, a localizer that cannot travel, or a bundle of that name made from
            another run.
    """
    check(
        (run is None) != (best is None),
        "run",
        run,
        allowed="a run's folder, or best=<a comparison's folder>, not both",
    )
    check_whole("resamples", resamples, low=20, high=100_000)
    source = open_run(run) if run is not None else choose(Path(best or ""))
    check_name("name", name or source.identity)
    folder = Path(runs) / "bundles" / (name or source.identity)
    dataset = find_data(source)
    about = describe(source, dataset, array=array, probe=probe, resamples=resamples)
    about["metrics"]["maps"] = [] if best is None else judged_maps(Path(best), source)
    about |= {"name": folder.name, **manifests.command_entry(command)}
    _check_free(folder, source)
    files = pack(source, dataset, probe)
    with locked(
        folder, waiting=f"export {folder.name}: waiting for another command that writes it"
    ):
        _check_free(folder, source)
        if not _is_finished(folder, about, files):
            clean(folder)
            for file, content in files.items():
                write_atomic(folder / file, content)
            manifests.finish(folder, about, files, last=manifests.BUNDLE)
        _prove(folder)
    return folder


def _prove(folder: Path) -> None:
    """Load a bundle as a robot does; one that this refuses is not finished."""
    try:
        scorer.load(folder)
    except BadValue:
        (folder / manifests.BUNDLE).unlink()
        raise


def open_run(folder: Path) -> Run:
    """Return a finished run, every file of it proved."""
    manifests.check_folder("run", folder, allowed="a folder that echolearn train wrote")
    folder = Path(folder).resolve()
    made_by_train = (folder / manifests.METRICS).is_file()
    check(made_by_train, "run", folder, allowed="a folder that echolearn train wrote")
    return read_run(folder)


def choose(comparison: Path) -> Run:
    """Return the run that a comparison has chosen: that of the best classifier's best seed, by
    validation rows alone.
    """
    allowed = "a folder that echolearn compare wrote"
    hint = "make paper makes runs/compare/paper, or: echolearn compare"
    manifests.check_folder("best", comparison, allowed=allowed, hint=hint)
    folder = comparison.resolve()
    manifest = manifests.verify(folder)
    check(manifest.get("kind") == "comparison", "best", folder, allowed=allowed)
    check(
        "chosen" in manifest,
        "best",
        folder,
        allowed=allowed,
        hint="made by version 0.1: run echolearn compare again",
    )
    found = open_run(folder.parents[1] / "train" / manifest["chosen"])
    same = found.metrics["model"]["sha256"] == manifest["inputs"]["runs"][found.identity]
    allowed, hint = "a comparison of the runs that are there", "run echolearn compare again"
    check(same, "best", folder, allowed=allowed, hint=hint)
    return found


def find_data(run: Run) -> Dataset:
    """Return the set that a run was trained on, from beside the run."""
    place = run.folder.parents[1] / "data"
    for manifest in sorted(place.glob(f"{run.metrics['plan']}-*/{manifests.MANIFEST}")):
        dataset = Dataset(manifest.parent)
        if dataset.digest == run.data_digest:
            return dataset
    plan = run.metrics["plan"]
    raise BadValue(
        f"run={run.folder}: a run whose set is under {place}; make it: echolearn generate plan={plan}"
    )


def describe(
    run: Run, dataset: Dataset, *, array: MicArray, probe: Probe, resamples: int
) -> dict[str, Any]:
    """Return the content of `bundle.json` but for names and checksums."""
    plan, metrics_ = dataset.manifest["plan"], run.metrics
    scene, tensor = plan["scene"], view_of(run.inputs) == COVARIANCE
    _check_scene(scene, array, probe)
    rows = metrics_["rows"]["validation"]
    return {
        "kind": "bundle",
        "schema": schema.SCHEMA,
        "classifier": run.classifier,
        "run": run.identity,
        "seed": run.seed,
        "trained_on": run.trained_on,
        "data": {"plan": dataset.name, "digest": dataset.digest, "rows": len(dataset)},
        "view": view_of(run.inputs),
        "columns": [{"name": name, "unit": features.UNITS.get(name, "1")} for name in run.inputs],
        "bands": features.COVARIANCE_BANDS,
        "input_shape": [features.COVARIANCE_BANDS, len(array) ** 2] if tensor else [len(run.inputs)],
        "label": {"name": metrics_["target"], "true": schema.LABELS[metrics_["target"]]},
        "threshold": {
            "value": run.threshold,
            "chosen": f"largest balanced accuracy on {rows} validation rows; kept if confidence >= value",
        },
        "calibration": metrics_["calibration"],
        "parity": {
            "difference": metrics_["model"]["parity"],
            "trials": metrics_["model"]["trials"],
        },
        "sample_rate": float(probe.sample_rate),
        "speed_of_sound": float(scene["speed_of_sound"]),
        "array": array.positions.tolist(),
        "probe": {"file": "probe.wav", "burst": len(probe.samples), "length": probe.length},
        "window": {key: value for key, value in plan["window"].items() if key != KIND},
        "localizer": _localizer(plan["localizer"], plan["window"]),
        "golden": schema.GOLDEN,
        "metrics": {"held_out": judged_rows(run, dataset, resamples=resamples)},
        "versions": {"echolearn": echolearn.__version__, "python": platform.python_version()}
        | {library: version(library) for library in LIBRARIES},
    }


def _check_scene(scene: Mapping[str, Any], array: MicArray, probe: Probe) -> None:
    """Raise `BadValue` unless the set was made with this array and this probe."""
    for name, given in (("array", array), ("probe", probe)):
        hint = "give the scene.* overrides that the set was generated with"
        check(
            plain(given) == scene[name],
            f"scene.{name}",
            "another",
            allowed=f"the {name} of the run's set",
            hint=hint,
        )


def _localizer(about: Mapping[str, Any], window: Mapping[str, Any]) -> dict[str, Any]:
    """Return a localizer as a bundle names it."""
    arguments = {key: value for key, value in about.items() if key not in (KIND, "window")}
    name = str(about[KIND])
    known = bundle.localizer_names()
    check(name in known, "localizer", name, allowed=f"one that travels: {', '.join(known)}")
    for key, value in arguments.items():
        schema.check_argument(f"localizer.{key}", value)
    check(
        about["window"] == window, "localizer.window", about["window"], allowed="the plan's window"
    )
    return {"name": name, "arguments": arguments}


def judged_rows(run: Run, dataset: Dataset, *, resamples: int) -> dict[str, Any]:
    """Return every metric of labels on the rows that the run held out, with 95 % intervals over
    positions.
    """
    given = predict_rows(run, dataset)
    labelled = label_rows(dataset, resamples=resamples)

    def every(weights: Array | None) -> dict[str, Array]:
        return metrics.evaluate_labels(
            labelled.reference[given.rows],
            given.confidence,
            threshold=given.threshold,
            weights=weights,
        )

    found = stats.intervals(every, labelled.weights[:, given.rows])
    figures = {
        name: {key: _finite(value) for key, value in zip(FIGURE, each, strict=True)}
        for name, each in found.items()
    }
    return {"set": dataset.name, "rows": len(given.rows), "figures": figures}


def judged_maps(comparison: Path, run: Run) -> list[dict[str, Any]]:
    """Return what a comparison says of the maps that this classifier leaves, mean over its seeds."""
    wanted = {**run.model._asdict(), "seed": "", "kind": "survey"}
    found = []
    with (comparison / "results.csv").open(newline="") as file:
        for row in DictReader(file):
            if row["metric"] in MAPS and all(row[key] == value for key, value in wanted.items()):
                where = f"{row['tested_on']}/{row['localizer']}"
                figure = {key: _finite(row[key]) for key in FIGURE}
                found.append({"tested_on": where, "metric": row["metric"], **figure})
    return found


def _finite(value: Any) -> float | None:
    return None if value == "" or not np.isfinite(float(value)) else float(value)


def pack(run: Run, dataset: Dataset, probe: Probe) -> Files:
    """Return the files of a bundle besides `bundle.json`."""
    buffer = BytesIO()
    x = golden(run, dataset)
    np.savez(buffer, x=x, confidence=run.answer(x))
    padded = np.pad(probe.samples, (0, probe.length - len(probe.samples)))
    return {
        "model.onnx": (run.folder / "model.onnx").read_bytes(),
        "golden.npz": buffer.getvalue(),
        "probe.wav": audio.wav_bytes(padded, probe.sample_rate),
    }


def golden(run: Run, dataset: Dataset) -> Array:
    """Return inputs, float32, shape (32, ...): held-out rows by growing confidence, zeros, and the
    largest floats.
    """
    rows = run.held_out(dataset)
    x = as_input(run.inputs_of({name: dataset[name][rows] for name in run.inputs}), run.inputs)
    ranked = np.argsort(run.answer(x), kind="stable")
    some = x[ranked[np.linspace(0, len(x) - 1, schema.GOLDEN - 3).round().astype(int)]]
    largest = np.full(x[:1].shape, np.finfo(np.float32).max)
    return np.concatenate([some, 0 * largest, largest, -largest]).astype("<f4")


def _check_free(folder: Path, run: Run) -> None:
    """Raise `BadValue` if the folder is something else than an older bundle of the same run."""
    if not folder.exists() or not any(folder.iterdir()):
        return
    try:
        other = bundle.read_bundle(folder).about["run"]
    except BadValue:
        other = (
            run.identity
            if {path.name for path in folder.glob("[!.]*")} <= {*schema.LIMITS, manifests.BUNDLE}
            else "?"
        )
    hint = f"{folder} holds {'something else' if other == '?' else f'the bundle of {other}'}"
    check(
        other == run.identity,
        "name",
        folder.name,
        allowed="a new name, or that of this run's bundle",
        hint=hint,
    )


def _is_finished(folder: Path, about: Mapping[str, Any], files: Mapping[str, bytes]) -> bool:
    """Tell whether the folder holds exactly this."""
    try:
        found = manifests.verify(folder)
    except BadValue:
        return False
    same = all((folder / name).read_bytes() == content for name, content in files.items())
    return same and {key: found.get(key) for key in about} == about
