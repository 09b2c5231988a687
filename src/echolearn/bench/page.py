"""What the benchmarks say, as Markdown: a table each for comparisons, growth, trained runs and
bundles.

Times are medians with quartiles in brackets, ratios are those of laps, also with quartiles.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from math import isnan
from typing import Any

from echolearn.bench.measurement import Measurement
from echolearn.runtime.timing import Spread, exponent, spread

TITLES = {
    "rir": "responses of all microphones",
    "localize": "one observation",
    "steps": "one observation",
    "generate": "`echolearn generate`",
    "robot": "a bundle in a fresh process",
    "start": "a command",
}
"""What a unit of each compared stage is."""

GROWING = {"t60": "with T60 in s", "microphones": "with microphones", "azimuths": "with azimuths"}
"""Parameters over which times grow."""

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def page(found: Sequence[Measurement], machine: Mapping[str, Any], *, brief: bool = False) -> str:
    """Return the tables of everything measured; `brief` leaves single steps and single runs out,
    for a README.
    """
    shown = [m for m in found if not (brief and m.stage == "steps")]
    parts = [
        describe(machine),
        compared(shown),
        grown(found),
        larger(found),
        modelled(found),
        carried(found),
    ]
    return "\n\n".join(part for part in parts if part)


def describe(machine: Mapping[str, Any]) -> str:
    """Return where and how it was measured, in a sentence or two."""
    load = " to ".join(f"{machine[key]:.1f}" for key in ("load_before", "load_after"))
    where = f"{machine['processor']}, {machine['memory_gib']:.0f} GiB, {machine['system']}, load average {load}"
    return (
        f"Median [quartiles] of wall time; {where}. One thread each unless said otherwise, in turns in one run; "
        "ratios are those of neighbouring laps."
    )


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; nothing if it has no lines."""
    rows = [f"| {' | '.join(line)} |" for line in lines]
    return "\n".join([f"| {' | '.join(head)} |", "|" + "---|" * len(head), *rows]) if rows else ""


def compared(found: Sequence[Measurement]) -> str:
    """Return the table of everything that was timed beside peers, a line each; single steps also
    without.
    """
    wall = [m for m in found if m.measure == "wall" and m.stage in TITLES]
    own = {(m.stage, m.parameter, m.value, m.variant): m for m in wall}
    lines = []
    for key, together in groupby(
        wall, lambda m: (m.stage, m.parameter, m.value, m.reference or m.variant)
    ):
        mine, peers = own[key], [beside(m) for m in together if m.reference]
        if peers or mine.stage == "steps":
            what = f"{TITLES[mine.stage]}{condition(mine)}: {mine.variant}"
            lines.append((what, seconds(mine.spread), "; ".join(peers)))
    return table(("what", "takes", "beside it, and how many times as long"), lines)


def beside(peer: Measurement) -> str:
    """Return what a peer takes, and how many times as long as what it is beside."""
    name = peer.variant.removeprefix(f"{peer.reference}, ")
    return (
        f"{name} {seconds(peer.spread, brackets=False)}, {plain(peer.ratio or peer.spread)} times"
    )


def condition(m: Measurement) -> str:
    """Return under which condition something was measured."""
    said = {
        "t60": f", T60 {m.value} s",
        "batch": f" of {m.value} at a time",
        "rows": f", {m.value} rows",
    }
    return said.get(m.parameter, "")


def grown(found: Sequence[Measurement]) -> str:
    """Return the table of how times grow with T60, microphones and azimuths: a line for each
    variant.
    """
    cells: dict[str, dict[str, str]] = {}
    for line in growth(found):
        ends = " to ".join(seconds(m.spread, brackets=False) for m in (line[0], line[-1]))
        said = f"{line[0].value:g} to {line[-1].value:g}: {ends}, power {power_of(line):.1f}"
        cells.setdefault(line[0].variant, {})[line[0].parameter] = said
    lines = [
        (variant, *(said.get(parameter, "") for parameter in GROWING))
        for variant, said in cells.items()
    ]
    return table(("how time grows", *GROWING.values()), lines)


