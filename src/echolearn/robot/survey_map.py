"""A recorded survey and a bundle make a map: every recording scored, the files by `mapping/files`.

The map is identified by what goes into it: the bundle, the survey's files, the resolution, how a
direct path is removed if that was chosen, and whether a bag for ROS is among its files. A finished
one is not made again.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from echolearn.checks import BadValue, check, check_name, check_number
from echolearn.mapping.accuracy import accuracy_of
from echolearn.mapping.files import grid, ply, svg, table
from echolearn.mapping.mapped_walk import Files, MappedWalk
from echolearn.robot.advice import causes
from echolearn.robot.bundle import Bundle
from echolearn.robot.choices import open_survey, with_gains
from echolearn.robot.map_folder import describe_map, finished_map, report, told, write_map
from echolearn.robot.scorer import Scorer, load
from echolearn.runtime.progress import track
from echolearn.storage import manifests
from echolearn.storage.files import sha256
from echolearn.storage.once import once
from echolearn.survey.audio import LARGEST, check_size
from echolearn.survey.health import examine, mended
from echolearn.survey.proof import used
from echolearn.survey.survey import Survey, blocks

Fields = TypeVar("Fields")


def map_survey(
    *,
    survey: Path,
    bundle: Path,
    runs: Path,
    name: str | None = None,
    resolution: float = 0.05,
    resample: bool = False,
    direct: str | None = None,
    ros: bool = False,
    without: Sequence[int] | None = None,
    gains: Sequence[float] | None = None,
    localizer: Mapping[str, Any] | None = None,
    command: str | None = None,
) -> Path:
    """Map a recorded survey, print what the map is worth, and return its folder.

    Args:
        survey: folder in the recorded-survey format.
        bundle: folder of a bundle.
        runs: folder of everything generated; the map goes to `runs/maps`.
        name: name of the map's folder; `<survey>-<bundle>` unless given.
        resolution: side of a cell of the occupancy grid, in m.
        resample: bring recordings of another sample rate to the bundle's.
        direct: how to remove a direct path that is present, one of `direct_path.REMOVALS`; None
            takes the first that can be: `calibration` where it was recorded, else `fitted`.
        ros: also write a bag for ROS 2.
        without: numbers of microphones that are left out, from 1.
        gains: a factor for each microphone.
        localizer: `sign` of the echoes that the bundle's localizer seeks, if it is to be another.
        command: what makes the map again; None says nothing about it.

    Raises:
        BadValue: a survey or bundle that is not allowed, or that do not fit each other; recordings
            that cannot be trusted (`health`).
    """
    writers = _writers(ros)
    check_number("resolution", resolution, low=0.005, high=1.0, unit="m")
    name = name or f"{Path(survey).resolve().name}-{Path(bundle).resolve().name}"
    check_name("name", name)
    scorer = seeking(load(bundle), localizer)
    walk = open_survey(Path(survey), scorer.bundle, resample=resample, direct=direct)
    walk = with_gains(walk, scorer.bundle, without=without, gains=gains)
    asked = {"direct": direct, "ros": ros or None, "resolution": float(resolution)}
    asked["sign"] = (localizer or {}).get("sign")
    identity = partial(_identity, scorer.bundle, walk, asked=asked)
    inputs = identity()
    folder = Path(runs) / "maps" / name

    def make() -> dict[str, Any]:
        """Write the map, and return its manifest."""
        files, about = _mapped(scorer, walk, writers=writers, resolution=float(resolution))
        hint = "is it still being recorded? map it again when it is complete"
        allowed = "must not change while it is mapped"
        check(identity() == inputs, "survey", survey, allowed=allowed, hint=hint)
        about |= {"inputs": inputs} | manifests.command_entry(command)
        return write_map(folder, files, about=about)

    finished = partial(finished_map, folder, inputs)
    report(once(folder, finished=finished, make=make, doing="writes it"))
    return folder


def _mapped(
    scorer: Scorer, walk: Survey, *, writers: Sequence[Any], resolution: float
) -> tuple[Files, dict[str, Any]]:
    """Return the files of a map by name, and what its manifest says of it.

    Args:
        scorer: a bundle at work.
        walk: recorded as the bundle wants it.
        writers: modules that write the files.
        resolution: side of a cell of the occupancy grid, in m.
    """
    health = examine(walk)
    mapped = score_survey(scorer, mended(walk, health), resolution=resolution)
    files = {key: value for writer in writers for key, value in writer.write(mapped).items()}
    window = scorer.bundle.localizer.window
    why = causes(mapped, health, window=window)
    return files, describe_map(mapped, why) | told(health)


def seeking(scorer: Scorer, localizer: Mapping[str, Any] | None) -> Scorer:
    """Return a scorer whose localizer seeks echoes of the `sign` that is asked for, if one is."""
    sign = (localizer or {}).get("sign")
    if sign is None:
        return scorer
    other: Any = replace(scorer.bundle.localizer, sign=sign)  # type: ignore[type-var]
    return replace(scorer, bundle=replace(scorer.bundle, localizer=other))


def _writers(ros: bool) -> list[Any]:
    """Return the modules that write the files of a map."""
    check(isinstance(ros, bool), "ros", ros, allowed="must be true or false")
    if not ros:
        return [table, ply, grid, svg]
    try:
        return [table, ply, grid, svg, import_module("echolearn.mapping.files.mcap")]
    except ImportError:
        raise BadValue("ros=true: needs rosbags; pip install 'echolearn[ros]'") from None


def _identity(bundle: Bundle, walk: Survey, *, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a map is made from: the bundle, all files of the survey, and what was asked for.

    Args:
        bundle: what scores the echoes.
        walk: what is mapped.
        asked: keys of the command, None where a key was not given.
    """
    sums = hashlib.sha256()
    for name in used(walk):
        path = walk.folder / name
        check_size(path, LARGEST)
        # What is missing is named when it is read.
        if path.is_file():
            sums.update(f"{name} {sha256(path)}\n".encode())
    # What was not asked for is not named, so that maps of before keep their identity.
    given = {key: value for key, value in asked.items() if value is not None}
    if walk.gains is not None:
        given["gains"] = walk.gains.tolist()
    return given | {"bundle": bundle.about["sha256"], "survey": sums.hexdigest()}


