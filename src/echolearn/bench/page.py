"""What the benchmarks say, as Markdown: tables of comparisons, growth, sets, trained runs.

Times are medians with quartiles in brackets, ratios are those of laps, also with quartiles.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isnan
from typing import Any

from echolearn.bench.measurement import Measurement
from echolearn.runtime.timing import Spread, exponent, spread

TITLES = {
    "rir": "responses of all microphones",
    "localize": "one observation",
    "steps": "one observation",
    "generate": "`echolearn generate`",
    "robot": "a bundle on one core",
    "start": "a command",
}
"""What a unit of each compared stage is."""

CONDITIONS = {
    "t60": ", T60 {} s",
    "outline": " in a room of 80 m^2, T60 {} s",
    "realism": ", {} rows of the growing set",
    "batch": " of {} at a time",
    "rows": ", {} rows",
}
"""Under which condition something was compared, by parameter."""

GROWING = {"t60": "with T60 in s", "microphones": "with microphones", "azimuths": "with azimuths"}
"""Parameters over which times grow."""

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))

Cell = tuple[str, str, str]
"""Line, column and text; texts of the same place stand behind each other."""


def page(found: Sequence[Measurement], machine: Mapping[str, Any], *, brief: bool = False) -> str:
    """Return the tables of everything measured.

    Args:
        found: all measurements.
        machine: what they were made on.
        brief: whether to leave out single steps.
    """
    parts = [
        measured_on(machine),
        table("what", compared([m for m in found if not (brief and m.stage == "steps")])),
        table("how time grows", grown(found)),
        table("rows generated", larger(found)),
        table("classifier", modelled(found)),
    ]
    return "\n\n".join(part for part in parts if part)


def measured_on(machine: Mapping[str, Any]) -> str:
    """Return where and how it was measured, in a sentence or two."""
    memory = f"{machine['memory_gib']:.0f} GiB"
    load = f"load average {machine['load_before']:.1f} to {machine['load_after']:.1f}"
    where = ", ".join([machine["processor"], memory, machine["system"], load])
    return (
        f"Median [quartiles] of wall time; {where}. One thread each unless said otherwise, in "
        "turns in one run; ratios are those of neighbouring laps."
    )


def table(corner: str, cells: Iterable[Cell]) -> str:
    """Return a Markdown table, lines and columns in the order of their cells; "" without any."""
    lines: dict[str, dict[str, str]] = {}
    columns: dict[str, str] = {}
    for name, column, text in cells:
        columns[column] = "---"
        line = lines.setdefault(name, {})
        line[column] = f"{line[column]}; {text}" if column in line else text
    rows = [[corner, *columns], ["---", *columns.values()]]
    for name, line in lines.items():
        rows.append([name, *(line.get(column, "") for column in columns)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) if lines else ""


def compared(found: Sequence[Measurement]) -> Iterator[Cell]:
    """Yield what was timed beside its peers, and what has none but is of interest by itself."""
    references = {(m.stage, m.parameter, m.value, m.reference) for m in found}
    for m in found:
        if m.stage not in TITLES or m.measure not in ("wall", "memory"):
            continue
        # A peer stands in the line of what it is compared with.
        condition = CONDITIONS.get(m.parameter, "").format(m.value)
        line = f"{TITLES[m.stage]}{condition}: {m.reference or m.variant}"
        own = (m.stage, m.parameter, m.value, m.variant)
        if m.reference:
            name = m.variant.removeprefix(f"{m.reference}, ")
            text = f"{name} {seconds(m.spread, brackets=False)}, {with_quartiles(m.ratio)} times"
            yield line, "beside it, and how many times as long", text
        elif own in references or m.stage in ("steps", "robot"):
            yield line, "takes", in_unit(m)


def grown(found: Sequence[Measurement]) -> Iterator[Cell]:
    """Yield how times grow with T60, microphones and azimuths, a line for each variant."""
    series: dict[tuple[str, str], list[Measurement]] = {}
    for m in found:
        if m.measure == "wall" and m.parameter in GROWING:
            series.setdefault((m.variant, GROWING[m.parameter]), []).append(m)
    for (variant, column), line in series.items():
        # A power needs two points at least.
        if len(line) > 1:
            ends = " to ".join(seconds(m.spread, brackets=False) for m in (line[0], line[-1]))
            power = exponent([m.value for m in line], [m.spread.median for m in line])
            said = f"{line[0].value:g} to {line[-1].value:g}: {ends}, power {power:.1f}"
            yield variant, column, said


def larger(found: Sequence[Measurement]) -> Iterator[Cell]:
    """Yield what the growing set takes, a line per number of rows."""
    for m in found:
        if m.stage == "rows":
            yield f"{m.value:,}".replace(",", " "), m.measure, in_unit(m)


def modelled(found: Sequence[Measurement]) -> Iterator[Cell]:
    """Yield times of training and models, a line per classifier, over the medians of its runs."""
    medians: dict[tuple[str, str], list[float]] = {}
    for m in found:
        column = f"training, {m.measure}"
        if m.stage == "models":
            column = f"{m.variant.rpartition(', ')[2]}, {'one row' if m.value == 1 else 'per row'}"
        if m.stage in ("train", "models") and m.measure != "cpu":
            medians.setdefault((m.group, column), []).append(m.spread.median)
    for (group, column), values in sorted(medians.items(), key=lambda item: item[0][0]):
        yield group, column, seconds(spread(values))


def in_unit(m: Measurement) -> str:
    """Return a quantity: seconds, bytes as MiB, rows per second."""
    if m.unit == "s":
        return seconds(m.spread)
    if m.unit in ("B", "byte"):
        return f"{m.spread.median / 2**20:.0f} MiB"
    return with_quartiles(m.spread)


def seconds(value: Spread, *, brackets: bool = True) -> str:
    """Return a time in the unit that suits it, with quartiles unless there is but one value."""
    unit, name = next((each for each in UNITS if value.median >= each[0]), UNITS[-1])
    scaled = Spread(*(part / unit for part in value))
    return f"{with_quartiles(scaled) if brackets else digits(scaled.median)} {name}"


def with_quartiles(value: Spread) -> str:
    """Return `median [q1, q3]`, the median alone where all are equal, nothing for NaN."""
    if isnan(value.median):
        return ""
    median, low, high = map(digits, value)
    return median if value.q1 == value.q3 else f"{median} [{low}, {high}]"


def digits(value: float) -> str:
    """Return three significant digits, without an exponent."""
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"
