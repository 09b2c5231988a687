"""What studies were expected to find, by the paper and by the planning of this project, beside what they found.

What was expected is a range of shares: Wilson's 95 % interval of a figure that was counted in trials, the figure itself
where there is no number of trials, everything beyond a limit, or what the same study found at another value. It agrees
with a share that was found if the range and that share's interval overlap; if the interval leaves out the very figure
that was expected, this is said and explained too.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from echolearn import stats, store
from echolearn.types import BadValue

PLANNED = 40
"""Trials of planning as noted for S-NLS at -10 dB; its other figures have no number and are taken to have as many."""


class Share(NamedTuple):
    """A share, the ends of its range, and how many recordings it is of, None where that is not known."""

    value: float
    low: float
    high: float
    n: int | None = None

    def __str__(self) -> str:
        """Write it in per cent."""
        value, low, high = (f"{100 * x:.3g}" for x in self[:3])
        return value if self.n is None else f"{value} [{low}, {high}], n = {self.n}"


Found = Mapping[tuple[str, str, str], Share]
"""(localizer, metric, value of what was varied) -> share."""


@dataclass(frozen=True)
class Expectation:
    """What a study was expected to find at one value.

    Attributes:
        what: in words.
        study: its name.
        at: localizer, metric, and value of what is varied, as in its table.
        share: that was expected.
        source: who expected it.
        trials: of that share; None is a figure without.
        limit: "<" or ">=" if the share is one.
        beside: value at which the study's own share is the one expected, instead of `share`.
        why: what explains a difference, should there be one.
    """

    what: str
    study: str
    at: tuple[str, str, str]
    share: float = 0.0
    source: str = "planning"
    trials: int | None = PLANNED
    limit: str = ""
    beside: str = ""
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
        overlap = share.low <= wanted.high and wanted.low <= share.high
        if overlap and (self.limit or share.low <= wanted.value <= share.high):
            return "yes"
        return f"{'overlap alone' if overlap else 'no'}. {self.why}".strip()


_CORNERS = (
    "The direction is some wall's nearly always (last table of the study), but often not the wall whose time was "
    "found: here both distances are drawn from one range, so that two walls compete; planning had them at 1.0 and 1.5 m"
)
_DIVISION = (
    "Plain division amplifies noise where the probe has hardly any power, so the figure changes with the probe "
    "(`scene.probe.seed=1`) and rises steeply with the least loading (`localizers.peaks.loading=0.001`), of which "
    "planning has no record; it also counted more times as right, since its chance was 22 %"
)
_WALK = (
    "At such levels the share falls steeply with the distance of the nearest wall, and a second wall within 2 m raises "
    "it; planning's walk kept other distances, of which there is no record"
)
_SPECTRUM = (
    "Of the rotor's spectrum only two numbers are known; spectra that agree in both differ most here "
    "([Diffuse noise and SDNR](paper.md#diffuse-noise-and-sdnr)), and one probe weighs their few lines unlike another"
)
_NEAREST = (
    "The level of the nearest echo decides, and with it the walls' distances and which way microphone 1 faces, which "
    "planning fixed and this study draws"
)


def _snr(
    what: str, localizer: str, at: str, share: float, *, metric: str = "toa", limit: str = "", why: str
) -> Expectation:
    return Expectation(f"{what}, SNR {at} dB", "paper_snr", (localizer, metric, at), share, limit=limit, why=why)


def _sdnr(what: str, localizer: str, at: str, share: float) -> Expectation:
    return Expectation(f"{what}, SDNR {at} dB", "rotor", (localizer, "toa", at), share, why=_SPECTRUM)


def _map(localizer: str, room: str, at: str, share: float, *, pings: str = "", limit: str = "") -> Expectation:
    averaged = f", {pings} pings averaged" if pings else ""
    study = f"attainable_{room}" + (f"_{pings}_pings" if pings else "")
    what = f"attainable map points by {localizer}, {room} m, SNR {at} dB{averaged}"
    return Expectation(what, study, (localizer, "on_map", at), share, limit=limit, why=_WALK)


_DIRECTION = "whole-recording MPDR within 5 degrees of the matched wall"

EXPECTATIONS = (
    Expectation(
        "S-NLS, TOA, SNR -10 dB", "paper_snr", ("snls", "toa", "-10"), 0.80, source="paper", trials=None, why=_NEAREST
    ),
    _snr("S-NLS, TOA", "snls", "-10", 0.825, why=_NEAREST),
    _snr("EM-MC, TOA", "em", "-10", 1.0, why=_NEAREST),
    _snr("EM-MC, TOA", "em", "-15", 0.80, why=_NEAREST),
    _snr("RIR-PP, TOA", "peaks", "-10", 0.30, why=_DIVISION),
    _snr("RIR-PP, TOA", "peaks", "-5", 0.52, why=_DIVISION),
    _snr("RIR-PP, TOA", "peaks", "0", 0.95, why=_DIVISION),
    _snr(_DIRECTION, "snls", "10", 0.95, metric="doa", why=_CORNERS),
    _snr(_DIRECTION, "snls", "-10", 0.15, metric="doa", limit="<", why=_CORNERS),
    _sdnr("S-NLS, TOA", "snls", "-10", 0.93),
    _sdnr("S-NLS, TOA", "snls", "-20", 0.73),
    _sdnr("S-NLS, TOA", "snls", "-30", 0.20),
    _sdnr("S-NLS whitened, TOA", "snls_whitened", "-10", 1.0),
    _sdnr("S-NLS whitened, TOA", "snls_whitened", "-20", 1.0),
    _sdnr("S-NLS whitened, TOA", "snls_whitened", "-30", 0.80),
    Expectation("S-NLS, TOA, T60 1.0 s", "paper_t60", ("snls", "toa", "1.0"), beside="0.3"),
    *(
        _map("joint", room, at, share)
        for room in ("8x6x5", "13x11x5")
        for at, share in (("-10", 0.97), ("-13", 0.60), ("-15", 0.31), ("-17", 0.17))
    ),
    *(
        _map(localizer, room, at, 0.9, pings=pings, limit=">=")
        for room in ("8x6x5", "13x11x5")
        for localizer, at, pings in (
            ("joint", "-10", ""), ("gated", "-5", ""), ("joint", "-20", "10"), ("joint", "-30", "100")
        )
    ),
)  # fmt: skip
"""In the order of the table."""


def table(studies: Path) -> str:
    """Return what was expected beside what was found, as Markdown.

    Args:
        studies: folder of the studies, each under its name; those that are not finished leave their places open.
    """
    found = {name: read(studies / name) for name in {each.study for each in EXPECTATIONS}}
    head = "| share in % | expected | by | found | agrees |\n|---|---|---|---|---|"
    rows = [f"| {' | '.join(each.row(found[each.study]))} |" for each in EXPECTATIONS]
    return "\n".join([head, *rows])


def read(folder: Path) -> Found:
    """Return what a study found; nothing if it is not finished, or damaged."""
    try:
        vary = store.verify(folder)["study"]["vary"]
    except (BadValue, KeyError):
        return {}
    with (folder / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        (row["localizer"], row["metric"], row[vary]): Share(
            float(row["value"]), float(row["ci_low"]), float(row["ci_high"]), int(row["n"])
        )
        for row in rows
    }
