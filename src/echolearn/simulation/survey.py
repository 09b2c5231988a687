"""Simulate a robot's walk through a room and store it in the recorded-survey format.

    room --trajectory--> poses --observe--> recordings and what describes them --> manifest

The format is that of `survey.reader`. Beside it stands `simulated.json`, what the survey is made
from: by it a survey is known as ours, and the same command finds it finished, or goes on where
another was killed (`storage.journal`).
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import check_inside, outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import check, check_name, check_number, check_whole
from echolearn.runtime.progress import track
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import noise_alone, observe
from echolearn.simulation.realism import Realism
from echolearn.simulation.scene import Scene, noise_kind
from echolearn.simulation.walk import trajectory
from echolearn.storage import journal
from echolearn.storage.identity import plain
from echolearn.survey import audio
from echolearn.survey.description import description_bytes
from echolearn.survey.making import made_once
from echolearn.survey.poses import poses_csv
from echolearn.survey.survey import NOISE

BEGUN = "simulated.json"
"""Written first: what the survey is made from, and the sign that its recordings are simulated."""

MOST = 20_000
"""Poses; a manifest, which may have `manifests.FOREIGN` bytes, has 370 for each."""

NOISE_SECONDS = 5.0
"""Length of the noise alone where it is not white, unless something else is asked for."""


def survey(
    *,
    name: str,
    room: AnyRoom,
    scene: Scene,
    levels: NoiseLevels,
    poses: int = 160,
    start: float = 0.6,
    seed: int = 0,
    noise_seconds: float | None = None,
    realism: Realism | None = None,
    runs: Path,
    command: str | None = None,
) -> Path:
    """Walk through a room, record at every pose, and return the folder; once made, it is kept.

    Args:
        name: names the folder under `runs/survey`.
        room: the room.
        scene: what the robot carries.
        levels: levels of the noises in every recording, and how many are averaged at each pose.
        poses: number P of poses.
        start: polar angle at which the walk begins, in rad.
        seed: of the noise; pose p draws from `SeedSequence(seed, spawn_key=(p,))`.
        noise_seconds: length of `noise.wav`, the noise alone at the first pose, as loud as what is
            left in a mean of several pings; 0 for none; None for 5 s of noise that is not white.
        realism: ranges of what is not ideal: the robot is drawn once, walls and clutter anew at
            every pose; None is a clean world.
        runs: folder of everything generated.
        command: what makes the survey again, for the manifest; None says nothing about it.

    Raises:
        BadValue: values out of range, or a survey of that name made otherwise.
    """
    check_name("name", name)
    check_whole("seed", seed, low=0)
    levels.check_scene(scene)
    seconds = noise_length(scene, noise_seconds)
    walk = _walk(room, scene, poses=poses, start=start)
    origin = {"room": room, "scene": scene, "walk": walk, "seed": seed} | _given(levels)
    alone = {"noise_seconds": seconds} if seconds else {}
    realism = realism or Realism()
    realism.check_scene(scene)
    flawed = {} if realism.clean else {"realism": realism}
    about = {"kind": "survey", "made_from": plain(origin | alone | flawed)}
    record = partial(_record, room, walk, scene=scene, levels=levels, seed=seed)
    record = partial(record, seconds=seconds, realism=realism)
    folder = Path(runs) / "survey" / name
    return made_once(folder, about, begun=BEGUN, contents=record, command=command)


def _walk(room: AnyRoom, scene: Scene, *, poses: int, start: float) -> list[Pose]:
    """Return the poses, and refuse those outside before the long work begins.

    Raises:
        BadValue: recordings that nobody could read, too, since they are too long.
    """
    most = audio.longest(len(scene.array))
    hint = f"of {len(scene.array)} microphones, a file has at most {audio.LARGEST >> 20} MiB"
    check_whole("scene.probe.length", scene.probe.length, low=1, high=most, hint=hint)
    check_whole("poses", poses, low=2, high=MOST, hint="longer walks are several surveys")
    walk = trajectory(room, poses=poses, start=start)
    for pose in walk:
        check_inside(room, pose, array=scene.array)
    return walk


def noise_length(scene: Scene, seconds: float | None) -> float:
    """Return the length of `noise.wav` in s, 0 for none.

    Raises:
        BadValue: a file of that length would not be read: it is too large, or shorter than a
            recording.
    """
    if seconds is None:
        seconds = 0.0 if scene.diffuse is None and isinstance(scene.noise, White) else NOISE_SECONDS
    check_number("noise_seconds", seconds, low=0.0, high=600.0, unit="s")
    if seconds == 0:
        return 0.0

    rate = scene.probe.sample_rate
    channels = len(scene.array)
    least = max(0.1, scene.probe.length / rate)
    most = max(least, audio.longest(channels) / rate)
    bounds = f"{math.ceil(least * 100) / 100:g} to {math.floor(most * 10) / 10:g} s"
    check(
        least <= seconds <= most,
        "noise_seconds",
        f"{seconds:g} s",
        allowed=f"must be 0 (none), or from {bounds} of {channels} microphones",
        hint=f"{NOISE} is as long as a recording, and has at most {audio.LARGEST >> 20} MiB",
    )
    return float(seconds)


def _given(levels: NoiseLevels) -> dict[str, Any]:
    """Return the levels that are given; a single ping goes without saying."""
    given = {"snr_db": levels.snr_db, "sdnr_db": levels.sdnr_db}
    several = {"pings": int(levels.pings)} if levels.pings > 1 else {}
    return {key: float(level) for key, level in given.items() if level is not None} | several


def _told(room: AnyRoom) -> list[float] | str:
    """Return what the conditions say of a room: the sides of a box, or the size in words."""
    return list(room.size) if isinstance(room, Room) else room.dimensions


def _record(
    room: AnyRoom,
    walk: Sequence[Pose],
    *,
    scene: Scene,
    levels: NoiseLevels,
    seed: int,
    seconds: float,
    realism: Realism,
) -> Iterator[journal.Content]:
    """Yield the files of a survey one after the other, each as its name and what makes it."""
    probe = scene.probe

    def real(index: int) -> tuple[Scene, dict[str, float]]:
        """Return the scene of a pose, and what was drawn for it."""
        rng = stream(seed, "realism", index)
        return realistic(scene, realism, rng=rng, robot=stream(seed, "realism", 0))

    def alone() -> bytes:
        """Return the noise alone at the first pose, as a file."""
        rng = stream(seed, "noise alone", 0)
        there, drawn = real(0)
        noise = noise_alone(room, walk[0], scene=there, seconds=seconds, levels=levels, rng=rng)
        noise = noise * 10.0 ** (drawn.get("gain_db", 0.0) / 20.0)
        return audio.wav_bytes(noise, probe.sample_rate)

    def recording(index: int, pose: Pose) -> bytes:
        """Return what is recorded at a pose, as a file."""
        rng = stream(seed, "observation", index)
        there, drawn = real(index)
        gain_db = drawn.get("gain_db", 0.0)
        observation, _ = observe(room, pose, scene=there, levels=levels, rng=rng, gain_db=gain_db)
        return audio.wav_bytes(observation.samples, probe.sample_rate)

    if seconds:
        yield NOISE, alone
    names = []
    for index, pose in enumerate(track(walk, "survey", unit="poses")):
        names.append(f"observations/{index:04d}.wav")
        yield names[-1], partial(recording, index, pose)
    yield "poses.csv", partial(poses_csv, walk, names)

    padded = np.pad(probe.samples, (0, probe.length - len(probe.samples)))
    yield "probe.wav", partial(audio.wav_bytes, padded, probe.sample_rate)
    yield "survey.yaml", partial(_description, room, scene, levels=levels)


def _description(room: AnyRoom, scene: Scene, *, levels: NoiseLevels) -> bytes:
    """Return `survey.yaml` of a walk in a room."""
    noise = noise_kind(plain(scene), sensor=levels.snr_db is not None)
    return description_bytes(
        scene.array,
        scene.probe,
        speed_of_sound=scene.speed_of_sound,
        walls=outline(room),
        conditions={**_given(levels), "noise": noise, "room": _told(room), "t60": room.t60},
    )
