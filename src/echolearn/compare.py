"""Compare every trained run on every test set and survey: `results.csv`, `tests.csv`, figures, `report.html`.

The comparison is identified by what goes into it (runs, sets, surveys, settings); a finished one is not redone.
"""

import csv
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from echolearn import judge, report, store
from echolearn.dataset import Dataset, plain
from echolearn.hearing import hear
from echolearn.judge import Answer, Heard, Row, Sheet
from echolearn.localize import Localizer
from echolearn.progress import track
from echolearn.tables import Comparison, Contestant
from echolearn.trained import Run, answer_map, answer_set, load_runs, sheet_of
from echolearn.types import BadValue, check, check_whole

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
    readme: Path | None = None,
) -> Path:
    """Judge all trained runs and write the comparison; a finished one is only shown again.

    Args:
        name: names the folder under `runs/compare`.
        tested: names of labelled sets.
        surveys: names of surveys.
        localizers: by name; each survey is heard by each of them.
        runs: folder of everything generated.
        resamples: bootstrap draws behind every interval.
        readme: a file whose results table, between markers, is replaced; None leaves it.

    Returns:
        The comparison's folder.

    Raises:
        BadValue: a set or survey that is missing, or no trained runs.
    """
    check_whole("resamples", resamples, low=20, high=100_000)
    folder = Path(runs) / "compare" / name
    trained = load_runs(Path(runs))
    check(len(trained) > 0, "runs", runs, allowed="a folder with trained runs", hint="run `echolearn train` first")
    check(len(tested) > 0, "tested", "[]", allowed="at least one set")
    check(not surveys or len(localizers) > 0, "localizers", "{}", allowed="at least one to hear the surveys")
    sets = {set_name: Dataset(find_set(Path(runs), set_name)) for set_name in tested}
    walks = {survey: Path(runs) / "survey" / survey for survey in surveys}
    inputs = {
        "runs": [run.identity for run in trained],
        "sets": {key: value.digest for key, value in sets.items()},
        "surveys": {key: store.digest(store.verify(value)["files"]) for key, value in walks.items()},
        "localizers": plain(dict(localizers)),
        "resamples": resamples,
        "report": report.FORMAT,
    }
    if not _is_finished(folder, inputs):
        store.clean(folder)
        contest = hold(trained, sets, walks, localizers, resamples=resamples)
        files = {"results.csv": to_csv(contest.rows, COLUMNS), "tests.csv": to_csv(contest.tests, TEST_COLUMNS)}
        files |= report.make(contest, name=name)
        for file, content in files.items():
            store.write_atomic(folder / file, content)
        store.finish(
            folder, {"kind": "comparison", "inputs": inputs, "command": f"echolearn compare name={name}"}, files
        )
    report.show(folder, readme=readme)
    return folder


def _is_finished(folder: Path, inputs: Mapping[str, Any]) -> bool:
    try:
        return bool(store.verify(folder).get("inputs") == inputs)
    except BadValue:
        return False


def find_set(runs: Path, name: str) -> Path:
    """Return the folder of the one finished set called `name`.

    Raises:
        BadValue: none, or several that differ in their settings.
    """
    found = sorted(
        path.parent
        for path in (runs / "data").glob(f"{name}-*/{store.MANIFEST}")
        if _digest_only(path.parent.name, name)
    )
    hint = (
        f"run `echolearn generate plan={name}`" if not found else "remove the outdated: " + ", ".join(map(str, found))
    )
    check(len(found) == 1, "tested", name, allowed="the name of exactly one finished set", hint=hint)
    return found[0]


def _digest_only(folder: str, name: str) -> bool:
    return "-" not in folder.removeprefix(f"{name}-")


def hold(
    trained: Sequence[Run],
    sets: Mapping[str, Dataset],
    walks: Mapping[str, Path],
    localizers: Mapping[str, Localizer],
    *,
    resamples: int,
) -> Comparison:
    """Judge every run on every set and survey."""
    contestants: dict[Contestant, list[Run]] = defaultdict(list)
    for run in trained:
        contestants[run.classifier, run.trained_on].append(run)
    rows: list[Row] = []
    tests: list[Row] = []
    for set_name, dataset in track(list(sets.items()), "judge sets", unit="sets"):
        sheet = sheet_of(dataset, set_name, resamples=resamples)
        answers = {who: [answer_set(run, dataset) for run in them] for who, them in contestants.items()}
        for who, given in (answers | _chance(sheet)).items():
            rows += judge.judge_labels(who, given, sheet)
        tests += against_yardstick(answers, sheet, metric="auc", snr_db="")
    heard = {}
    pairs = [(walk, localizer) for walk in walks for localizer in localizers]
    for walk, localizer in track(pairs, "judge maps", unit="surveys"):
        one = heard[walk, localizer] = hear(
            walks[walk], localizers[localizer], name=f"{walk}/{localizer}", resamples=resamples
        )
        snr_db = f"{float(one.sheet.snr_db[0]):g}"
        answers = {who: [answer_map(run, one) for run in them] for who, them in contestants.items()}
        for who, given in (_references(one) | answers).items():
            rows += judge.judge_map(who, given, one, snr_db=snr_db)
        tests += against_yardstick(answers, one.sheet, metric="balanced_accuracy", snr_db=snr_db)
    return Comparison(contestants, sets, heard, rows, judge.correct(tests))


def _chance(sheet: Sheet) -> dict[Contestant, list[Answer]]:
    return {("chance", "-"): [judge.yardsticks(sheet.reference)["chance"]]}


def _references(heard: Heard) -> dict[Contestant, list[Answer]]:
    return {(name, "-"): [answer] for name, answer in judge.yardsticks(heard.sheet.reference).items()}


def against_yardstick(
    answers: Mapping[Contestant, Sequence[Answer]], sheet: Sheet, *, metric: str, snr_db: str
) -> Iterable[Row]:
    """Test every classifier against the bare threshold trained on the same set."""
    for (classifier, trained_on), given in answers.items():
        yardstick = answers.get((YARDSTICK, trained_on))
        if classifier != YARDSTICK and yardstick:
            where = {"trained_on": trained_on, "tested_on": sheet.name, "snr_db": snr_db}
            tested = judge.compare_pair(given, yardstick, sheet, metric=metric)
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
