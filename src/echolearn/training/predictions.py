"""What finished runs predict: confidences about the rows of a set or the echoes of a survey.

A run predicts by its exported model alone, `model.onnx`; the trained object is never loaded again.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import as_input, stack_inputs
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import stats
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Predictions, Recordings
from echolearn.simulation.scene import noise_kind
from echolearn.storage import manifests
from echolearn.training.runs import Run
from echolearn.training.split import groups_of, split_groups


def load_scorer(folder: Path) -> Callable[[Array], Array]:
    """Return the confidence function of a finished run, evaluated by onnxruntime on one thread.

    Args:
        folder: folder of the run.

    Returns:
        Maps raw inputs, (B, K) columns or (B, bands, M * M), to confidences (B,).

    Raises:
        BadValue: the run is not finished, or a file of it is missing or damaged.
    """
    from echolearn.classifiers.inference import open_onnx

    inputs = manifests.verify(folder)["inputs"]
    compute = open_onnx((Path(folder) / "model.onnx").read_bytes())
    return lambda x: compute(as_input(x, inputs))


def predict(run: Run, columns: Any, rows: Array | slice = slice(None)) -> Array:
    """Return the belief in a reflector, shape (B,), in rows of a mapping's or a set's columns."""
    confidence = load_scorer(run.folder)(stack_inputs(run.inputs, columns)[rows])
    return np.asarray(confidence, dtype=float)


def held_out_rows(run: Run, dataset: Dataset) -> Array:
    """Return the rows of a set that this run's split holds out, shape (B,).

    Of the set that it was trained on, these are the rows that it never saw.
    """
    groups = groups_of(dataset, split=run.metrics["split"])
    return split_groups(groups, share=run.metrics["test_share"], seed=run.seed)[1]


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
    return Predictions(run.seed, rows, predict(run, dataset, rows), run.threshold)


def predict_echoes(run: Run, survey: LocalizedSurvey) -> Predictions:
    """Return what a run predicts about every echo of a survey."""
    rows = np.arange(len(survey.points))
    return Predictions(run.seed, rows, predict(run, survey.columns), run.threshold)


def label_rows(dataset: Dataset, *, resamples: int) -> LabelledRows:
    """Return what is known of a labelled set by the paper's label, with its bootstrap draws."""
    plan = dataset.manifest["plan"]
    sensor = bool(np.isfinite(dataset["snr_db"]).any())
    noise = noise_kind(plan["scene"], sensor=sensor)
    return LabelledRows(
        Recordings(dataset.name, kind="set", noise=noise, set_role=plan["role"]),
        reference=dataset["reflector"],
        groups=dataset["group"],
        joint_snr_db=dataset.ratio_db,
        weights=stats.cluster_weights(dataset["group"], resamples=resamples),
    )
