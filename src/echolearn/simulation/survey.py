"""Simulate a robot's walk through a room and store it in the recorded-survey format
(`recording.py`).
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import check_inside, outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import BadValue, check, check_name, check_number, check_whole
from echolearn.runtime.progress import track
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import noise_alone, observe
from echolearn.simulation.scene import Scene, noise_kind
from echolearn.simulation.walk import trajectory
from echolearn.storage import files as disk
from echolearn.storage import manifests
from echolearn.storage.identity import plain
from echolearn.storage.once import locked
from echolearn.survey import audio, reader
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv

BEGUN = "simulated.json"
"""Written first: what the survey is made from, and the sign that its recordings are nobody's but
ours."""

MOST = 20_000
"""Poses; a manifest, which may have `store.FOREIGN` bytes, has 370 for each."""

NOISE_SECONDS = 5.0
"""How long noise that is not white is recorded alone, unless something else is asked for."""


def survey(
    *,
    name: str,
    room: Room,
    scene: Scene,
    levels: NoiseLevels,
    poses: int = 160,
    start: float = 0.6,
    seed: int = 0,
    noise_seconds: float | None = None,
    runs: Path,
    command: str | None = None,
) -> Path:
    """Walk through a room, listen at every pose, store the recordings; a finished survey is
    skipped.

    Args:
        name: names the folder under `runs/survey`.
        room: the room.
        scene: what the robot carries.
        levels: levels of the noises in every recording, and how many are averaged at each pose;
            `noise.wav` has the level of the noise in the mean.
        poses: P.
        start: polar angle at which the walk begins, in rad.
        seed: of the noise; pose p draws from `SeedSequence(seed, spawn_key=(p,))`.
        noise_seconds: of `noise.wav`, the noise alone at the first pose; 0 for none; None for 5 s
            of noise that is not white.
        runs: folder of everything generated.
        command: what makes the survey again, for the manifest; None says nothing about it.

    Returns:
        The survey's folder, complete.

    Raises:
        BadValue: values out of range, or a survey of that name made otherwise.
    """
    check_name("name", name)
    levels.check_scene(scene)
    seconds = noise_length(scene, noise_seconds)
    check_whole("seed", seed, low=0)
    walk = trajectory(room, poses=poses, start=start)
    check(
        len(walk) <= MOST, "poses", poses, allowed=f"at most {MOST}", hint="walk in several surveys"
    )
    for pose in walk:
        check_inside(room, pose, array=scene.array)
    folder = Path(runs) / "survey" / name
    told = _told(levels, noise_seconds=seconds or None)
    about = {
        "kind": "survey",
        "made_from": plain({"room": room, "scene": scene, "walk": walk, "seed": seed, **told}),
    }
    if _is_finished(folder, about):
        return folder
    alone = _noise(room, walk[0], scene, seconds=seconds, seed=seed, levels=levels)
    with locked(folder, waiting=f"survey {name}: waiting for another command that walks it"):
        if not _is_finished(folder, about):
            disk.clean(folder)
            disk.save_json(folder / BEGUN, about)
            if alone is not None:
                disk.write_atomic(
                    folder / reader.NOISE, audio.wav_bytes(alone, scene.probe.sample_rate)
                )
            _write(folder, walk, room=room, scene=scene, seed=seed, levels=levels)
            noise = [] if alone is None else [reader.NOISE]
            files = [BEGUN, "survey.yaml", "probe.wav", "poses.csv", *noise, *_names(walk)]
            manifests.finish(
                folder, about | manifests.command_entry(command), files, largest=manifests.FOREIGN
            )
    return folder


def _noise(
    room: Room,
    pose: Pose,
    scene: Scene,
    *,
    seconds: float,
    seed: int,
    levels: NoiseLevels,
) -> Array | None:
    """Return the noise alone, or None for no second of it; what cannot be simulated is refused."""
    rng = stream(seed, "noise alone", 0)
    if seconds:
        return noise_alone(room, pose, scene=scene, seconds=seconds, levels=levels, rng=rng)
    observe(room, pose, scene=scene, levels=levels, rng=rng)
    return None


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
    rate, channels = scene.probe.sample_rate, len(scene.array)
    least = max(0.1, scene.probe.length / rate)
    most = max(least, audio.longest(channels) / rate)
    allowed = f"0, or {math.ceil(least * 100) / 100:g} to {math.floor(most * 10) / 10:g} s of {channels} microphones"
    hint = f"{reader.NOISE} is as long as a recording, and has at most {audio.LARGEST >> 20} MiB"
    check(least <= seconds <= most, "noise_seconds", f"{seconds:g} s", allowed=allowed, hint=hint)
    return float(seconds)


def _told(levels: NoiseLevels, **others: float | None) -> dict[str, Any]:
    """Return what is given of a survey's numbers; a single ping goes without saying, as it always
    has.
    """
    values = {"snr_db": levels.snr_db, "sdnr_db": levels.sdnr_db} | others
    told: dict[str, Any] = {key: float(value) for key, value in values.items() if value is not None}
    return told | ({"pings": int(levels.pings)} if levels.pings > 1 else {})


def _names(walk: list[Pose]) -> list[str]:
    return [f"observations/{index:04d}.wav" for index in range(len(walk))]


def _is_finished(folder: Path, about: dict[str, object]) -> bool:
    """Tell whether the survey stands there whole; one made otherwise is refused, a damaged one is
    made again.
    """
    foreign = folder.is_dir() and any(folder.glob("[!.]*")) and not (folder / BEGUN).is_file()
    hint = f"{folder} holds recordings of another origin"
    check(
        not foreign,
        "name",
        folder.name,
        allowed="a new name, or that of a simulated survey",
        hint=hint,
    )
    try:
        manifest = manifests.load_manifest(folder)
    except BadValue:
        return False
    same = all(manifest.get(key) == value for key, value in about.items())
    allowed, hint = (
        "the name of a survey made with the same settings, or a new one",
        f"{folder} was made with others",
    )
    check(same, "name", folder.name, allowed=allowed, hint=hint)
    try:
        manifests.verify(folder)
    except BadValue:
        return False
    return True


def _write(
    folder: Path,
    walk: list[Pose],
    *,
    room: Room,
    scene: Scene,
    seed: int,
    levels: NoiseLevels,
) -> None:
    """Write the recordings and what describes them."""
    names, told = _names(walk), _told(levels)
    for index, pose in enumerate(track(walk, f"survey {folder.name}", unit="poses")):
        rng = stream(seed, "observation", index)
        observation, _ = observe(room, pose, scene=scene, levels=levels, rng=rng)
        disk.write_atomic(
            folder / names[index], audio.wav_bytes(observation.samples, scene.probe.sample_rate)
        )
    padded = np.pad(scene.probe.samples, (0, scene.probe.length - len(scene.probe.samples)))
    disk.write_atomic(folder / "probe.wav", audio.wav_bytes(padded, scene.probe.sample_rate))
    disk.write_atomic(folder / "poses.csv", poses_csv(walk, names))
    noise = noise_kind(plain(scene), sensor="snr_db" in told)
    conditions = {**told, "noise": noise, "room": list(room.size), "t60": room.t60}
    about = description_bytes(
        scene.array,
        scene.probe,
        speed_of_sound=scene.speed_of_sound,
        walls=outline(room),
        conditions=conditions,
    )
    disk.write_atomic(folder / "survey.yaml", about)
