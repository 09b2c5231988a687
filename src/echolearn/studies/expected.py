"""What studies were expected to find, beside what they found.

Expectations are a table of a page's own, `expected.csv` in the page's folder, a share a row. A
figure that was counted in trials is held against the share that was found by Fisher's exact test,
with Holm's correction for the number of such rows; it takes recordings as independent, so it finds
differences rather too often. A figure without a number of trials must lie in the interval found; a
limit must be kept by the share itself; a share that is to stay what it is at another value must
have an interval that overlaps the one there.

| column               | meaning                                                                                  |
|----------------------|------------------------------------------------------------------------------------------|
| what                 | it is, in words                                                                           |
| study                | its name                                                                                  |
| localizer, metric, at | as in the study's table; `at` is the value of what is varied                               |
| share                | that is expected, from 0 to 1; nothing beside `beside`                                    |
| trials               | that it was counted in; nothing where that is not known                                   |
| limit                | < or >= if the share is one                                                               |
| beside               | value at which the study's own share is the one expected                                  |
| source               | who expects it                                                                            |
| why                  | what explains a difference                                                                |
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import fisher_exact

from echolearn.checks import BadValue
from echolearn.evaluation import stats
from echolearn.storage import manifests
from echolearn.storage.files import one_line
from echolearn.studies import curves


class Share(NamedTuple):
    """A share, the ends of its interval, and how many recordings it is of."""

    value: float
    low: float
    high: float
    n: int

    def __str__(self) -> str:
        """Write it in per cent."""
        value, low, high = (f"{100 * x:.3g}" for x in self[:3])
        return f"{value} [{low}, {high}], n = {self.n}"


Found = Mapping[tuple[str, str, str], Share]
"""(localizer, metric, value of what was varied) -> share."""

MORE = "unnamed"
"""Column of cells that no name stands above."""

LEVEL = 0.05
"""Below it a corrected p tells two shares apart."""


@dataclass(frozen=True)
class Expectation:
    """What a study is expected to find at one value: a row of `expected.csv`.

    Attributes:
        at: localizer, metric, and value of what is varied, as in the study's table.
        trials: of the share; None where that is not known.
    """

    what: str
    study: str
    at: tuple[str, str, str]
    share: float
    trials: int | None = None
    limit: str = ""
    beside: str = ""
    source: str = ""
    why: str = ""

    def words(self, found: Found) -> str:
        """Return what was expected in words."""
        if self.beside:
            return f"as at {self.beside}: {found[(*self.at[:2], self.beside)]}"
        if self.trials is None:
            return f"{self.limit or 'about'} {100 * self.share:.3g}"
        counted = stats.wilson(round(self.share * self.trials), self.trials)
        return str(Share(self.share, counted.low, counted.high, self.trials))

    def agrees(self, found: Found) -> bool:
        """Tell whether a share without trials agrees with what was found."""
        share = found[self.at]
        if self.beside:
            there = found[(*self.at[:2], self.beside)]
            return share.low <= there.high and there.low <= share.high
        if self.limit:
            return share.value < self.share if self.limit == "<" else share.value >= self.share
        return share.low <= self.share <= share.high

    def p(self, found: Found) -> float:
        """Return Fisher's p of the counts expected and found; NaN for a share without trials."""
        if self.trials is None:
            return math.nan
        pairs = (self.share, self.trials), (found[self.at].value, found[self.at].n)
        counts = [(round(share * trials), trials) for share, trials in pairs]
        return float(fisher_exact([[hits, trials - hits] for hits, trials in counts]).pvalue)


def read(path: Path) -> list[Expectation]:
    """Read `expected.csv`.

    Raises:
        BadValue: a file that cannot be read, or a row that has too few or too many cells, or no
            number where there must be one.
    """
    try:
        with path.open(newline="") as file:
            return [_expectation(row) for row in csv.DictReader(file, restkey=MORE)]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise BadValue(f"{path}: cannot be read ({one_line(error)})") from None


def _expectation(row: Mapping[str, str]) -> Expectation:
    if MORE in row:
        raise ValueError(
            f"{MORE} {row[MORE]}: more cells than columns; a text with a comma needs quotation marks"
        )
    words = {name: row[name] for name in ("what", "study", "limit", "beside", "source", "why")}
    at, trials = (row["localizer"], row["metric"], row["at"]), row["trials"]
    return Expectation(
        at=at, share=float(row["share"] or "nan"), trials=int(trials) if trials else None, **words
    )


def table(expectations: Sequence[Expectation], studies: Path, *, before: str = "") -> str:
    """Return what was expected beside what was found, as Markdown.

    Args:
        expectations: in the order of the table.
        studies: folder of the studies, each under its name.
        before: the table as it stands: rows of studies that are not there, or not finished, are
            kept from it.
    """
    found = {name: shares(studies / name) for name in {each.study for each in expectations}}
    return tabulate(expectations, found, before=before)


def tabulate(
    expectations: Sequence[Expectation], found: Mapping[str, Found], *, before: str = ""
) -> str:
    """Return the table of what studies found, by name; the others as `before` has them."""
    known = [each for each in expectations if each.at in found[each.study]]
    raw = np.array([each.p(found[each.study]) for each in known])
    counted = np.isfinite(raw)
    corrected = np.full(len(raw), np.nan)
    corrected[counted] = stats.holm(raw[counted])
    new = {
        id(each): _row(each, found[each.study], float(p), float(holm))
        for each, p, holm in zip(known, raw, corrected, strict=True)
    }
    rows = [new.get(id(each)) or _kept(each, before) or _open(each) for each in expectations]
    return "\n".join([HEAD, *rows])


HEAD = (
    "| share in % | expected | by | found | p | p, Holm | agrees |\n|---|---|---|---|---|---|---|"
)


def _row(each: Expectation, found: Found, p: float, holm: float) -> str:
    alike = each.agrees(found) if math.isnan(p) else holm >= LEVEL
    verdict = "yes" if alike else "no"
    if alike and p < LEVEL:
        verdict = "not told apart"
    verdict += f". {each.why}" if verdict != "yes" and each.why else ""
    tests = ("", "") if math.isnan(p) else (f"{p:.2g}", f"{holm:.2g}")
    return f"| {' | '.join([each.what, each.words(found), each.source, str(found[each.at]), *tests, verdict])} |"


def _kept(each: Expectation, before: str) -> str | None:
    """Return the row of an expectation in an earlier table; several may be of one thing, so the
    figure counts, too.
    """
    begins = f"| {each.what} | " + (
        f"as at {each.beside}: " if each.beside else f"{each.words({})} | {each.source} |"
    )
    return next((line for line in before.splitlines() if line.startswith(begins)), None)


def _open(each: Expectation) -> str:
    return f"| {each.what} |  | {each.source} | not yet: `make studies` |  |  |  |"


def shares(folder: Path) -> Found:
    """Return what a study found; nothing if it is not finished, damaged, or of an older version."""
    try:
        about = manifests.verify(folder)
    except BadValue:
        return {}
    if about.get("format") != curves.FORMAT:
        return {}
    vary = about["study"]["vary"]
    with (folder / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {(row["localizer"], row["metric"], row[vary]): _share(row) for row in rows}


def _share(row: Mapping[str, str]) -> Share:
    value, low, high = (float(row[key]) for key in ("value", "ci_low", "ci_high"))
    return Share(value, low, high, int(row["n"]))
