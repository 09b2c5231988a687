"""Compare judges of walls on sets of walks, wall by wall: tables, tests, warnings.

    runs, cells --walk_scores--> results.csv, tests.csv --W07, W08--> warnings.csv, table.md

What cannot be left out: a control that hears nothing (`walls_geometry`) and a bare threshold on the
evidence, beside which every learner stands; lines through `joint`'s points; the oracle over the
hypotheses; the same walks with exact poses.
"""

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, check, check_name, check_whole
from echolearn.classifiers.operating_point import read_aim
from echolearn.comparison import report, warnings
from echolearn.comparison.template import template
from echolearn.comparison.walk_cells import Cell, PointJudge, point_judges
from echolearn.comparison.walk_scores import (
    ALL,
    EXACT,
    ORACLE,
    cell_rows,
    judgements,
    tests_of,
    with_exact_poses,
)
from echolearn.comparison.warnings import SIGNIFICANT, Warned
from echolearn.dataset.labelled_set import FORMAT as SET_FORMAT
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.walk_set import WalkSet
from echolearn.evaluation.rows import Row, distinct, pick, to_csv
from echolearn.robot.examination import examine_run
from echolearn.runtime.progress import track
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import digest
from echolearn.storage.manifests import (
    MANIFEST,
    Contents,
    command_entry,
    finish,
    listed_bytes,
    load_manifest,
    set_name,
    verify,
)
from echolearn.storage.marked_page import around, write_between
from echolearn.storage.once import once
from echolearn.training.predictions import groups_of_validation
from echolearn.training.runs import Run
from echolearn.training.variants import EVERY, Wanted, find_runs

FORMAT = 1
"""Version of the tables; part of a comparison's identity."""

TARGET = "is_wall"

CELL = "tested_on room paths snr_db odometry_error"
COLUMNS = f"classifier {CELL} metric value ci_low ci_high n walls"
TEST_COLUMNS = f"classifier against {CELL} metric difference ci_low ci_high p p_holm n test"

SHOWN = ("table.md",)


def compare_walks(
    cells: Sequence[Cell],
    *,
    name: str,
    runs: Path,
    wanted: Wanted = EVERY,
    resamples: int = 1000,
    readme: Path | None = None,
    command: str | None = None,
) -> Path:
    """Evaluate all classifiers of walls and return the comparison's folder; once.

    Args:
        cells: test sets with their hypotheses.
        name: name of the folder under `runs/compare`.
        runs: folder of everything generated.
        wanted: which of the trained runs.
        resamples: bootstrap draws of walks behind intervals.
        readme: a file whose results table, between markers, is replaced.
        command: what makes the comparison again, for its manifest.

    Raises:
        BadValue: no runs, one that cannot be left out is missing, no markers.
    """
    check_name("name", name)
    check_whole("resamples", resamples, low=20, high=100_000)
    check(len(cells) > 0, "walks", "[]", allowed="must name at least one set of walks")
    if readme is not None:
        around(readme, report.RESULTS)
    judges = judges_of(find_runs(Path(runs), wanted)[0])
    known = identity_of(cells, judges) | {"resamples": resamples}
    folder = Path(runs) / "compare" / name

    def make() -> Contents:
        """Evaluate everything, write the comparison, and return what of it is shown."""
        files = evaluate_cells(cells, judges, runs=Path(runs), resamples=resamples)
        clean(folder)
        for file, content in files.items():
            write_atomic(folder / file, content)
        about = {"kind": "comparison", "inputs": known, **command_entry(command)}
        finish(folder, about, files=files)
        return {file: files[file] for file in SHOWN}

    found = once(folder, finished=partial(_finished, folder, known), make=make, doing="makes it")
    table = found[SHOWN[0]].decode()
    sys.stdout.write(f"{table}\n{folder / SHOWN[0]}\n")
    if readme is not None:
        write_between(readme, table, markers=report.RESULTS)
    return folder


def identity_of(cells: Sequence[Cell], judges: Mapping[str, Run]) -> dict[str, Any]:
    """Return what tells this comparison from all others, as plain containers."""
    return {
        "walks": FORMAT,
        "runs": {run.identity: run.metrics["model"]["sha256"] for run in judges.values()},
        "sets": {cell.name: [cell.walks.digest, cell.hypotheses.digest] for cell in cells},
    }


def _finished(folder: Path, inputs: Mapping[str, Any]) -> Contents | None:
    """Return what is shown of a comparison if it is whole and made from these inputs."""
    with suppress(BadValue):
        manifest = verify(folder)
        if manifest.get("inputs") == inputs:
            return listed_bytes(folder, manifest, names=SHOWN)
    return None


def judges_of(found: Sequence[Run]) -> dict[str, Run]:
    """Return the runs that judge walls by the classifiers' names, each with its lowest seed.

    Raises:
        BadValue: they were trained on several sets, or a yardstick is missing.
    """
    judges: dict[str, Run] = {}
    for run in sorted(found, key=lambda each: each.seed):
        if run.metrics["target"] == TARGET:
            judges.setdefault(run.model.classifier, run)
    sets = {run.data_digest for run in judges.values()}
    hint = "train -m plan=walks target=is_wall classifier=walls_threshold,walls_geometry"
    allowed = "must be trained on one set of walks; choose them by runs=<pattern>"
    check(len(sets) == 1, "runs", ", ".join(judges) or "none", allowed=allowed, hint=hint)
    allowed = "must have walls_geometry, which hears nothing, and a threshold on the evidence"
    both = bool(control_of(judges)) and any(r.model.role == "baseline" for r in judges.values())
    check(both, "runs", ", ".join(judges), allowed=allowed, hint=hint)
    return judges