def growth(found: Sequence[Measurement]) -> list[list[Measurement]]:
    """Return every series of wall times over T60, microphones or azimuths."""
    series: dict[tuple[str, str, str], list[Measurement]] = {}
    for m in found:
        if m.measure == "wall" and m.parameter in GROWING:
            series.setdefault((m.stage, m.variant, m.parameter), []).append(m)
    return [line for line in series.values() if len(line) > 1]


def power_of(line: Sequence[Measurement]) -> float:
    """Return the power of the parameter that the times of a series follow."""
    return exponent([float(m.value) for m in line], [m.spread.median for m in line])


def larger(found: Sequence[Measurement]) -> str:
    """Return the table of the growing set: a line per number of rows."""
    lines = []
    for rows, same in groupby((m for m in found if m.stage == "rows"), lambda m: m.value):
        of = {m.measure: m.spread for m in same}
        rates = (f"{of['rate'].median:.0f}", plain(of["steady rate"], "{:.0f}"))
        memory = (
            f"{of[key].median / 2**20:.0f} MiB" for key in ("memory, director", "memory, worker")
        )
        lines.append((spaced(rows), seconds(of["wall"]), *rates, *memory))
    head = (
        "rows generated",
        "takes",
        "rows/s",
        "rows/s, once started",
        "director's peak",
        "worker's peak",
    )
    whole = [m.spread.median for m in found if (m.stage, m.measure) == ("rows", "rate")]
    apart = (
        f"\n\nThe slowest of these has {min(whole) / max(whole):.0%} of the rows/s of the fastest."
        if whole[1:]
        else ""
    )
    return table(head, lines) + apart


def modelled(found: Sequence[Measurement]) -> str:
    """Return the table of trained runs: a line per classifier, median and quartiles over its runs."""
    runs = [m for m in found if m.stage in ("train", "models")]
    lines = []
    for name in sorted({m.group for m in runs}):
        mine = [m for m in runs if m.group == name]
        wall = [m for m in mine if m.measure == "wall"]
        own = {
            alone: [m for m in wall if not m.reference and (m.value == 1) is alone]
            for alone in (True, False)
        }
        ratio = [m.ratio.median for m in wall if m.ratio and m.value > 1]
        fit = [m for m in mine if m.measure == "fit"]
        cells = (over_runs(part) for part in (fit, own[True], own[False]))
        lines.append(
            (name, str(len(fit or own[True])), *cells, plain(spread(ratio)) if ratio else "")
        )
    head = (
        "classifier",
        "runs",
        "training",
        "one row in onnxruntime",
        "per row of many",
        "in NumPy, times as long",
    )
    return table(head, lines)


def carried(found: Sequence[Measurement]) -> str:
    """Return the table of bundles on a robot, a line each."""
    of = {(m.variant, m.measure): m.spread for m in found if m.stage == "robot"}
    lines = []
    for name in sorted({m.group for m in found if m.stage == "robot" and m.group}):
        parts = (of[f"{name}, {part}", "wall"] for part in ("joint", "gated", "classifier"))
        lines.append((name, *map(seconds, parts), f"{of[name, 'memory'].median / 2**20:.0f} MiB"))
    head = (
        "bundle, on one core",
        "recording to points, `joint`",
        "`gated`",
        "one echo judged",
        "memory at its peak",
    )
    return table(head, lines)


def over_runs(times: Sequence[Measurement]) -> str:
    """Return the spread of the medians of several runs, or nothing."""
    return seconds(spread([m.spread.median for m in times])) if times else ""


def spaced(number: int) -> str:
    """Return a whole number with a blank between thousands."""
    return f"{number:,}".replace(",", " ")


def seconds(value: Spread, *, brackets: bool = True) -> str:
    """Return a time in the unit that suits it, three digits, with quartiles unless there is but one
    value.
    """
    unit, name = next(((u, n) for u, n in UNITS if value.median >= u), UNITS[-1])
    scaled = Spread(*(part / unit for part in value))
    return f"{plain(scaled) if brackets else digits(scaled.median)} {name}"


def plain(value: Spread, form: str = "") -> str:
    """Return `median [q1, q3]`, the median alone where all three are equal, nothing for NaN."""
    if isnan(value.median):
        return ""
    shown = [form.format(part) if form else digits(part) for part in value]
    return shown[0] if value.q1 == value.q3 else f"{shown[0]} [{shown[1]}, {shown[2]}]"


def digits(value: float) -> str:
    """Return three significant digits, without an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"
