"""What studies were expected to find, beside what they found.

Expectations are a table of a page's own, `expected.csv` in the page's folder, one share a row. What is expected is a
range: Wilson's 95 % interval of a figure that was counted in trials, the figure itself where there is no number of
trials, everything beyond a limit, or what the same study found at another value. A share that was found agrees if it
lies in that range, or the figure expected in its interval. If neither, but the figure lies among the shares of single
positions, that is said: it may have been counted at one. Else the difference is explained.

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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from echolearn import curves, disk, stats, store
from echolearn.types import BadValue


class Share(NamedTuple):
    """A share, the ends of its range, how many recordings it is of (None: not known), the ends of single positions."""

    value: float
    low: float
    high: float
    n: int | None = None
    least: float = 1.0
    most: float = 0.0

    def __str__(self) -> str:
        """Write it in per cent."""
        value, low, high = (f"{100 * x:.3g}" for x in self[:3])
        return value if self.n is None else f"{value} [{low}, {high}], n = {self.n}"


Found = Mapping[tuple[str, str, str], Share]
"""(localizer, metric, value of what was varied) -> share."""


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

    def wanted(self, found: Found) -> tuple[str, Share]:
        """Return the range that was expected, in words and as a share.

        Raises:
            KeyError: the study has no such value.
        """
        if self.beside:
            there = found[(*self.at[:2], self.beside)]
            return f"as at {self.beside}: {there}", there
        if self.limit:
            ends = (0.0, self.share) if self.limit == "<" else (self.share, 1.0)
            return f"{self.limit} {100 * self.share:.3g}", Share(self.share, *ends)
        if self.trials is None:
            return f"about {100 * self.share:.3g}", Share(self.share, self.share, self.share)
        counted = stats.wilson(round(self.share * self.trials), self.trials)
        share = Share(self.share, counted.low, counted.high, self.trials)
        return str(share), share

    def row(self, found: Found) -> list[str]:
        """Return what was expected, who expected it, what was found, and whether they agree or else why not."""
        try:
            words, wanted = self.wanted(found)
            share = found[self.at]
        except KeyError:
            return [self.what, "", self.source, "not yet: `make studies`", ""]
        return [self.what, words, self.source, str(share), self.verdict(wanted, share)]

    def verdict(self, wanted: Share, share: Share) -> str:
        """Return whether a share agrees with what was expected, or else why not."""
        if wanted.low <= share.value <= wanted.high:
            return "yes"
        if not self.limit and share.low <= wanted.value <= share.high:
            return "yes"
        if not self.limit and share.least <= wanted.value <= share.most:
            return f"with single positions, {100 * share.least:.3g} to {100 * share.most:.3g}. {self.why}".strip()
        return f"no. {self.why}".strip()


def read(path: Path) -> list[Expectation]:
    """Read `expected.csv`.

    Raises:
        BadValue: a file that cannot be read, or a row that lacks a column or has no number where there must be one.
    """
    try:
        with path.open(newline="") as file:
            return [_expectation(row) for row in csv.DictReader(file)]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise BadValue(f"{path}: cannot be read ({disk.one_line(error)})") from None


def _expectation(row: Mapping[str, str]) -> Expectation:
    words = {name: row[name] for name in ("what", "study", "limit", "beside", "source", "why")}
    at, trials = (row["localizer"], row["metric"], row["at"]), row["trials"]
    return Expectation(at=at, share=float(row["share"] or "nan"), trials=int(trials) if trials else None, **words)


def table(expectations: list[Expectation], studies: Path) -> str:
    """Return what was expected beside what was found, as Markdown.

    Args:
        expectations: in the order of the table.
        studies: folder of the studies, each under its name; those that are not finished leave their places open.
    """
    found = {name: shares(studies / name) for name in {each.study for each in expectations}}
    head = "| share in % | expected | by | found | agrees |\n|---|---|---|---|---|"
    rows = [f"| {' | '.join(each.row(found[each.study]))} |" for each in expectations]
    return "\n".join([head, *rows])


def shares(folder: Path) -> Found:
    """Return what a study found; nothing if it is not finished, damaged, or of an older version."""
    try:
        about = store.verify(folder)
    except BadValue:
        return {}
    if about.get("format") != curves.FORMAT:
        return {}
    vary = about["study"]["vary"]
    with (folder / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {(row["localizer"], row["metric"], row[vary]): _share(row) for row in rows}


def _share(row: Mapping[str, str]) -> Share:
    value, low, high, least, most = (float(row[key]) for key in ("value", "ci_low", "ci_high", "least", "most"))
    return Share(value, low, high, int(row["n"]), least, most)