def control_of(judges: Mapping[str, Run]) -> str:
    """Return the name of the run that is told everything but the sound, or nothing."""
    return next((name for name, run in judges.items() if run.hears_nothing), "")


def best_learner(judges: Mapping[str, Run]) -> str:
    """Return the name of the best learner by its own validation walks."""
    learned = {
        name: run.metrics["validation"]["auc"]
        for name, run in judges.items()
        if run.model.role == "learned" and name != control_of(judges)
    }
    check(len(learned) > 0, "runs", ", ".join(judges), allowed="must hold one that learns")
    return max(learned, key=learned.__getitem__)


def evaluate_cells(
    cells: Sequence[Cell], judges: Mapping[str, Run], *, runs: Path, resamples: int
) -> dict[str, bytes]:
    """Return the files of a comparison by name.

    Args:
        cells: test sets with their hypotheses.
        judges: runs by the classifiers' names.
        runs: folder of everything generated.
        resamples: bootstrap draws.
    """
    for run in judges.values():
        examine_run(run.folder, run.metrics["sha256"])
    control, best = control_of(judges), best_learner(judges)
    points = _point_judges(next(iter(judges.values())), runs)
    waiting = track(cells, "evaluate", unit="sets of walks")
    found = [judgements(cell, runs=judges, points=points) for cell in waiting]
    found = with_exact_poses(cells, found, best=best)
    rows = [
        row
        for c, said in zip(cells, found, strict=True)
        for row in cell_rows(c, said, resamples=resamples)
    ]
    learned = [name for name, run in judges.items() if run.model.role == "learned"]
    rivals = [(name, control) for name in learned if name != control]
    rivals += [(best, name) for name in (*judges, *points) if name not in (best, control)]
    tests = tests_of(cells, found, rivals=rivals, resamples=resamples)
    warned = [*no_better(tests, control), *without_exact(rows)]
    warnings.tell(warned)
    page = template("walks.md").render(
        **tables(rows, tests), best=best, control=control, judges=judges, warned=warned
    )
    return {
        "results.csv": to_csv(rows, COLUMNS.split()),
        "tests.csv": to_csv(tests, TEST_COLUMNS.split()),
        "warnings.csv": to_csv([each._asdict() for each in warned], warnings.COLUMNS),
        "table.md": page.encode(),
    }


def _point_judges(run: Run, runs: Path) -> Mapping[str, PointJudge]:
    """Return Hough and RANSAC, cut on the walks that a run was validated on."""
    for path in sorted(runs.glob(f"data/*/{MANIFEST}")):
        manifest = load_manifest(path.parent)
        if digest(manifest["files"]) == run.data_digest:
            break
    dataset = Dataset(path.parent)
    name = set_name({"format": SET_FORMAT, "plan": dataset.manifest["plan"]["walks"]})
    walks = WalkSet(path.parent.parent / name)
    aim = read_aim(run.metrics["operating_point"]["aim"])
    return point_judges(walks, groups_of_validation(run, dataset), aim=aim)


def no_better(tests: Sequence[Row], control: str) -> list[Warned]:
    """Return W07: learners that do not clearly beat a control that hears nothing.

    Args:
        tests: rows of `tests.csv`.
        control: its name.
    """
    places = distinct(tests, "tested_on")
    where = ALL if ALL in places else places[0]
    found = []
    for row in pick(tests, against=control, metric="auc", tested_on=where):
        if row["p_holm"] > SIGNIFICANT or row["ci_low"] <= 0:
            message = (
                f"AUC {row['difference']:+.3f} from {row['ci_low']:+.3f} to {row['ci_high']:+.3f}"
                f" against {control}: the set gives walls away, or nothing was learned"
            )
            value = float(row["difference"])
            found.append(Warned("W07", row["classifier"], "", where, value, 0.0, message))
    return found


def without_exact(rows: Sequence[Row]) -> list[Warned]:
    """Return W08: sets of walks without the same walks with exact poses beside them."""
    found = []
    for place in distinct(rows, "tested_on"):
        if not pick(rows, tested_on=place, classifier=EXACT):
            message = (
                "no set of the same walks with plan.odometry_error=[0,0] is compared beside it"
            )
            found.append(Warned("W08", EXACT, "", place, 0.0, 0.0, message))
    return found


def tables(rows: Sequence[Row], tests: Sequence[Row]) -> dict[str, Any]:
    """Return the facts of the page: for each room and kind of path its cells and lines."""
    places: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        place = places.setdefault((row["room"], row["paths"]), {"cells": {}, "lines": {}})
        cell = (row["snr_db"], row["odometry_error"])
        place["cells"].setdefault(cell, {"walks": row["n"], "walls": row["walls"]})
        line = place["lines"].setdefault(row["classifier"], {})
        line.setdefault(cell, {})[row["metric"]] = row
    return {
        "places": places,
        "tests": pick(tests, tested_on=ALL) or list(tests),
        "oracle": ORACLE,
        "exact": EXACT,
    }
