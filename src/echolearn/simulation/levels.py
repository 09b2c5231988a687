"""Noises at their levels, and what averaging several pings leaves of them.

The signal-to-noise ratio (SNR) is that of the *received* probe x_m, direct path included, over all
N samples, against the sensor noise f2_m at the same microphone. The signal-to-diffuse-noise ratio
(SDNR) is the same against the diffuse noise f1 at microphone 1; the field keeps its proportions at
the others. Either noise may be absent.

Several pings at a pose are averaged sample by sample, (1/K) sum_k y_k: the echoes stay what they
are, while noises that are independent from ping to ping keep 1/K of their power, 3 dB less for each
doubling of K. Levels are those of one ping. The mean of K independent draws of N(0, v) is
N(0, v / K), and draws that are independent over time and microphones have independent means: for
Gaussian noise that is independent from ping to ping one draw of 1/K the power *is* the mean of K in
distribution, and it is what is drawn.
Of any other noise K are drawn, each at its level.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, MicArray, Noise
from echolearn.checks import check, check_number, check_whole
from echolearn.simulation.noise.coloured import Coloured
from echolearn.simulation.noise.white import White
from echolearn.simulation.scene import Scene


@dataclass(frozen=True)
class NoiseLevels:
    """How loud the noises are in one recording, and how many recordings are averaged.

    Attributes:
        snr_db: level of the received probe over the sensor noise at each microphone, in dB; None
            where there is no such noise.
        sdnr_db: level of the received probe over the diffuse noise at microphone 1, in dB; None
            where there is no such noise.
        pings: number K of recordings that are averaged; the levels are those of one.
    """

    snr_db: float | None
    sdnr_db: float | None = None
    pings: int = 1

    def __post_init__(self) -> None:
        for name, level in (("snr_db", self.snr_db), ("sdnr_db", self.sdnr_db)):
            if level is not None:
                check_number(name, level, low=-100.0, high=100.0, unit="dB")
        check_whole("pings", self.pings, low=1, high=100_000, hint="1 is a single recording")

    def check_scene(self, scene: Scene) -> None:
        """Raise `BadValue` unless each noise of a scene has a level, and each level its noise."""
        if scene.diffuse is None:
            quiet = self.sdnr_db is None
            hint = "choose diffuse=rotor"
            allowed = "must be null in a scene without diffuse noise"
            check(quiet, "sdnr_db", f"{self.sdnr_db} dB", allowed=allowed, hint=hint)
            allowed = "must be a level in dB where there is no other noise"
            check(self.snr_db is not None, "snr_db", None, allowed=allowed)
        else:
            allowed = "must be a level in dB, as the scene has diffuse noise"
            check(self.sdnr_db is not None, "sdnr_db", None, allowed=allowed)


def noises(
    received: Array,
    scene: Scene,
    *,
    length: int,
    levels: NoiseLevels,
    rng: np.random.Generator,
) -> Array:
    """Return the noises at their levels, f1 + f2, averaged over pings, shape (M, length).

    Args:
        received: probe as received, which the levels refer to, shape (M, N).
        scene: gives the noises.
        length: samples wanted.
        levels: levels of the noises, and how many pings are averaged.
        rng: draws the sensor noise, then the diffuse noise.

    Raises:
        BadValue: a noise without a level, or a level without its noise.
    """
    levels.check_scene(scene)
    strength = signals.power(received)
    draw: dict[str, Any] = {"length": length, "sample_rate": scene.probe.sample_rate, "rng": rng}

    # The sensor noise comes first, so that a diffuse field beside it changes none of its samples.
    if levels.snr_db is not None:
        amplitude = np.sqrt(strength * 10.0 ** (-levels.snr_db / 10.0))
        total = _mean(scene.noise, scene.array, pings=levels.pings, **draw)
        total *= amplitude[:, None]
    else:
        total = np.zeros((len(scene.array), length))

    # One factor for all microphones: a level for each would destroy the proportions of the field.
    if scene.diffuse is not None and levels.sdnr_db is not None:
        for _ in range(levels.pings):
            field = scene.diffuse(scene.array, **draw)
            ratio = strength[0] / signals.power(field[0])
            total += np.sqrt(ratio * 10.0 ** (-levels.sdnr_db / 10.0)) * field / levels.pings
    return total


def _mean(noise: Noise, array: MicArray, *, pings: int, **draw: Any) -> Array:
    """Return the mean of independent draws of a noise, one for each ping, shape (M, N)."""
    # Gaussian noise has a mean that can be drawn at once: the header.
    if isinstance(noise, White | Coloured):
        mean = noise(array, **draw)
        return mean if pings == 1 else mean / np.sqrt(pings)
    return sum((noise(array, **draw) for _ in range(pings)), start=np.zeros(())) / pings
