"""Compare every trained run on every test set and survey: `results.csv`, `tests.csv`, figures,
`report.html`.

The comparison is identified by what goes into it (runs, sets, surveys, settings); a finished one is
not redone.
"""

import csv
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from echolearn.checks import BadValue, check, check_list, check_name, check_whole
from echolearn.comparison import report
from echolearn.comparison.localized import hear
from echolearn.comparison.tables import SHOWN_DB, Comparison, Contestant, chosen_run, snr_of
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import scoring
from echolearn.evaluation.scoring import Answer, Heard, Row, Sheet
from echolearn.localization.localizer import Localizer
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import digest, plain
from echolearn.storage.manifests import MANIFEST, command_entry, finish, verify
from echolearn.storage.marked_page import around
from echolearn.training.runs import Run, answer_map, answer_set, load_runs, sheet_of

COLUMNS = "classifier trained_on tested_on seed snr_db noise metric value ci_low ci_high n".split()
TEST_COLUMNS = "classifier against trained_on tested_on snr_db metric difference ci_low ci_high p p_holm n".split()
YARDSTICK = "threshold_peak"
"""The bare threshold that every classifier is tested against."""


def compare(
    *,
    name: str,
    tested: Sequence[str],
    surveys: Sequence[str],
    localizers: Mapping[str, Localizer],
    runs: Path,
    resamples: int = 1000,
    workers: int = 1,
    readme: Path | None = None,
    command: str | None = None,
) -> Path:
    """Judge all trained runs and write the comparison; a finished one is only shown again.

    Args:
        name: names the folder under `runs/compare`.
        tested: names of labelled sets.
        surveys: names of surveys.
        localizers: by name; each survey is heard by each of them.
        runs: folder of everything generated.
        resamples: bootstrap draws behind every interval.
        workers: processes; the result does not depend on their number.
        readme: a file whose results table, between markers, is replaced; None leaves it.
        command: what makes the comparison again, for its manifest; None says nothing about it.

    Returns:
        The comparison's folder.

    Raises:
        BadValue: a set or survey that is missing or damaged, no trained runs, or several that
            differ in their settings but not in their name, a README without the markers.
    """
    check_name("name", name)
    check_list("tested", tested)
    check_list("surveys", surveys)
    for key, names in {"tested": tested, "surveys": surveys}.items():
        check(
            len({*map(str, names)}) == len(names),
            key,
            ", ".join(map(str, names)),
            allowed="each name once",
        )
    check_whole("resamples", resamples, low=20, high=100_000)
    check_whole("workers", workers, low=1, high=1024)
    if readme is not None:
        around(readme, report.RESULTS)
    folder = Path(runs) / "compare" / name
    trained = load_runs(Path(runs))
    check(
        len(trained) > 0,
        "runs",
        runs,
        allowed="a folder with trained runs",
        hint="run `echolearn train` first",
    )
    check(len(tested) > 0, "tested", "[]", allowed="at least one set")
    check(
        not surveys or len(localizers) > 0,
        "localizers",
        "{}",
        allowed="at least one to hear the surveys",
    )
    sets = {set_name: Dataset(find_set(Path(runs), set_name)) for set_name in tested}
    walks = {survey: find_survey(Path(runs), survey) for survey in surveys}
    inputs = {
        "runs": {run.identity: run.metrics["model"]["sha256"] for run in trained},
        "sets": {key: value.digest for key, value in sets.items()},
        "surveys": {key: digest(verify(value)["files"]) for key, value in walks.items()},
        "localizers": plain(dict(localizers)),
        "resamples": resamples,
        "report": report.FORMAT,
    }
    if not _is_finished(folder, inputs):
        contest = hold(trained, sets, walks, localizers, resamples=resamples, workers=workers)
        about = {"kind": "comparison", "inputs": inputs, "chosen": chosen_run(contest).identity}
        _write(folder, contest, about=about | command_entry(command))
    report.show(folder, readme=readme)
    return folder


def _is_finished(folder: Path, inputs: Mapping[str, Any]) -> bool:
    try:
        return bool(verify(folder).get("inputs") == inputs)
    except BadValue:
        return False


def _write(folder: Path, contest: Comparison, *, about: Mapping[str, Any]) -> None:
    clean(folder)
    files = {
        "results.csv": to_csv(contest.rows, COLUMNS),
        "tests.csv": to_csv(contest.tests, TEST_COLUMNS),
    }
    files |= report.make(contest, name=folder.name)
    for file, content in files.items():
        write_atomic(folder / file, content)
    finish(folder, about, files)


def find_set(runs: Path, name: str) -> Path:
    """Return the folder of the one finished set called `name`.

    Raises:
        BadValue: none, or several that differ in their settings.
    """
    manifests = (runs / "data").glob(f"{name}-*/{MANIFEST}")
    found = sorted(
        path.parent for path in manifests if "-" not in path.parent.name.removeprefix(f"{name}-")
    )
    outdated = "remove the outdated: " + ", ".join(map(str, found))
    hint = outdated if found else f"run `echolearn generate plan={name}`"
    check(
        len(found) == 1, "tested", name, allowed="the name of exactly one finished set", hint=hint
    )
    return found[0]


