"""What lies on the disk, opened by name or folder: `echolearn.open_set` and its sisters.

"scattered", or "runs/data/scattered-<digest>" --open_set--> Dataset, every byte checked
"""

from pathlib import Path

from echolearn.checks import check
from echolearn.comparison.finding import find_set, find_survey
from echolearn.dataset.labelled_set import Dataset
from echolearn.robot.scorer import Scorer, load
from echolearn.robot.shipped import find_bundle
from echolearn.storage.kinds import elsewhere
from echolearn.survey.reader import read_survey
from echolearn.survey.survey import Survey
from echolearn.training.runs import Run, finished_runs, read_run

RUNS = Path("runs")
"""Folder of everything generated, unless another is named."""


def set_named(name: str | Path, runs: str | Path = RUNS) -> Dataset:
    """Return a labelled set: `open_set("scattered")["snr_db"]` is a column of all rows, (B,).

    Raises:
        BadValue: there is none, or a file of it is missing, cut or changed.
    """
    there = Path(name).is_dir()
    return Dataset(Path(name) if there else find_set(Path(runs), str(name), key="set"))


def run_named(name: str | Path, runs: str | Path = RUNS) -> Run:
    """Return a trained run: `open_run("svm_pair-paper-s0").metrics["test"]["auc"]`.

    Of its name a beginning is enough that no other run has.

    Raises:
        BadValue: there is none, or several, or it is damaged.
    """
    if Path(name).is_dir():
        return read_run(Path(name))
    known = [run.folder for run in finished_runs(Path(runs))]
    found = [each for each in known if each.name.startswith(str(name))]
    if len(found) != 1:
        shown = ", ".join(each.name for each in found or known)
        hint = elsewhere(str(name), wanted="run", runs=Path(runs)) if not found else ""
        allowed = "must be the beginning of one run's name"
        check(False, "run", name, allowed=allowed, hint=hint or f"there are {shown or 'none'}")
    return read_run(found[0])


def survey_named(name: str | Path, runs: str | Path = RUNS) -> Survey:
    """Return a recorded walk: `open_survey("examples/survey/short").observe([0])` reads a pose.

    Raises:
        BadValue: there is none, or what describes it is malformed.
    """
    there = Path(name).is_dir()
    return read_survey(Path(name) if there else find_survey(Path(runs), str(name), key="survey"))


def bundle_named(name: str | Path = "point", runs: str | Path = RUNS) -> Scorer:
    """Return a bundle at work: `open_bundle("point")(inputs)` is the belief in each echo, (B,).

    Raises:
        BadValue: there is none, or it computes something else here than where it was made.
    """
    return load(find_bundle(name, Path(runs)))
