"""What finished runs predict: confidences about the rows of a set or the echoes of a survey.

A run predicts by its exported model alone, `model.onnx`; the trained object is never loaded again.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import (
    Inputs,
    Rows,
    as_input,
    blocks_of,
    is_tensor,
    stack_inputs,
)
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import stats
from echolearn.evaluation.rows import (
    LabelledRows,
    LocalizedSurvey,
    MeasuredRows,
    Predictions,
    Recordings,
)
from echolearn.simulation.scene import noise_kind
from echolearn.storage import known, manifests
from echolearn.training.runs import Run
from echolearn.training.split import LearningProblem, groups_of, split_groups

BLOCK = 1024
"""Rows that a model from elsewhere is given at a time."""


def load_scorer(folder: Path) -> Callable[[Inputs], Array]:
    """Return the confidence function of a finished run, evaluated by onnxruntime on one thread.

    Args:
        folder: folder of the run, or of a bundle.

    Returns:
        Maps raw inputs, (B, K) columns or a tensor (B, ...), to confidences (B,).

    Raises:
        BadValue: the run is not finished, a file of it is missing or damaged, or it was made
            elsewhere and its model is not allowed.
    """
    from echolearn.classifiers.inference import open_onnx

    folder = Path(folder)
    if (folder / manifests.BUNDLE).is_file():
        return _bundled(folder)
    manifest = manifests.verify(folder)
    inputs, digest = manifest["inputs"], manifest["sha256"]
    model = manifests.listed_bytes(folder, manifest, names=["model.onnx"]).get("model.onnx", b"")
    if known.is_known(digest, known.MADE):
        compute = open_onnx(model)
    else:
        compute = _limited(folder, digest, model=model, rank=2 + is_tensor(inputs))

    def confidence(x: Inputs) -> Array:
        """Return the confidences (B,) of inputs (B, ...), block by block."""
        return np.concatenate([compute(block) for block in blocks_of(x, inputs, size=BLOCK)])

    return confidence


def _bundled(folder: Path) -> Callable[[Inputs], Array]:
    """Return the confidence function of a bundle, examined if it was made elsewhere."""
    from echolearn.robot.examination import examined
    from echolearn.robot.model import replay

    examined(folder)
    bundle, compute = replay(folder)
    scored = by_blocks(lambda x: compute(as_input(x, bundle.inputs)))
    return lambda x: scored(np.asarray(x))


def _limited(folder: Path, digest: str, *, model: bytes, rank: int) -> Callable[[Array], Array]:
    """Return the confidence function of a run that was made elsewhere, after its examination.

    Args:
        folder: of the run.
        digest: SHA-256 of its manifest.
        model: content of its file, as the manifest names it.
        rank: number of axes of its inputs.
    """
    from echolearn.robot.examination import examine_run
    from echolearn.robot.model import opened

    examine_run(folder, digest)
    compute = opened(model, name=f"{folder}/model.onnx", rank=rank)
    return by_blocks(compute)


def by_blocks(compute: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return what computes inputs (B, ...) block by block, since models have limited memory."""

    def confidence(x: Array) -> Array:
        """Return the confidences (B,) of inputs (B, ...)."""
        x = np.ascontiguousarray(x, dtype=np.float32)
        blocks = [compute(x[start : start + BLOCK]) for start in range(0, len(x), BLOCK)]
        return np.concatenate([np.empty(0), *blocks])

    return confidence


def predict(run: Run, columns: Any, *, rows: Array | slice = slice(None)) -> Array:
    """Return the belief in a reflector, shape (B,).

    Args:
        run: finished run; its folder has the scorer.
        columns: a set, or a mapping of columns that has the run's inputs.
        rows: those that are asked about; all unless given.
    """
    if isinstance(columns, Dataset) and is_tensor(run.inputs):
        # Tensors stay in the set's shards until a block of them is looked at.
        [name] = run.inputs
        numbers = np.arange(len(columns))[rows]
        x: Inputs = Rows(partial(columns.gather, name), numbers, run.inputs)
    else:
        x = stack_inputs(run.inputs, columns)[rows]
    confidence = load_scorer(run.folder)(x)
    return np.asarray(confidence, dtype=float)


def held_out_rows(run: Run, dataset: Dataset) -> Array:
    """Return the rows of a set that this run's split holds out, shape (B,).

    Of the set that it was trained on, these are the rows that it never saw.
    """
    groups = groups_of(dataset, split=run.metrics["split"])
    return split_groups(groups, share=run.metrics["test_share"], seed=run.seed)[1]


def validation_rows(run: Run, dataset: Dataset) -> tuple[Array, Array]:
    """Return what a run predicts about its validation rows, and their labels, each (B,).

    Args:
        run: finished run.
        dataset: set that it was trained on.
    """
    problem = _problem(run, dataset)
    rows = problem.parts().validation
    return predict(run, dataset, rows=rows), problem.labels()[rows]


def groups_of_validation(run: Run, dataset: Dataset) -> list[int]:
    """Return the groups of a run's validation rows, of the set that it was trained on."""
    problem = _problem(run, dataset)
    return np.unique(problem.groups()[problem.parts().validation]).tolist()


def _problem(run: Run, dataset: Dataset) -> LearningProblem:
    """Return what a run has learned of the set that it was trained on."""
    told = ("target", "seed", "split", "test_share", "validation_share")
    return LearningProblem(dataset, **{key: run.metrics[key] for key in told})


def predict_rows(run: Run, dataset: Dataset, *, held_out: bool = False) -> Predictions:
    """Return what a run predicts about a set.

    Args:
        run: finished run.
        dataset: set; of that which the run was trained on, only the rows that it held out.
        held_out: whether only these rows count of any set: where one of several runs was trained
            on it, all are compared on the same rows, seed by seed.
    """
    rows = np.arange(len(dataset))
    # What a run was trained on says nothing about what it can do.
    if held_out or run.data_digest == dataset.digest:
        rows = held_out_rows(run, dataset)
    return Predictions(run.seed, rows, predict(run, dataset, rows=rows), run.threshold)


def predict_echoes(run: Run, survey: LocalizedSurvey) -> Predictions:
    """Return what a run predicts about every echo of a survey."""
    rows = np.arange(len(survey.points))
    return Predictions(run.seed, rows, predict(run, survey.columns), run.threshold)


def predict_measured(run: Run, measured: MeasuredRows) -> Predictions:
    """Return what a run predicts about every echo of recorded surveys."""
    rows = np.arange(len(measured.labelled.reference))
    return Predictions(run.seed, rows, predict(run, measured.columns), run.threshold)


def label_rows(dataset: Dataset, *, resamples: int, target: str = "reflector") -> LabelledRows:
    """Return what is known of a labelled set by one of its labels, with its bootstrap draws.

    Args:
        dataset: the set.
        resamples: bootstrap draws.
        target: name of the label; the paper's unless given.
    """
    plan = dataset.manifest["plan"]
    sensor = bool(np.isfinite(dataset["snr_db"]).any())
    # Hypotheses were heard as the walks were that they are of.
    noise = noise_kind(plan.get("walks", plan)["scene"], sensor=sensor)
    return LabelledRows(
        Recordings(dataset.name, kind="set", noise=noise, set_role=plan["role"]),
        reference=dataset[target].astype(bool),
        groups=dataset["group"],
        joint_snr_db=dataset.ratio_db,
        weights=stats.cluster_weights(dataset["group"], resamples=resamples),
    )
