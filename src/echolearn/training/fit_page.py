"""The page of `fit`: what was heard, what is believed, what to do better; one file, offline.

Nothing of a survey is markup: every text is escaped. The map is the drawing that `map` made.
"""

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.robot.pages import filled_page
from echolearn.storage import manifests
from echolearn.storage.advice import assignment
from echolearn.survey.health import Health
from echolearn.survey.survey import Survey

PAGE = "fit.html"

QUIET_DB = 0.0
"""dB of SNR below which more pings are advised."""

FEW = 20
"""Poses below which a longer walk is advised."""


@dataclass(frozen=True)
class Fit:
    """A filter that was made for a robot, and what came of it.

    Attributes:
        name: of the page's folder.
        walk: the robot's recordings.
        health: what they say about themselves.
        told: what was concluded of robot and place, lines "what: text".
        result: metrics of the trained run.
        parts: folders of the steps: set, run, bundle, map.
    """

    name: str
    walk: Survey
    health: Health
    told: list[str]
    result: Mapping[str, Any]
    parts: Mapping[str, Path]


def fit_page(fit: Fit) -> bytes:
    """Return the page."""
    about = manifests.load_manifest(fit.parts["map"])
    drawing = fit.parts["map"] / "map.svg"
    filled = {
        "title": escape(fit.name),
        "heard": _items([*_health_lines(fit.health), *fit.told]),
        "counts": escape(_counts(about)),
        "map": drawing.read_text() if about.get("points") else "",
        "expected": escape(worth_line(fit.result)),
        "advice": _items(advice(fit, about)),
        "steps": _items(next_steps(fit)),
    }
    return filled_page("training", PAGE, filled=filled)


def _items(lines: Iterable[str]) -> str:
    """Return lines "what: text" as items of a list, the first part set off."""
    items = []
    for line in lines:
        what, colon, text = line.partition(": ")
        shown = f"<b>{escape(what)}</b> {escape(text)}" if colon else escape(line)
        items.append(f"<li>{shown}</li>")
    return "".join(items)


def _health_lines(health: Health) -> list[str]:
    """Return what the recordings say about themselves, a line each."""
    lines = [f"time zero: {health.time_zero}"]
    known = health.snr_db[np.isfinite(health.snr_db)]
    if len(known):
        lines.append(f"level: {np.median(known):.0f} dB over the quietest stretch, in the median")
    lines += [f"mended: {line}" for line in health.mended]
    return [*lines, *(f"noticed: {line}" for line in health.noticed)]


def _counts(about: Mapping[str, Any]) -> str:
    """Return how much of the walk is believed."""
    text = f"{about['kept']} of the echoes at {about['poses']} poses are believed"
    if not about.get("placed", True):
        return f"{text}; times and directions only (map: false)."
    return (
        f"{text}: {about['points']} points in the map, {about['floor_or_ceiling']} from floor or "
        f"ceiling; {about['lines']} walls go through them."
    )


def worth_line(result: Mapping[str, Any]) -> str:
    """Return how well a run did on simulated positions that nothing was fitted to."""
    test = result["test"]
    shown = {"precision": "of what it keeps is true", "recall": "of what is true is kept"}
    parts = [f"{100 * test[key]:.0f} % {text}" for key, text in shown.items() if test[key]]
    missed = (result.get("operating_point") or {}).get("missed")
    aim = f" ({missed})" if missed else ""
    return (
        f"In simulated rooms that it never saw, at all levels of noise together: AUC "
        f"{test['auc']:.2f}; {', '.join(parts)}{aim}. In a real place expect less."
    )


def advice(fit: Fit, about: Mapping[str, Any]) -> list[str]:
    """Return what would make the map better, the most likely first; one line if nothing would."""
    lines = [f"likely: {cause}" for cause in about["causes"]]
    known = fit.health.snr_db[np.isfinite(fit.health.snr_db)]
    if not lines and len(known) and np.median(known) < QUIET_DB:
        lines.append("quiet: play louder, or average several pings at each pose")
    if not lines and not fit.health.direct:
        lines.append(
            "time zero: leave the direct path in the recordings (direct_path: present); then "
            "latency is measured, which moves every echo"
        )
    if about["poses"] < FEW:
        lines.append(f"few poses: record {FEW} or more; a wall needs several that hear it")
    return lines or ["Nothing stands out."]


def next_steps(fit: Fit) -> list[str]:
    """Return commands that go on from here."""
    survey = assignment("survey", str(fit.walk.folder))
    bundle = assignment("bundle", str(fit.parts["bundle"]))
    lines = {
        "look at the recordings": ["echolearn", "check", survey],
        "map another walk": ["echolearn", "map", "survey=<folder>", bundle],
        "prove that nothing has changed": [
            "echolearn",
            "verify",
            *(str(fit.parts[key]) for key in ("set", "run", "bundle", "map")),
        ],
    }
    return [f"{what}: {shlex.join(words)}" for what, words in lines.items()]
