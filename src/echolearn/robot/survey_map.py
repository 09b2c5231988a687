"""A recorded survey and a bundle make a map: every recording scored, the files by `mapping/files`.

The map is identified by what goes into it: the bundle, the survey's files, the resolution, how a
direct path is removed if that was chosen, and whether a bag for ROS is among its files. A finished
one is not made again.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any

from echolearn.acoustics.arrays import mirror_azimuth
from echolearn.checks import BadValue, check, check_name, check_number
from echolearn.mapping.files import grid, ply, svg, table
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.mapping.mirrors import with_mirror_images
from echolearn.robot.advice import causes
from echolearn.robot.by_block import block_by_block, concatenated
from echolearn.robot.choices import OF_THE_SURVEY, open_survey, with_gains
from echolearn.robot.domain import domain_line
from echolearn.robot.map_folder import (
    describe_map,
    finished_map,
    judged,
    report,
    told,
    write_map,
)
from echolearn.robot.reference import UNCHECKED
from echolearn.robot.scorer import ScoredEchoes, Scorer, load
from echolearn.robot.walk_map import mapped_walk
from echolearn.robot.wall_map import check_together, score_walls
from echolearn.storage import manifests
from echolearn.storage.files import sha256
from echolearn.storage.once import once
from echolearn.survey.audio import LARGEST, check_size
from echolearn.survey.examining import examine
from echolearn.survey.health import Health, mended
from echolearn.survey.proof import used
from echolearn.survey.survey import Survey


def map_survey(
    *,
    survey: Path,
    bundle: Path,
    runs: Path,
    name: str | None = None,
    resolution: float = 0.05,
    resample: bool = False,
    direct: str | None = None,
    played: str | None = None,
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
            takes the first that can be: `calibration` where it was recorded, else `fir`.
        played: `calibration` or `walk`: its burst as played is sought; None: that of `probe.wav`.
        ros: also write a bag for ROS 2.
        without: numbers of microphones that are left out, from 1.
        gains: a factor for each microphone.
        localizer: `sign` of the echoes that the bundle's localizer seeks, if it is to be another.
        command: what makes the map again; None says nothing about it.

    Raises:
        BadValue: survey and bundle that do not fit, or recordings not to be trusted (`health`).
    """
    writers = _writers(ros)
    check_number("resolution", resolution, low=0.005, high=1.0, unit="m")
    folder = _folder(runs, survey, bundle=bundle, name=name)
    sign = (localizer or {}).get("sign")
    scorer = seeking(load(bundle), sign)
    walk = open_survey(Path(survey), scorer.bundle, resample=resample, direct=direct, played=played)
    walk = with_gains(walk, scorer.bundle, without=without, gains=gains)
    if scorer.bundle.hypotheses is not None:
        check_together(walk)
    asked = {"direct": direct, "ros": ros or None, "resolution": float(resolution), "sign": sign}
    order = _Order(scorer, walk, asked=asked | {"played": played}, writers=writers)
    order.run(folder, command)
    return folder


def _folder(runs: Path, survey: Path, *, bundle: Path, name: str | None) -> Path:
    """Return where a map goes; the arguments are those of `map_survey`."""
    hint = "a path is no name" if name else OF_THE_SURVEY
    name = name or f"{Path(survey).resolve().name}-{Path(bundle).resolve().name}"
    check_name("name", name, hint=hint)
    return Path(runs) / "maps" / name


def seeking(scorer: Scorer, sign: str | None) -> Scorer:
    """Return a scorer whose localizer seeks echoes of this sign; None leaves it."""
    if sign is None:
        return scorer
    allowed = "must be null"
    hint = f"{scorer.bundle.about['name']} judges walls, of whose echoes it sums positive ones"
    check(scorer.bundle.hypotheses is None, "localizer.sign", sign, allowed=allowed, hint=hint)
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


