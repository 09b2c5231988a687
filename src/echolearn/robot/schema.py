"""What `bundle.json` tells without anything being computed from it: each key's type, so that
readers can rely on it.

    classifier name run trained_on      texts            seed             a whole number
    data      plan digest rows          versions         texts by library
    parity    difference trials         calibration      slope intercept
    metrics   held_out (set, rows, figures: value ci_low ci_high by metric), maps (the same with tested_on and metric)
    command   a command line of echolearn, if there

Texts are printable, so that nothing in them plays tricks with a terminal.
"""

from collections.abc import Mapping
from typing import Any

from echolearn.acoustics.types import PARITY
from echolearn.checks import check, check_list, check_number, check_whole
from echolearn.storage import manifests

TEXTS = ("classifier", "name", "run", "trained_on")
FIGURE = ("value", "ci_low", "ci_high")


def part(about: Mapping[str, Any], name: str, keys: str, *, of: str = "") -> dict[str, Any]:
    """Return a mapping within `bundle.json`, or within its part `of`, that must have exactly these
    keys.
    """
    found = about[name]
    known = isinstance(found, dict) and sorted(found) == sorted(keys.split())
    check(
        known,
        f"{of}{name}",
        sorted(found) if isinstance(found, dict) else found,
        allowed=f"a mapping with {keys}",
    )
    return dict(found)


def check_text(name: str, value: Any) -> None:
    """Raise `BadValue` unless a value is a printable text of one line."""
    plain = isinstance(value, str) and 0 < len(value) <= 1000 and value.isprintable()
    check(plain, name, ascii(value)[:100], allowed="a printable text of at most 1000 characters")


def check_told(about: Mapping[str, Any]) -> None:
    """Raise `BadValue` unless everything that `bundle.json` merely tells has its type."""
    for key in TEXTS:
        check_text(key, about[key])
    command = about.get("command", "echolearn export")
    check(
        manifests.is_command(command),
        "command",
        ascii(command)[:100],
        allowed="one command line of echolearn, quoted",
    )
    check_whole("seed", about["seed"], low=0, high=2**63)
    data, parity = (
        part(about, "data", "plan digest rows"),
        part(about, "parity", "difference trials"),
    )
    for key in ("plan", "digest"):
        check_text(f"data.{key}", data[key])
    check_whole("data.rows", data["rows"], low=1, high=10**12)
    check_number("parity.difference", parity["difference"], low=0.0, high=PARITY)
    check_whole("parity.trials", parity["trials"], low=1)
    for key, value in part(about, "calibration", "slope intercept").items():
        check_number(f"calibration.{key}", value)
    check(
        isinstance(about["versions"], dict),
        "versions",
        about["versions"],
        allowed="a mapping of texts",
    )
    for key, value in about["versions"].items():
        check_text(f"versions.{key}", value)
    check_metrics(part(about, "metrics", "held_out maps"))


def check_metrics(metrics: Mapping[str, Any]) -> None:
    """Raise `BadValue` unless the figures of a bundle are figures."""
    held_out = part(metrics, "held_out", "set rows figures", of="metrics.")
    check_text("metrics.set", held_out["set"])
    check_whole("metrics.rows", held_out["rows"], low=1, high=10**12)
    figures, maps = held_out["figures"], metrics["maps"]
    check(isinstance(figures, dict), "metrics.figures", figures, allowed="a mapping of metrics")
    check_list("metrics.maps", maps)
    for name in figures:
        check_figure(f"metrics.{name}", part(figures, name, " ".join(FIGURE), of="metrics."))
    for row in maps:
        told = part({"metrics.maps": row}, "metrics.maps", f"tested_on metric {' '.join(FIGURE)}")
        for key in ("tested_on", "metric"):
            check_text(f"metrics.maps.{key}", told[key])
        check_figure("metrics.maps", told)


def check_figure(name: str, figure: Mapping[str, Any]) -> None:
    """Raise `BadValue` unless value and interval are numbers or undefined."""
    for key in FIGURE:
        if figure[key] is not None:
            check_number(f"{name} {key}", figure[key])
