"""Surveys of walks past walls made by hand: bursts from mirror images in white noise, no more."""

from pathlib import Path

import numpy as np

from echolearn.acoustics.types import MicArray, Pose, Probe
from echolearn.survey.audio import wav_bytes
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv
from heard_walks import wandering

SPEED = 343.0
LENGTH = 2200
"""Samples of a recording: the burst of the bundle, and 700 more, by which walls of 2 m are back."""

BOX = np.array([[-1.4, -1.3], [5.4, -1.3], [5.4, 4.3], [-1.4, 4.3]])
"""Corners of the room, in m; the robot keeps to a rectangle of 4 m x 3 m in it."""


def write_walk(
    folder: Path,
    probe: Probe,
    array: MicArray,
    *,
    poses: int = 48,
    amplitude: float = 0.16,
    walls: bool = True,
    seed: int = 0,
) -> Path:
    """Write a walk through the box, white noise of variance 1 in every recording; return it.

    Args:
        folder: of the survey.
        probe: the burst, of root mean square 1 at best.
        array: the microphones.
        poses: number of places, anywhere.
        amplitude: of an echo.
        walls: whether `survey.yaml` tells them.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    places = wandering(poses, seed=seed + 1)
    (folder / "observations").mkdir(parents=True)
    probe = Probe(probe.samples, probe.sample_rate, LENGTH)
    sides = np.stack([BOX, np.roll(BOX, -1, axis=0)], axis=1)
    about = description_bytes(
        array, probe, speed_of_sound=SPEED, walls=sides if walls else None, conditions={}
    )
    (folder / "survey.yaml").write_bytes(about)
    silence = LENGTH - len(probe.samples)
    rate = probe.sample_rate
    (folder / "probe.wav").write_bytes(wav_bytes(np.pad(probe.samples, (0, silence)), rate))
    names = [f"observations/{number}.wav" for number in range(poses)]
    stood = [Pose(np.array([x, y, 1.5]), heading) for x, y, heading in places]
    (folder / "poses.csv").write_bytes(poses_csv(stood, names))
    spectrum = np.fft.rfft(probe.samples, 2 * LENGTH)
    for name, pose in zip(names, stood, strict=True):
        samples = rng.standard_normal((len(array), LENGTH))
        for arrived in arrivals(pose, array):
            turn = -2j * np.pi * np.fft.rfftfreq(2 * LENGTH) * arrived[:, None] * rate
            echo = np.fft.irfft(spectrum * np.exp(turn))[:, :LENGTH]
            samples += amplitude * echo
        (folder / name).write_bytes(wav_bytes(samples.astype(np.float32), rate))
    return folder


def arrivals(pose: Pose, array: MicArray) -> list[np.ndarray]:
    """Return when each microphone hears each wall of the box, (M,) a wall, in s."""
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    turned = array.positions @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    found = []
    for start, end in zip(BOX, np.roll(BOX, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        normal = np.array([along[1], -along[0]])
        away = normal @ (start - pose.position[:2])
        image = np.append(2.0 * away * normal, 0.0)
        found.append(np.linalg.norm(image - turned, axis=1) / SPEED)
    return found
