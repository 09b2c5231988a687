"""The folder of a map: finished, or written in place of the map before.

What is there must be a map. Nothing is written before it is known that all of it can be.
"""

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Echoes
from echolearn.checks import BadValue, check
from echolearn.evaluation.labelling import echo_scores, label_echoes
from echolearn.evaluation.map_metrics import evaluate_map
from echolearn.evaluation.metrics import finite
from echolearn.mapping.mapped_walk import BAG, Files, MappedWalk
from echolearn.mapping.mirrors import one_each
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.survey.health import Health
from echolearn.survey.survey import Survey
from echolearn.survey.time_zero import HIDDEN

SHOWN = ("precision", "true_retention", "spurious_removal", "error_median", "wall_coverage")
"""Metrics that are printed where the room is known."""

KEPT = ("precision", "true_retention", "spurious_removal")
ECHO_SHOWN = (*KEPT, *(f"time_{name}" for name in KEPT))
"""Metrics of echoes that are printed where their truth is known."""

DRAWN = ("walls.csv", "hypotheses.csv", "map.ply", "map.pgm", "map.yaml", "map.svg")
"""Files of a map besides its table, which not every one has."""


def finished_map(folder: Path, inputs: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the manifest of a finished map with these inputs, if it is there.

    Raises:
        BadValue: something else than a map is there.
    """
    names = {path.name for path in folder.glob("[!.]*")} if folder.is_dir() else set()
    foreign = (names and "map.csv" not in names) or (folder.exists() and not folder.is_dir())
    hint = f"{folder} {'holds' if names else 'is'} something else"
    check(
        not foreign, "name", folder.name, allowed="must be a new name, or that of a map", hint=hint
    )
    with suppress(BadValue):
        about = manifests.verify(folder)
        # Before there were these numbers, tables had fewer columns.
        current = about.get("inputs") == inputs and "points" in about
        return about if current else None
    return None


def write_map(folder: Path, files: Files, *, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write a map in place of the one before, and return its manifest.

    Args:
        folder: where it goes.
        files: contents by name.
        about: what its manifest says besides.

    Raises:
        BadValue: something is in the way of one of its files; nothing is written then.
    """
    for path in (folder / name for name in (*files, manifests.MANIFEST)):
        free = path.is_file() or not path.exists()
        check(free, str(path), "no plain file", allowed="must be a file of a map, or none")
        free = path.parent.is_dir() or not path.parent.exists()
        check(free, str(path.parent), "a file", allowed="must be a folder, or none")
    # Two surveys of one name share a folder unless they are told apart by name=.
    _tell_replaced(folder, about["inputs"])

    # What a killed command or the map before has left would seem to be part of this one.
    bag = (folder / BAG[0]).parent
    clean(folder)
    clean(bag)
    for name in {*DRAWN} - {*files}:
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):  # there is no bag of the map before, or something else is in its folder
        for name in {*BAG} - {*files}:
            (folder / name).unlink(missing_ok=True)
        bag.rmdir()
    for name, content in files.items():
        write_atomic(folder / name, content)
    return manifests.finish(folder, about, files=files)


def _tell_replaced(folder: Path, inputs: Mapping[str, Any]) -> None:
    """Say so if in the folder is a map of other recordings or by another bundle."""
    with suppress(BadValue):  # there is none
        before = manifests.load_manifest(folder).get("inputs")
        known = before if isinstance(before, dict) else {}
        if any(known.get(key) != inputs[key] for key in ("survey", "bundle")):
            print(f"{folder}: replaces the map of another survey or bundle", file=sys.stderr)


