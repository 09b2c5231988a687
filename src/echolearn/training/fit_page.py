"""The page of `fit`: what was heard, what is believed, what to do better; one file, offline.

Nothing of a survey is markup: every text is escaped. The map is the drawing that `map` made. Before
there is a recording, it says what the robot is, and what to record.
"""

import os
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from echolearn.robot.map_folder import unsure_of
from echolearn.robot.pages import filled_page
from echolearn.robot.reference import UNCHECKED
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
        folder: where the page goes.
        walk: the robot's recordings; without a pose where there are none yet.
        health: what they say about themselves, or None.
        told: what was concluded of robot and place, lines "what: text".
        result: metrics of the trained run.
        parts: folders of the steps: set, run, bundle, and map if something was heard.
    """

    folder: Path
    walk: Survey
    health: Health | None
    told: list[str]
    result: Mapping[str, Any]
    parts: Mapping[str, Path]


def fit_page(fit: Fit) -> bytes:
    """Return the page."""
    filled = {
        "title": escape(fit.folder.name),
        "expected": escape(worth_line(fit.result)),
        "steps": _links(fit),
        "next": _items(next_steps(fit)),
    }
    filled |= _heard(fit, fit.health) if fit.health else _unheard(fit)
    return filled_page("training", PAGE, filled=filled)


def _heard(fit: Fit, health: Health) -> dict[str, str]:
    """Return the parts of the page that tell what came of recordings."""
    about = manifests.load_manifest(fit.parts["map"])
    drawing = fit.parts["map"] / "map.svg"
    lines = [*_health_lines(health), *fit.told, f"domain: {about.get('domain', UNCHECKED)}"]
    return {
        "counts": escape(_counts(about)),
        "map": drawing.read_text() if about.get("points") else "",
        "known": "What was heard",
        "heard": _items(lines),
        "better": "What to do better",
        "advice": _items(advice(fit.walk, health, about=about)),
    }


def _unheard(fit: Fit) -> dict[str, str]:
    """Return the parts of the page where there is no recording yet."""
    text = (
        f"Nothing was heard yet: this filter was made for the robot of {fit.walk.folder.name}, "
        "by simulation alone."
    )
    return {
        "counts": escape(text),
        "map": "",
        "known": "What is known of the robot",
        "heard": _items(fit.told),
        "better": "What to record next",
        "advice": _items(to_record(fit.walk)),
    }


def _links(fit: Fit) -> str:
    """Return links to the folders of the steps, which a browser opens where the page lies."""
    items = []
    for what, place in fit.parts.items():
        near = quote(os.path.relpath(place, fit.folder))
        name = escape(f"{place.parent.name}/{place.name}")
        items.append(f'<li><b>{what}</b> <a href="{near}/">{name}</a></li>')
    return "".join(items)


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
        f"ceiling; {about['lines']} walls go through them{unsure_of(about)}."
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


def advice(walk: Survey, health: Health, *, about: Mapping[str, Any]) -> list[str]:
    """Return what would make the map better, the most likely first; one line if nothing would.

    Args:
        walk: the robot's recordings.
        health: what they say about themselves.
        about: manifest of the map.
    """
    lines = [f"likely: {cause}" for cause in about["causes"]]
    known = health.snr_db[np.isfinite(health.snr_db)]
    if not lines and len(known) and np.median(known) < QUIET_DB:
        lines.append("quiet: play louder, or average several pings at each pose")
    if not lines and not health.direct:
        lines.append(
            "time zero: leave the direct path in the recordings (direct_path: present); then "
            "latency is measured, which moves every echo"
        )
    if len(walk) < FEW:
        lines.append(f"few poses: record {FEW} or more; a wall needs several that hear it")
    return lines or ["Nothing stands out."]


def to_record(robot: Survey) -> list[str]:
    """Return what the first walk of a robot needs, a line each."""
    probe = robot.probe
    window = robot.window
    return [
        f"walk: {FEW} poses or more, {window.nearest:g} to {window.farthest:g} m from walls, "
        "several for each wall, and with turns",
        f"recordings: at each pose {probe.length} samples at {probe.sample_rate:g} Hz of "
        f"{len(robot.array)} microphones from the emission on, in observations/",
        "poses.csv: index,x_m,y_m,z_m,heading_rad,file; the loudspeaker's places in m, headings "
        "counter-clockwise from x in rad",
        f"survey.yaml: the keys of {robot.folder.name} but for probe, and direct_path: present; "
        "probe.wav beside it",
        "noise.wav: some seconds with the loudspeaker silent",
        "calibration.wav: optional, one ping where nothing reflects, outdoors",
    ]


def next_steps(fit: Fit) -> list[str]:
    """Return commands that go on from here."""
    bundle = assignment("bundle", str(fit.parts["bundle"]))
    if fit.health:
        survey = assignment("survey", str(fit.walk.folder))
        lines = {
            "look at the recordings": ["check", survey, bundle],
            "map another walk": ["map", "survey=<folder>", bundle],
        }
    else:
        lines = {
            "are the recordings sound": ["check", "survey=<folder>", bundle],
            "map them by this filter": ["map", "survey=<folder>", bundle],
            "make a filter by what they tell": ["fit", "survey=<folder>"],
        }
    lines["prove that nothing has changed"] = ["verify", *map(str, fit.parts.values())]
    return [f"{what}: {shlex.join(['echolearn', *words])}" for what, words in lines.items()]
