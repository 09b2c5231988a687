"""Simulate what the robot hears: room + pose + noise -> Observation and Truth.

    y_m = gain (x_m - direct_m + f1_m + f2_m),      x_m = h_m * s  (Eq. 1)

The signal-to-noise ratio (SNR) is that of the *received* probe x_m, direct path included, over all N samples,
against the sensor noise f2_m at the same microphone. The signal-to-diffuse-noise ratio (SDNR) is the same against the
diffuse noise f1 at microphone 1; the field keeps its proportions at the others. Either noise may be absent. Then the
direct path is removed by subtracting the anechoic response, which the known geometry of the array gives exactly.

Several pings at a pose are averaged sample by sample, (1/K) sum_k y_k: the echoes stay what they are, while noises that
are independent from ping to ping keep 1/K of their power, 3 dB less for each doubling of K. Levels are those of one
ping. The mean of K independent draws of N(0, v) is N(0, v / K), and draws that are independent over time and
microphones have independent means: for white noise one draw of 1/K the power *is* the mean of K in distribution, and it
is what is drawn. Of any other noise K are drawn, each at its level.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from echolearn import signals
from echolearn.geometry import check_inside, microphone_positions, true_echoes
from echolearn.noise.white import White
from echolearn.types import (
    LATER,
    SPEED_OF_SOUND,
    Array,
    MicArray,
    Noise,
    Observation,
    Pose,
    Probe,
    Responder,
    Room,
    Truth,
    check,
    check_number,
    check_whole,
)

NOISE_SECONDS = 4.0
"""Length of a recording of the noise alone, where no other is asked for."""


@dataclass(frozen=True)
class Scene:
    """What every observation of a robot shares.

    Attributes:
        array: microphones around the loudspeaker.
        probe: the known burst.
        rir: engine for room impulse responses.
        noise: of each microphone for itself, at the SNR (f2).
        speed_of_sound: in m/s.
        diffuse: a field of noise around the array, at the SDNR (f1), or None.
    """

    array: MicArray
    probe: Probe
    rir: Responder
    noise: Noise
    speed_of_sound: float = SPEED_OF_SOUND
    diffuse: Noise | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        hint = "air is 343 m/s"
        check_number("scene.speed_of_sound", self.speed_of_sound, low=100.0, high=2000.0, unit="m/s", hint=hint)

    @cached_property
    def direct(self) -> Array:
        """Direct path at the microphones, shape (M, N): the same at every pose."""
        hall = Room((20.0, 20.0, 20.0), 1.0)
        return self.received(replace(hall, walls=(0.0,) * 6), Pose(np.array([10.0, 10.0, 10.0])))

    def received(self, room: Room, pose: Pose) -> Array:
        """Return the probe as received, x_m of Eq. 1, without noise, shape (M, N)."""
        response = self.rir(
            room,
            np.asarray(pose.position, dtype=float),
            microphone_positions(self.array, pose),
            sample_rate=self.probe.sample_rate,
            speed_of_sound=self.speed_of_sound,
        )
        return signals.convolve(self.probe.samples, response, self.probe.length)


def check_levels(scene: Scene, *, snr_db: object, sdnr_db: object, name: str = "") -> None:
    """Raise `BadValue` unless there is a level for diffuse noise where there is such noise, and one for any noise.

    Args:
        scene: tells whether there is diffuse noise.
        snr_db, sdnr_db: levels in whatever form; None is a noise that is absent.
        name: what the two belong to, "plan." for example.
    """
    hint = "choose diffuse=rotor" if scene.diffuse is None else f"give {name}sdnr_db"
    have = "diffuse noise" if scene.diffuse is not None else "no diffuse noise"
    fits = (sdnr_db is None) == (scene.diffuse is None)
    check(fits, f"{name}sdnr_db", f"{sdnr_db} dB", allowed=f"the scene has {have}", hint=hint)
    check(not snr_db is sdnr_db is None, f"{name}snr_db", "None", allowed="a level in dB where there is no other noise")


def noises(
    received: Array,
    scene: Scene,
    *,
    length: int,
    snr_db: float | None,
    sdnr_db: float | None,
    rng: np.random.Generator,
    pings: int = 1,
) -> Array:
    """Return the noises at their levels, f1 + f2, averaged over pings, shape (M, length).

    Args:
        received: probe as received, which the levels refer to, shape (M, N).
        scene: gives the noises.
        length: samples wanted.
        snr_db: received probe over sensor noise at each microphone, or None for no such noise.
        sdnr_db: received probe over diffuse noise, at microphone 1 exactly, or None.
        rng: draws the sensor noise, then the diffuse noise.
        pings: K, how many recordings are averaged.
    """
    check_levels(scene, snr_db=snr_db, sdnr_db=sdnr_db)
    check_pings(pings)
    strength = signals.power(received)
    draw: dict[str, Any] = {"length": length, "sample_rate": scene.probe.sample_rate, "rng": rng}
    total = np.zeros((len(scene.array), length))
    if snr_db is not None:
        level = np.sqrt(strength * 10.0 ** (-snr_db / 10.0))
        total += level[:, None] * _mean(scene.noise, scene.array, pings=pings, **draw)
    if scene.diffuse is not None and sdnr_db is not None:
        for _ in range(pings):
            around = scene.diffuse(scene.array, **draw)
            total += np.sqrt(strength[0] / signals.power(around[0]) * 10.0 ** (-sdnr_db / 10.0)) * around / pings
    return total


def check_pings(pings: object, name: str = "pings") -> None:
    """Raise `BadValue` unless `pings` is a number of recordings to average."""
    check_whole(name, pings, low=1, high=100_000, hint="1 is a single recording")


def _mean(noise: Noise, array: MicArray, *, pings: int, **draw: Any) -> Array:
    """Return the mean of `pings` independent draws of a noise, shape (M, N); for white noise see the header."""
    if isinstance(noise, White):
        return noise(array, **draw) / np.sqrt(pings)
    return sum((noise(array, **draw) for _ in range(pings)), start=np.zeros(())) / pings


def add_noise(
    received: Array,
    scene: Scene,
    *,
    snr_db: float | None,
    gain_db: float,
    rng: np.random.Generator,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> Array:
    """Remove the direct path from `received` (M, N), add noise at its levels, apply a recording gain.

    Args:
        received: probe as received, direct path included, shape (M, N).
        scene: gives the direct path and the noise.
        snr_db: received probe over sensor noise, per microphone, or None for no such noise.
        gain_db: gain of the recording, signal and noise alike.
        rng: draws the noise.
        sdnr_db: received probe over diffuse noise at microphone 1, or None for no such noise.
        pings: K, how many recordings are averaged; the levels are those of one.
    """
    levels = {"snr_db": snr_db, "sdnr_db": sdnr_db}
    noise = noises(received, scene, length=scene.probe.length, rng=rng, pings=pings, **levels)
    return 10.0 ** (gain_db / 20.0) * (received - scene.direct + noise)


def noise_alone(
    room: Room,
    pose: Pose,
    scene: Scene,
    *,
    seconds: float,
    snr_db: float | None,
    rng: np.random.Generator,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> Array:
    """Record the noise while the loudspeaker is silent: what an estimator may learn the noise's spectrum from.

    Args:
        room, pose: where; the levels are those that `observe` would have there.
        scene: what the robot carries.
        seconds: length of the recording.
        snr_db, sdnr_db: see the module's header.
        rng: draws the noise; one that has not drawn an observation, or the two are not independent.
        pings: K, how many recordings are averaged in the observations. One stretch is recorded and divided by sqrt(K),
            so that its density is that of the noise which is left in their mean.

    Returns:
        Samples, shape (M, round(seconds * sample_rate)).
    """
    check_number("noise_seconds", seconds, low=0.1, high=600.0, unit="s")
    check_inside(room, scene.array, pose)
    length = round(seconds * scene.probe.sample_rate)
    check_pings(pings)
    heard = noises(scene.received(room, pose), scene, length=length, snr_db=snr_db, sdnr_db=sdnr_db, rng=rng)
    return heard / np.sqrt(pings)


def observe(
    room: Room,
    pose: Pose,
    scene: Scene,
    *,
    snr_db: float | None,
    rng: np.random.Generator,
    gain_db: float = 0.0,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> tuple[Observation, Truth]:
    """Simulate one observation.

    Args:
        room: a shoebox.
        pose: the whole array must lie inside the room.
        scene: what the robot carries, engine and noise.
        snr_db: of the sensor noise, see the module's header; None is no such noise.
        rng: draws the noise.
        gain_db: gain of the recording.
        sdnr_db: of the diffuse noise; None is no such noise.
        pings: K, how many recordings are averaged at the pose; the levels are those of one.

    Returns:
        The observation, samples (M, N) with the direct path removed, and the truth.

    Raises:
        BadValue: a microphone outside the room.
    """
    check_inside(room, scene.array, pose)
    received = scene.received(room, pose)
    samples = add_noise(received, scene, snr_db=snr_db, gain_db=gain_db, rng=rng, sdnr_db=sdnr_db, pings=pings)
    truth = true_echoes(room, pose, scene.array, scene.speed_of_sound)
    return Observation(samples, scene.probe, scene.array, scene.speed_of_sound), truth