def describe_map(mapped: MappedWalk, causes: Sequence[str]) -> dict[str, Any]:
    """Return what the manifest of a map says of it; a metric without a value is None.

    Args:
        mapped: the map.
        causes: why no point of it is drawn, or no wall goes through them, if so.
    """
    scores = None
    if mapped.outline is not None and mapped.placed:
        # What is drawn is what is scored.
        found = one_each(mapped, mapped.outline)
        values = evaluate_map(
            mapped.outline,
            found.points,
            kept=found.kept,
            confidence=found.confidence,
            poses=found.poses,
        )
        scores = {key: finite(value) for key, value in values.items()}
    unsure = {} if mapped.undecided is None else {"undecided": int(mapped.undecided.sum()) // 2}
    judged = mapped.judged
    walls = {} if judged is None else {"walls": int(judged.believed.sum())}
    if judged is not None:
        walls["hypotheses"] = len(judged.believed)
    return unsure | {
        "kind": "map",
        **walls,
        "scores": scores,
        "lines": len(mapped.lines),
        "poses": len(mapped.poses),
        "kept": int(np.sum(mapped.map.kept)),
        "points": int(np.sum(mapped.shown)),
        "floor_or_ceiling": int(np.sum(mapped.upright)),
        "causes": [*causes],
    }


def judged(mapped: MappedWalk, walk: Survey) -> dict[str, Any]:
    """Return what the manifest of a map says of its echoes by their truth, if that is known."""
    about: dict[str, Any] = {} if mapped.placed else {"placed": False}
    # Walls are judged over all poses: no echo of theirs stands for a pose.
    if walk.truth is None or mapped.judged is not None:
        return about
    rate = walk.emitted.sample_rate
    # An echo and its mirror image are one to the truth, which knows no map.
    points = 1 if mapped.undecided is None else 2
    echoes = Echoes(*(column[:, ::points] for column in vars(mapped.echoes).values()))
    labels = label_echoes(walk.truth, echoes, sample_rate=rate, array=walk.array)
    kept = np.asarray(mapped.map.kept).reshape(-1, points)
    scores = echo_scores(labels, np.asarray(kept.any(axis=1)))
    return about | {"echo_scores": {name: finite(value) for name, value in scores.items()}}


def told(health: Health) -> dict[str, Any]:
    """Return what the manifest of a map says of its recordings; nothing of sound ones."""
    noticed = [*health.noticed]
    if health.time_zero == HIDDEN:
        noticed.append(f"{HIDDEN}, so it is taken on trust")
    lines = {"mended": list(health.mended), "noticed": noticed}
    return {"health": lines} if any(lines.values()) else {}


def report(about: Mapping[str, Any]) -> None:
    """Print what a map holds and what it is worth."""
    for kind, lines in about.get("health", {}).items():
        for line in lines:
            print(f"{kind}: {line}")
    counted = f"{about['poses']} poses, {about['kept']} echoes kept: "
    if "walls" in about:
        print(
            f"{counted}{about['walls']} walls in {about['lines']} stretches, of "
            f"{about['hypotheses']} lines that all poses together speak for"
        )
    elif about.get("placed", True):
        print(
            f"{counted}{about['points']} points in the map, {about['floor_or_ceiling']} from "
            f"floor or ceiling; {about['lines']} walls fitted{unsure_of(about)}"
        )
    else:
        print(f"{counted}times and directions only, no points, no walls (map: false)")
    if about["causes"]:
        lack = "no wall goes through the points" if about["points"] else "no point is drawn"
        print(f"{lack}; the most likely cause first:")
    for number, cause in enumerate(about["causes"], start=1):
        print(f"  {number}. {cause}")
    if about["scores"]:
        _print_scores(about["scores"], SHOWN)
    if about.get("echo_scores"):
        print("of echoes, by truth.csv; time_: by time alone")
        known = [name for name in ECHO_SHOWN if name in about["echo_scores"]]
        _print_scores(about["echo_scores"], known)


def unsure_of(about: Mapping[str, Any]) -> str:
    """Return what there is to say of echoes whose side is undecided; nothing of other arrays."""
    if "undecided" not in about:
        return ""
    return f"; {about['undecided']} more may lie on either side of the array, undecided"


def _print_scores(scores: Mapping[str, float | None], names: Sequence[str]) -> None:
    """Print some metrics, a line each."""
    width = max(17, *(len(name) + 1 for name in names))
    for name in names:
        value = scores[name]
        print(f"  {name:{width}}" + ("undefined" if value is None else f"{value:.3f}"))