def find_survey(runs: Path, name: str) -> Path:
    """Return the folder of a finished survey.

    Raises:
        BadValue: there is none.
    """
    folder, hint = runs / "survey" / name, "run `echolearn survey` for its room and snr_db"
    check(
        (folder / MANIFEST).is_file(),
        "surveys",
        name,
        allowed="the name of a finished survey",
        hint=hint,
    )
    return folder


def hold(
    trained: Sequence[Run],
    sets: Mapping[str, Dataset],
    walks: Mapping[str, Path],
    localizers: Mapping[str, Localizer],
    *,
    resamples: int,
    workers: int,
) -> Comparison:
    """Judge every run on every set and survey, which are shared out among `workers` processes."""
    contestants: dict[Contestant, list[Run]] = defaultdict(list)
    for run in trained:
        contestants[run.classifier, run.trained_on].append(run)
    pairs = [(walk, name) for walk in walks for name in localizers]
    with processes(workers) as pool:
        jobs = [
            pool.submit(judge_set, contestants, dataset.folder, name, resamples)
            for name, dataset in sets.items()
        ]
        for walk, name in pairs:
            task = Walk(walks[walk], f"{walk}/{name}", localizers[name], tested=name == pairs[0][1])
            jobs.append(pool.submit(judge_walk, contestants, task, resamples))
        done = [job.result() for job in track(jobs, "judge", unit="sets and surveys")]
    rows = [row for verdict in done for row in verdict.rows]
    tests = scoring.correct(row for verdict in done for row in verdict.tests)
    heard = {
        pair: verdict.heard
        for pair, verdict in zip(pairs, done[len(sets) :], strict=True)
        if verdict.heard
    }
    return Comparison(contestants, sets, heard, rows, tests)


class Walk(NamedTuple):
    """A survey to be judged, by which localizer, and whether with paired tests."""

    folder: Path
    name: str
    localizer: Localizer
    tested: bool


class Verdict(NamedTuple):
    """What was found on one set or survey: rows of results.csv and of tests.csv, and what was
    heard.
    """

    rows: list[Row]
    tests: list[Row]
    heard: Heard | None = None


def judge_set(
    contestants: Mapping[Contestant, Sequence[Run]], folder: Path, name: str, resamples: int
) -> Verdict:
    """Judge all contestants on a labelled set; on one that any was trained on, on held-out rows and
    without tests.
    """
    dataset = Dataset(folder)
    sheet = sheet_of(dataset, name, resamples=resamples)
    studied = any(
        run.data_digest == dataset.digest for runs in contestants.values() for run in runs
    )
    answers = {
        who: [answer_set(run, dataset, studied=studied) for run in runs]
        for who, runs in contestants.items()
    }
    rows = [
        row
        for who, given in (answers | _chance(sheet)).items()
        for row in scoring.judge_labels(who, given, sheet)
    ]
    return Verdict(
        rows, [] if studied else list(against_yardstick(answers, sheet, metric="auc", snr_db=""))
    )


def judge_walk(
    contestants: Mapping[Contestant, Sequence[Run]], walk: Walk, resamples: int
) -> Verdict:
    """Judge all contestants by the maps they leave of a survey."""
    heard = hear(walk.folder, walk.localizer, name=walk.name, resamples=resamples)
    snr_db = snr_of(heard)
    answers = {who: [answer_map(run, heard) for run in runs] for who, runs in contestants.items()}
    everyone = (_references(heard) | answers).items()
    rows = [
        row
        for who, given in everyone
        for row in scoring.judge_map(who, given, heard, snr_db=snr_db)
    ]
    tested = walk.tested and snr_db in SHOWN_DB
    paired = (
        against_yardstick(answers, heard.sheet, metric="balanced_accuracy", snr_db=snr_db)
        if tested
        else []
    )
    return Verdict(rows, list(paired), heard)


def _chance(sheet: Sheet) -> dict[Contestant, list[Answer]]:
    return {("chance", "-"): [scoring.yardsticks(sheet.reference)["chance"]]}


def _references(heard: Heard) -> dict[Contestant, list[Answer]]:
    return {
        (name, "-"): [answer] for name, answer in scoring.yardsticks(heard.sheet.reference).items()
    }


def against_yardstick(
    answers: Mapping[Contestant, Sequence[Answer]], sheet: Sheet, *, metric: str, snr_db: str
) -> Iterable[Row]:
    """Test every classifier against the bare threshold of the same set and seeds, leaky splits left
    out.
    """
    for (classifier, trained_on), given in answers.items():
        yardstick = answers.get((YARDSTICK, trained_on), ())
        if (
            classifier != YARDSTICK
            and "split" not in trained_on
            and scoring.paired(given, yardstick)
        ):
            where = {"trained_on": trained_on, "tested_on": sheet.name, "snr_db": snr_db}
            tested = scoring.compare_pair(given, yardstick, sheet, metric=metric)
            yield {"classifier": classifier, "against": YARDSTICK, **where, **tested}


def to_csv(rows: Iterable[Row], columns: Sequence[str]) -> bytes:
    """Return rows as CSV text; floats in shortest form, NaN empty."""
    text = StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _plain(row[key]) for key in columns} for row in rows)
    return text.getvalue().encode()


def _plain(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else repr(round(float(value), 6))
    return value