@dataclass(frozen=True)
class _Order:
    """What is mapped, by what, and into which files.

    Attributes:
        scorer: a bundle at work.
        walk: recorded as the bundle wants it.
        asked: keys of the command that make another map, None where a key was not given.
        writers: modules that write the files.
    """

    scorer: Scorer
    walk: Survey
    asked: Mapping[str, Any]
    writers: Sequence[Any]

    @cached_property
    def inputs(self) -> dict[str, Any]:
        """What the map is made from, as it was when first asked."""
        return self.identity()

    @cached_property
    def sound(self) -> tuple[Health, Survey]:
        """What the recordings say about themselves, and the walk, mended."""
        health = examine(self.walk)
        return health, mended(self.walk, health)

    @cached_property
    def domain(self) -> str:
        """What there is to say of the recordings beside those that the bundle knows."""
        return domain_line(self.scorer.bundle, self.sound[1])

    def run(self, folder: Path, command: str | None) -> None:
        """Make the map unless it is there, and print what it is worth."""
        finished = partial(finished_map, folder, self.inputs)
        self.tell_domain(finished())
        make = partial(self.make, folder, command=command)
        report(once(folder, finished=finished, make=make, doing="writes it"))

    def tell_domain(self, known: Mapping[str, Any] | None) -> None:
        """Say, before a point is drawn, whether the filter knows such recordings.

        What the manifest of a finished map says holds.
        """
        told = self.domain if known is None else known.get("domain", UNCHECKED)
        print(f"domain: {told}", flush=True)

    def identity(self) -> dict[str, Any]:
        """Return what the map is made from: the bundle, all files of the survey, what was asked."""
        sums = hashlib.sha256()
        for name in used(self.walk):
            path = self.walk.folder / name
            check_size(path, LARGEST)
            # What is missing is named when it is read.
            if path.is_file():
                sums.update(f"{name} {sha256(path)}\n".encode())
        # What was not asked for is not named, so that maps of before keep their identity.
        given = {key: value for key, value in self.asked.items() if value is not None}
        if self.walk.gains is not None:
            given["gains"] = self.walk.gains.tolist()
        # Maps of such arrays had one point an echo before, on either side.
        if self.walk.mapped and mirror_azimuth(self.walk.array) is not None:
            given["mirror_images"] = True
        return given | {"bundle": self.scorer.bundle.about["sha256"], "survey": sums.hexdigest()}

    def make(self, folder: Path, *, command: str | None) -> dict[str, Any]:
        """Write the map, and return its manifest."""
        health, walk = self.sound
        map_by = score_survey if self.scorer.bundle.hypotheses is None else score_walls
        mapped = map_by(self.scorer, walk, resolution=self.asked["resolution"])
        # Times and directions alone are a table.
        writers = self.writers if walk.mapped else [table]
        files = {key: value for each in writers for key, value in each.write(mapped).items()}
        why = causes(mapped, health, window=self.scorer.bundle.localizer.window)
        about = describe_map(mapped, why) | told(health) | judged(mapped, walk)

        hint = "is it still being recorded? map it again when it is complete"
        allowed = "must not change while it is mapped"
        same = self.identity() == self.inputs
        check(same, "survey", self.walk.folder, allowed=allowed, hint=hint)
        if self.scorer.bundle.reference is not None:
            about["domain"] = self.domain
        about |= {"inputs": self.inputs} | manifests.command_entry(command)
        return write_map(folder, files, about=about)


def score_survey(scorer: Scorer, walk: Survey, *, resolution: float = 0.05) -> MappedWalk:
    """Score every recording of a survey, block by block.

    Args:
        scorer: a bundle at work.
        walk: recorded as the bundle wants it.
        resolution: side of a cell of the occupancy grid, in m.

    Raises:
        BadValue: a recording that cannot be analysed; names its file.
    """

    def score(block: Sequence[int]) -> ScoredEchoes:
        """Score the recordings of some poses."""
        return scorer.score(walk.observe(block), [walk.poses[pose] for pose in block])

    scored = block_by_block(walk, score)
    mapped = mapped_walk(
        walk,
        concatenated([each.echoes for each in scored]),
        found=concatenated([each.map for each in scored]),
        azimuths=scorer.bundle.localizer.azimuths,
        resolution=resolution,
    )
    return with_mirror_images(mapped, walk.array, speed_of_sound=walk.speed_of_sound)