def score_survey(scorer: Scorer, walk: Survey, *, resolution: float = 0.05) -> MappedWalk:
    """Score every recording of a survey, block by block.

    Args:
        scorer: a bundle at work.
        walk: recorded as the bundle wants it.
        resolution: side of a cell of the occupancy grid, in m.

    Raises:
        BadValue: a recording that cannot be analysed; names its file.
    """
    scored = []
    for block in track(blocks(walk), f"map {walk.folder.name}", unit="blocks"):
        try:
            poses = [walk.poses[pose] for pose in block]
            scored.append(scorer.score(walk.observe(block), poses))
        except BadValue as error:
            raise _blame(error, scorer, walk=walk, block=block) from None
    return MappedWalk(
        echoes=_joined([each.echoes for each in scored]),
        map=_joined([each.map for each in scored]),
        poses=walk.poses,
        numbers=walk.numbers,
        outline=walk.walls,
        resolution=resolution,
        accuracy=accuracy_of(
            walk.emitted,
            walk.array,
            azimuths=scorer.bundle.localizer.azimuths,
            speed_of_sound=walk.speed_of_sound,
            heading_bias_sd=walk.heading_bias_sd,
        ),
    )


def _joined(parts: Sequence[Fields]) -> Fields:
    """Return values of one class, whose fields are arrays, as one of them all."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))


def _blame(error: BadValue, scorer: Scorer, *, walk: Survey, block: Sequence[int]) -> BadValue:
    """Return the complaint about a block, said of the file of the recording that is to blame."""
    if not str(error).startswith("observation.samples="):
        return error
    # Alone, a recording is number 0 of its block, which tells a reader nothing.
    for pose in block:
        try:
            scorer.score(walk.observe([pose]), [walk.poses[pose]])
        except BadValue as alone:
            reason = str(alone).removeprefix("observation.samples=")
            reason = reason.replace(" of observation 0", "")
            return BadValue(f"{walk.folder / walk.files[pose]}: {reason}")
    return error
