"""Templates of pages and tables, and the filters by which they show figures."""

from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.evaluation.rows import UNFIT, Row

FEW = 100
"""Echoes below which a figure is shown with their number: of 29 that are ordered without a fault a
bootstrap says 1.00 [1.00, 1.00], but one more may already be out of order."""


PRECISIONS = ("precision", "own_precision", "time_precision")
"""Metrics that are not defined of what keeps nothing; nor is their mean if one seed does."""

KEEPS_NOTHING = "a seed keeps nothing"


def template(name: str, *, room: str = "comparison") -> Any:
    """Return a template of a room, with the filters that format numbers."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        undefined=StrictUndefined,
        autoescape=name.endswith(".html"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {each.__name__: each for each in FILTERS}
    return environment.from_string(template_text(name, room=room))


def template_text(name: str, *, room: str = "comparison") -> str:
    """Return what stands in the templates of a room: a template, a style, a script."""
    return (resources.files(f"echolearn.{room}") / "templates" / name).read_text()


def number(value: Any, scale: float = 1.0, digits: int = 2) -> str:
    """Return a figure, scaled; nothing where there is none.

    Args:
        value: figure, or nothing.
        scale: factor that it is shown with.
        digits: decimals.
    """
    return "" if value in ("", None) or np.isnan(value) else f"{scale * value:.{digits}f}"


def with_interval(row: Row | None, scale: float = 1.0, digits: int = 2) -> str:
    """Return `value [low, high]` of a row, scaled; nothing where there is none.

    Args:
        row: figure with its interval, or None.
        scale: factor that all three are shown with.
        digits: decimals.
    """
    if row is None:
        return ""
    value, low, high = (number(row[key], scale, digits) for key in ("value", "ci_low", "ci_high"))
    if not value and row.get("metric") in PRECISIONS:
        return KEEPS_NOTHING
    return f"{value} [{low}, {high}]" if value and low else value


def precision(row: Row) -> str:
    """Return the precision of a row in %, or that there is none, since nothing was kept."""
    return number(row["value"], 100, 0) or KEEPS_NOTHING


def signed(test: Row, *, scale: float = 100.0, digits: int = 1) -> str:
    """Return a paired difference as `+value [low, high]`, scaled.

    Args:
        test: row of tests.csv.
        scale: factor that all three are shown with.
        digits: decimals.
    """
    value, low, high = (
        f"{scale * test[key]:+.{digits}f}" for key in ("difference", "ci_low", "ci_high")
    )
    return f"{value} [{low}, {high}]"


def verdict(test: Row) -> str:
    """Return what an interval of a difference allows to say: better, worse, or neither."""
    if test["ci_low"] > 0:
        return "better"
    return "worse" if test["ci_high"] < 0 else "no clear difference"


def shade(value: float) -> str:
    """Return the background of a table cell for an AUC: red below 0.5, blue above."""
    strength = min(abs(value - 0.5) / 0.5, 1.0)
    colour = "0, 114, 178" if value >= 0.5 else "213, 94, 0"
    return f"rgba({colour}, {0.42 * strength:.2f})"


def figure(row: Row | None) -> str:
    """Return the figure of a row, or why it has none; nothing without a row."""
    if row is None:
        return ""
    return str(row["metric"]).replace("_", " ") if row["metric"] in UNFIT else number(row["value"])


def of_few(row: Row | None) -> str:
    """Return of how many echoes a figure is if they are fewer than `FEW`, as ` (29 echoes)`."""
    if row is None or row["metric"] in UNFIT or np.isnan(row["value"]) or row["n"] >= FEW:
        return ""
    return f" ({row['n']} echoes)"


def shares(line: Mapping[Any, Row], prefix: str, level: str) -> str:
    """Return what a filter keeps of measured echoes as `precision / true kept / false removed`.

    Args:
        line: rows of a model by metric and SNR.
        prefix: beginning of the metrics' names, "time_" for those by time alone.
        level: SNR, empty for all.
    """
    names = ("precision", "true_retention", "spurious_removal")
    values = (number(line[prefix + name, level]["value"], 100, 0) or "-" for name in names)
    return " / ".join(values)


def share_on_walls(true: Array, kept: Array) -> str:
    """Return how many of the kept points lie on a wall, in words; both masks (P,), bool."""
    if not kept.any():
        return "no points"
    return f"{true[kept].mean():.0%} of {kept.sum()} points on a wall"


def p_value(p: float) -> str:
    """Return `p = ` with three decimals, or that it is smaller."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


FILTERS = (
    number,
    precision,
    with_interval,
    signed,
    shade,
    figure,
    of_few,
    shares,
    p_value,
    verdict,
)
"""What templates format figures by."""
