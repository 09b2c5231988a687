"""A recorded survey and a bundle make a map: every recording heard as `deploy` does, the files by
`mapfiles`.

The map is identified by what goes into it: the bundle, the survey's files, the resolution, how a
    direct path is removed
if that was chosen, and whether a bag for ROS is among its files. A finished one is not made again.
"""

import hashlib
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Echoes, EchoMap, Observation
from echolearn.checks import BadValue, check, check_name, check_number
from echolearn.evaluation import metrics
from echolearn.mapping.files import grid, mcap, ply, svg, table
from echolearn.mapping.files.chart import Chart, Files
from echolearn.robot.scorer import Heard, Scorer, load
from echolearn.runtime.progress import track
from echolearn.storage import manifests
from echolearn.storage.files import clean, sha256, write_atomic
from echolearn.storage.once import locked
from echolearn.survey import proof, reader
from echolearn.survey.direct_path import WAYS

SCORES = ("precision", "true_retention", "spurious_removal", "error_median", "wall_coverage")
"""Metrics that are shown where the room is known."""

ADVICE = (
    "is the direct path removed (calibration.wav, direct=), is speed_of_sound right, "
    "was the bundle trained for such rooms and noise?"
)
"""Where nothing is kept."""


def draw(
    *,
    survey: Path,
    bundle: Path,
    runs: Path,
    name: str | None = None,
    resolution: float = 0.05,
    resample: bool = False,
    direct: str | None = None,
    ros: bool = False,
    command: str | None = None,
) -> Path:
    """Map a recorded survey, and say what the map is worth where the room's outline is known.

    Args:
        survey: folder in the recorded-survey format.
        bundle: folder of a bundle.
        runs: the map goes to `runs/maps`.
        name: of the map's folder; `<survey>-<bundle>` unless given.
        resolution: side of a cell of the occupancy grid, in m.
        resample: bring recordings of another sample rate to the bundle's.
        direct: how to remove a direct path that is present, one of `direct.WAYS`; None takes the
            first that can be: `calibration` where it was recorded, else `fitted`.
        ros: also write a bag for ROS 2.
        command: what makes the map again; None says nothing about it.

    Returns:
        The map's folder.

    Raises:
        BadValue: a survey or bundle that is missing, damaged or not allowed, or that do not fit
            each other; or `ros` where no bag can be written.
    """
    mcap.check_wanted(ros)
    check(isinstance(resample, bool), "resample", resample, allowed="true or false")
    check_number("resolution", resolution, low=0.005, high=1.0, unit="m")
    name = name or f"{Path(survey).resolve().name}-{Path(bundle).resolve().name}"
    check_name("name", name)
    folder = Path(runs) / "maps" / name
    scorer, (walk, _) = load(bundle), proof.read(Path(survey))
    walk = replace(walk, rate=scorer.bundle.probe.sample_rate if resample else None)
    if direct is not None:
        walk = replace(walk, direct=_way(walk, direct))
    check_fit(scorer, walk)
    inputs = {
        "bundle": scorer.bundle.about["sha256"],
        "survey": fingerprint(walk),
        "resolution": float(resolution),
        **({} if direct is None else {"direct": direct}),
        **(
            {"ros": True} if ros else {}
        ),  # a map without a bag is what it was before there were bags
    }
    found = _finished(folder, inputs)
    if found is None:
        chart = _chart(name, walk, listen(scorer, walk), resolution=float(resolution))
        found = {
            "kind": "map",
            "inputs": inputs,
            "scores": scores(chart),
            "lines": len(chart.lines),
        }
        found |= {
            "poses": len(chart.path),
            "kept": int(np.sum(chart.map.kept)),
            **manifests.command_entry(command),
        }
        files = _files(chart, ros=ros)
        with locked(folder, waiting=f"map {name}: waiting for another command that writes it"):
            found = _finished(folder, inputs) or _write(folder, files, found)
    say(found)
    return folder


def _chart(name: str, walk: reader.Survey, heard: Heard, *, resolution: float) -> Chart:
    path, headings = (
        np.array([getattr(pose, field) for pose in walk.poses]) for field in ("position", "heading")
    )
    return Chart(
        name, heard.echoes, heard.map, path, walk.walls, resolution, headings, walk.numbers
    )


def _way(walk: reader.Survey, way: str) -> str:
    """Return how to remove the direct path of a survey, if it can be removed so."""
    check(way in WAYS, "direct", way, allowed=", ".join(WAYS))
    check(
        walk.direct is not None,
        "direct",
        way,
        allowed="null",
        hint=f"{walk.folder} has direct_path: removed",
    )
    known = way != "calibration" or (walk.folder / reader.CALIBRATION).exists()
    check(
        known,
        "direct",
        way,
        allowed="fitted or analytic",
        hint=f"{walk.folder} has no {reader.CALIBRATION}",
    )
    return way


