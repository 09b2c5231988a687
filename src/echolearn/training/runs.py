"""Finished runs, read back: what was trained, on what, and with which result.

Nothing here loads a model or a learning library: finding forty runs takes milliseconds. What a run
predicts is in `predictions`.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, check, check_list, check_name, check_number, check_text
from echolearn.evaluation.rows import Model
from echolearn.localization.columns import EVERY_COLUMN, EVERY_TENSOR, SEVERAL, STRIPS
from echolearn.robot.schema import ADAPTED
from echolearn.storage import manifests
from echolearn.storage.advice import data_frame
from echolearn.storage.identity import digest
from echolearn.storage.kinds import check_kind
from echolearn.storage.tables import check_plain
from echolearn.training.fields import FIELDS
from echolearn.walls.nouns import GEOMETRY, SOUND

FORMAT = 4
"""Version of the run folder; part of every digest."""


def check_input_names(name: str, value: Any) -> None:
    """Raise `BadValue` unless a value lists columns that are there once, or one tensor."""
    check_list(name, value)
    known = (*EVERY_COLUMN, *SEVERAL, *SOUND, *GEOMETRY)
    columns = all(each in known for each in value[: len(known)])
    once = 0 < len(value) <= len(known) and len({*map(str, value)}) == len(value)
    tensor = len(value) == 1 and value[0] in (*EVERY_TENSOR, STRIPS)
    tensors = ", ".join((*EVERY_TENSOR, STRIPS))
    allowed = f"must be some of {', '.join(known)}, each once, or one of {tensors}"
    check(tensor or (columns and once), name, f"{value!a:.100}", allowed=allowed)


TABLE: dict[str, Any] = {
    "run": check_text,
    "name": check_name,
    "plan": check_name,
    "role": ("baseline", "learned"),
    "method": check_text,
    "data": check_text,
    "inputs": check_input_names,
    "threshold": check_number,
    "model": {"sha256": check_text, "parity": check_number, "trials": check_number},
} | {key: FIELDS[key] for key in ("target", "seed", "split", "test_share", "validation_share")}
"""What is read of a run's `metrics.json`; other keys are for people."""

OPTIONAL: dict[str, Any] = {
    "train_rows": FIELDS["train_rows"],
    "without": check_input_names,
    "variant": check_name,
    "adapted_from": ADAPTED,
}
"""What is read where it is there: how a training differs from the usual one of its name."""


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        folder: where it lies.
        metrics: content of its `metrics.json`.
        settings: by what it is told from others of one name and variant, or nothing.
    """

    folder: Path
    metrics: Mapping[str, Any]
    settings: str = ""

    def __repr__(self) -> str:
        """Say what it is; its metrics would fill pages."""
        return f"<Run {self.identity}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what it is, and its metrics on rows held out."""
        test = self.metrics.get("test", {})
        rows = [f"<tr><td>{escape(key)}</td><td>{test[key]}</td></tr>" for key in test]
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{''.join(rows)}</table>"

    def to_pandas(self) -> Any:
        """Return the metrics of both parts as a `pandas.DataFrame`, a row each."""
        return data_frame()({part: self.metrics[part] for part in ("validation", "test")})

    @property
    def identity(self) -> str:
        """Name that tells this run from all others, that of its folder."""
        return self.folder.name

    @property
    def variant(self) -> str:
        """What a sweep varied for it, as in its name."""
        return str(self.metrics.get("variant", ""))

    @property
    def model(self) -> Model:
        """What it shares with the runs of other seeds."""
        told = ("name", "plan", "role", "method", "split", "target")
        without = " ".join(self.metrics.get("without", ()))
        rows = str(self.metrics.get("train_rows") or "")
        model = Model(*map(self.metrics.__getitem__, told))
        name = "-".join(filter(None, (model.classifier, self.variant, self.settings)))
        return model._replace(classifier=name, train_rows=rows, without=without)

    @property
    def seed(self) -> int:
        """Seed of the split and the classifier."""
        return self.metrics["seed"]

    @property
    def hears_nothing(self) -> bool:
        """Whether it looks at nothing of what was heard: a control among judges of walls."""
        return {*self.inputs} <= {*GEOMETRY}

    @property
    def data_digest(self) -> str:
        """Digest of the set it was trained on."""
        return self.metrics["data"]

    @property
    def learned_from(self) -> Sequence[str]:
        """Digests of all sets that it has learned from, that of what it began from included."""
        earlier = self.metrics.get("adapted_from", {})
        return (self.data_digest, *earlier.get("data", ()))

    @property
    def threshold(self) -> float:
        """Confidence from which an echo is kept, chosen on validation data."""
        return self.metrics["threshold"]

    @property
    def inputs(self) -> Sequence[str]:
        """Columns it looks at, or its one tensor."""
        return tuple(self.metrics["inputs"])


def read_run(folder: Path) -> Run:
    """Return a finished run, every file of it proved.

    Raises:
        BadValue: it is not finished or damaged, another version of echolearn has made it, or its
            metrics are not what a run has.
    """
    allowed = "must be a folder that echolearn train wrote"
    check_kind("run", Path(folder), wanted="run", allowed=allowed)
    run = Run(folder, manifests.verify(folder))
    manifests.check_own_name(folder, run.metrics)
    maker = other_maker(run)
    check(not maker, "run", folder, allowed=f"made by {maker}: train it again")
    check_metrics(run)
    return run


def check_metrics(run: Run) -> None:
    """Raise `BadValue` unless a run's metrics, which a stranger may have written, say what is read.

    Their checksum tells damage alone.
    """
    there = {key: check for key, check in OPTIONAL.items() if key in run.metrics}
    table = TABLE | there
    read = {key: run.metrics[key] for key in table if key in run.metrics}
    try:
        check_plain("", read, table=table)
    except BadValue as error:
        raise BadValue(f"{run.folder}/{manifests.METRICS} {error}") from None


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
            check_metrics(run)
            yield run


def other_maker(run: Run) -> str:
    """Return which version made a run of another format, or nothing if this one reads it."""
    found = run.metrics.get("format")
    if found == FORMAT:
        return ""
    return "echolearn 0.1" if found is None else f"another version of echolearn (format {found})"


def load_runs(runs: Path) -> list[Run]:
    """Return every finished run under `runs/train` whose set is still there, by name.

    Raises:
        BadValue: one is damaged or renamed.
    """
    sets = (runs / "data").glob(f"*/{manifests.MANIFEST}")
    present = {digest(manifests.load_manifest(path.parent)["files"]) for path in sets}
    found = [run for run in finished_runs(runs) if run.data_digest in present]
    # A renamed folder would count as a run of other settings.
    for run in found:
        manifests.verify(run.folder)
        named = run.metrics["run"]
        allowed = f"must be a folder called {named}"
        check(run.identity == named, "run", run.folder, allowed=allowed, hint="was it renamed?")
    return found
