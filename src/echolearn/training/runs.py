"""Finished runs, read back: what they were trained on, what they look at, what they answer about a
test set.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.inputs import COVARIANCE, view_of
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import stats
from echolearn.evaluation.rows import (
    LabelledRows,
    LocalizedSurvey,
    Model,
    Predictions,
    Recordings,
)
from echolearn.simulation.scene import noise_kind
from echolearn.storage import manifests
from echolearn.storage.identity import digest
from echolearn.training.split import split
from echolearn.training.train import FORMAT, load_scorer


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        folder: where it lies.
        metrics: the content of its `metrics.json`.
    """

    folder: Path
    metrics: Mapping[str, Any]

    @property
    def identity(self) -> str:
        """What tells this run from all others."""
        return self.folder.name

    @property
    def classifier(self) -> str:
        """Name of the classifier."""
        return str(self.metrics["name"])

    @property
    def method(self) -> str:
        """Short name of the classifier's class: threshold, svm, trees, network."""
        return str(self.metrics["method"])

    @property
    def role(self) -> str:
        """Return "baseline" for a bare threshold, "learned" for everything else."""
        return str(self.metrics["role"])

    @property
    def plan(self) -> str:
        """Name of the set it was trained on."""
        return str(self.metrics["plan"])

    @property
    def target(self) -> str:
        """Label it learned: "reflector" (the paper's) or "on_map"."""
        return str(self.metrics["target"])

    @property
    def split(self) -> str:
        """What was never divided between training and test: "position", or the leaky "row"."""
        return str(self.metrics["split"])

    @property
    def model(self) -> Model:
        """Return what it shares with the runs of other seeds."""
        return Model(self.classifier, self.plan, self.role, self.method, self.split, self.target)

    @property
    def trained_on(self) -> str:
        """Name of the set, with what is unusual about the training."""
        return self.model.training

    @property
    def seed(self) -> int:
        """Seed of the split and the classifier."""
        return int(self.metrics["seed"])

    @property
    def data_digest(self) -> str:
        """Digest of the set it was trained on."""
        return str(self.metrics["data"])

    @property
    def threshold(self) -> float:
        """Confidence from which an echo is kept, chosen on validation data."""
        return float(self.metrics["threshold"])

    @property
    def inputs(self) -> Sequence[str]:
        """Columns it looks at, or its one tensor."""
        return tuple(self.metrics["inputs"])

    def held_out(self, dataset: Dataset) -> Array:
        """Return the rows of a set that this run's split holds out, shape (B,): of its own set,
        what it never saw.
        """
        groups = (
            dataset["group"] if self.metrics["split"] == "position" else np.arange(len(dataset))
        )
        return split(groups, share=self.metrics["test_share"], seed=self.seed)[1]

    def confidence(self, columns: Mapping[str, Array]) -> Array:
        """Return the belief in a reflector, shape (B,), from named columns (B, ...)."""
        return self.answer(self.inputs_of(columns))

    def inputs_of(self, columns: Mapping[str, Array]) -> Array:
        """Return what the classifier looks at, shape (B, K) or (B, bands, M * M), from named
        columns (B, ...).
        """
        tensor = view_of(self.inputs) == COVARIANCE
        return (
            columns[self.inputs[0]]
            if tensor
            else np.stack([columns[name] for name in self.inputs], axis=1)
        )

    def answer(self, x: Array) -> Array:
        """Return the belief in a reflector, shape (B,), from raw inputs (B, ...)."""
        return np.asarray(load_scorer(self.folder)(x), dtype=float)


def read_run(folder: Path) -> Run:
    """Return a finished run, every file of it proved.

    Raises:
        BadValue: it is not finished or damaged, or another version of echolearn has made it.
    """
    run = Run(folder, manifests.verify(folder))
    maker = other_maker(run)
    check(not maker, "run", folder, allowed=f"made by {maker}: train it again")
    return run


def finished_runs(runs: Path) -> Iterator[Run]:
    """Yield every finished run under `runs/train`, by name; their files are not yet proved.

    What another version of echolearn has made is left out, with one line on stderr.
    """
    for metrics in sorted((runs / "train").glob(f"*/{manifests.METRICS}")):
        run = Run(metrics.parent, manifests.load_manifest(metrics.parent))
        maker = other_maker(run)
        if maker:
            said = f"run={run.folder}: made by {maker}, left out: train it again"
            print(said, file=sys.stderr, flush=True)
        else:
            yield run


def other_maker(run: Run) -> str:
    """Return which version made a run of another format, or nothing if this one reads it."""
    found = run.metrics.get("format")
    if found == FORMAT:
        return ""
    return "echolearn 0.1" if found is None else f"another version of echolearn (format {found})"


def load_runs(runs: Path) -> list[Run]:
    """Return every finished run under `runs/train` whose data are still there, by name.

    A run of another version's format is left out, with one line on stderr.

    Raises:
        BadValue: one is damaged, or two differ in their settings, but not in classifier, set and
            seed.
    """
    present = {
        digest(manifests.load_manifest(path.parent)["files"])
        for path in (runs / "data").glob(f"*/{manifests.MANIFEST}")
    }
    known = [run for run in finished_runs(runs) if run.data_digest in present]
    for run in known:
        manifests.verify(run.folder)
        twins = [other.identity for other in known if _title(other) == _title(run)]
        hint = "remove the outdated, or train with another name="
        check(
            len(twins) == 1,
            "runs",
            ", ".join(twins),
            allowed="one run per classifier, set and seed",
            hint=hint,
        )
        named = run.metrics["run"]
        check(
            run.identity == named,
            "run",
            run.folder,
            allowed=f"a folder called {named}",
            hint="was it renamed?",
        )
    return known


def _title(run: Run) -> tuple[str, str, int]:
    return run.classifier, run.trained_on, run.seed


def label_rows(dataset: Dataset, *, resamples: int) -> LabelledRows:
    """Return what is known of a labelled set by the paper's label, with its bootstrap draws."""
    plan = dataset.manifest["plan"]
    sensor = bool(np.isfinite(dataset["snr_db"]).any())
    return LabelledRows(
        Recordings(
            dataset.name,
            kind="set",
            noise=noise_kind(plan["scene"], sensor=sensor),
            set_role=plan["role"],
        ),
        reference=dataset["reflector"],
        groups=dataset["group"],
        joint_snr_db=dataset.ratio_db,
        weights=stats.cluster_weights(dataset["group"], resamples=resamples),
    )


def predict_rows(run: Run, dataset: Dataset, *, held_out: bool = False) -> Predictions:
    """Return what a run says about a set.

    Args:
        run: a finished run.
        dataset: the set; only the rows that the run held out if it was trained on it.
        held_out: only those rows of any set, so that all models are asked about the same ones,
            seed by seed.
    """
    own = run.data_digest == dataset.digest
    rows = run.held_out(dataset) if own or held_out else np.arange(len(dataset))
    columns = {name: dataset[name][rows] for name in run.inputs}
    return Predictions(run.seed, rows, run.confidence(columns), run.threshold)


def predict_echoes(run: Run, survey: LocalizedSurvey) -> Predictions:
    """Return what a run says about every echo of a survey."""
    rows = np.arange(len(survey.points))
    return Predictions(run.seed, rows, run.confidence(survey.columns), run.threshold)