def check_fit(scorer: Scorer, walk: reader.Survey) -> None:
    """Raise `BadValue` if a survey's microphones, sample rate or probe are not the bundle's, before
    it is heard.
    """
    count, wanted = len(walk.array), len(scorer.bundle.array)
    check(
        count == wanted,
        f"{walk.folder}/survey.yaml microphones",
        count,
        allowed=f"{wanted}, the bundle's",
    )
    rate, expected = walk.probe.sample_rate, scorer.bundle.probe.sample_rate
    hint = f"the rate is too low: the bundle listens up to {expected / 2:g} Hz"
    name, allowed = f"{walk.folder}/survey.yaml sample_rate", f"at least {expected:g} Hz"
    check(rate >= expected, name, f"{rate:g} Hz", allowed=allowed, hint=hint)
    silence = np.broadcast_to(0.0, (count, walk.probe.length))
    nothing = Observation(silence, walk.probe, walk.array, walk.speed_of_sound)
    try:
        scorer.check(nothing if walk.rate is None else reader.resampled(nothing, walk.rate))
    except BadValue as error:
        raise BadValue(f"{walk.folder}: {error}") from None


def fingerprint(walk: reader.Survey) -> str:
    """Return the digest of all files of a survey that a map depends on."""
    known = [name for name in proof.used(walk) if (walk.folder / name).is_file()]
    sums = "".join(f"{name} {sha256(walk.folder / name)}\n" for name in known)
    return hashlib.sha256(sums.encode()).hexdigest()


def listen(scorer: Scorer, walk: reader.Survey) -> Heard:
    """Hear every recording of a survey, block by block."""
    heard = []
    for block in track(reader.blocks(walk), f"map {walk.folder.name}", unit="blocks"):
        heard.append(_listen(scorer, walk, block))
    echoes = Echoes(
        *(
            np.concatenate([getattr(h.echoes, name) for h in heard])
            for name in vars(heard[0].echoes)
        )
    )
    found = EchoMap(
        *(np.concatenate([getattr(h.map, name) for h in heard]) for name in vars(heard[0].map))
    )
    return Heard(echoes, found)


def _listen(scorer: Scorer, walk: reader.Survey, block: Sequence[int]) -> Heard:
    """Hear a block of recordings; what is wrong with one of them is said of its file."""
    try:
        return scorer.listen(walk.observe(block), [walk.poses[pose] for pose in block])
    except BadValue as error:
        if not str(error).startswith("observation.samples="):
            raise
        if len(block) == 1:
            told = str(error).removeprefix("observation.samples=").replace(" of observation 0", "")
            raise BadValue(f"{walk.folder / walk.files[block[0]]}: {told}") from None
        for pose in block:
            _listen(scorer, walk, [pose])
        raise


def scores(chart: Chart) -> dict[str, float | None] | None:
    """Return what a map is worth, or None where the room is not known; a metric without a value is
    None.
    """
    if chart.outline is None:
        return None
    found = chart.map
    values = metrics.evaluate_map(
        chart.outline, found.points, kept=found.kept, confidence=found.confidence, poses=found.poses
    )
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def say(about: Mapping[str, Any]) -> None:
    """Print what a map holds and what it is worth."""
    print(f"{about['poses']} poses, {about['kept']} echoes kept, {about['lines']} walls fitted")
    if not about["kept"]:
        print(f"no echo is believed; {ADVICE}")
    for name in SCORES if about["scores"] else ():
        value = about["scores"][name]
        print(f"  {name:17}" + ("undefined" if value is None else f"{value:.3f}"))


def _finished(folder: Path, inputs: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the manifest of a finished map with these inputs; refuse a folder that holds something
    else.
    """
    names = {path.name for path in folder.glob("[!.]*")} if folder.is_dir() else set()
    foreign = (names and "map.csv" not in names) or (folder.exists() and not folder.is_dir())
    hint = f"{folder} {'holds' if names else 'is'} something else"
    check(not foreign, "name", folder.name, allowed="a new name, or that of a map", hint=hint)
    if not manifests.is_finished(folder):
        return None
    try:
        found = manifests.verify(folder)
    except ValueError:
        return None
    return found if found.get("inputs") == inputs else None


def _files(chart: Chart, *, ros: bool) -> Files:
    """Return the files of a map, by name."""
    writers = (table, ply, grid, svg, *((mcap,) if ros else ()))
    return {name: content for writer in writers for name, content in writer.write(chart).items()}


def _write(folder: Path, files: Files, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write a map in place of the one before, once it is known that all of it can be; return its
    manifest.
    """
    for path in (folder / name for name in (*files, manifests.MANIFEST)):
        check(
            path.is_file() or not path.exists(),
            str(path),
            "no plain file",
            allowed="a file of a map, or none",
        )
    bag = folder / mcap.FOLDER
    check(bag.is_dir() or not bag.exists(), str(bag), "a file", allowed="a folder, or none")
    _tell_replaced(folder, about["inputs"])
    clean(folder)
    clean(bag)
    if not {*mcap.FILES} & {*files}:
        mcap.remove(folder)  # that of the map before
    for name, content in files.items():
        write_atomic(folder / name, content)
    return manifests.finish(folder, about, files)


def _tell_replaced(folder: Path, inputs: Mapping[str, Any]) -> None:
    """Say so if in the folder is a map of other recordings or by another bundle."""
    with suppress(BadValue):  # there is none
        before = manifests.load_manifest(folder).get("inputs")
        other = not isinstance(before, dict) or any(
            before.get(key) != inputs[key] for key in ("survey", "bundle")
        )
        if other:
            print(f"{folder}: replaces the map of another survey or bundle", file=sys.stderr)
