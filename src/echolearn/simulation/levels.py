"""Noises at their levels, and what averaging several pings leaves of them.

The signal-to-noise ratio (SNR) is that of the *received* probe x_m, direct path included, over all
N samples, against the sensor noise f2_m at the same microphone. The signal-to-diffuse-noise ratio
(SDNR) is the same against the diffuse noise f1 at microphone 1; the field keeps its proportions at
the others. Either noise may be absent.

Several pings at a pose are averaged sample by sample, (1/K) sum_k y_k: the echoes stay what they
are, while noises that are independent from ping to ping keep 1/K of their power, 3 dB less for each
doubling of K. Levels are those of one ping. The mean of K independent draws of N(0, v) is N(0, v /
K), and draws that are independent over time and
microphones have independent means: for white noise one draw of 1/K the power *is* the mean of K in
    distribution, and it
is what is drawn. Of any other noise K are drawn, each at its level.
"""

from typing import Any

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.types import (
    Array,
    MicArray,
    Noise,
)
from echolearn.checks import check, check_whole
from echolearn.simulation.noise.white import White
from echolearn.simulation.scene import Scene


def check_levels(scene: Scene, *, snr_db: object, sdnr_db: object, name: str = "") -> None:
    """Raise `BadValue` unless there is a level for diffuse noise where there is such noise, and one
    for any noise.

    Args:
        scene: tells whether there is diffuse noise.
        snr_db, sdnr_db: levels in whatever form; None is a noise that is absent.
        name: what the two belong to, "plan." for example.
    """
    hint = "choose diffuse=rotor" if scene.diffuse is None else f"give {name}sdnr_db"
    have = "diffuse noise" if scene.diffuse is not None else "no diffuse noise"
    fits = (sdnr_db is None) == (scene.diffuse is None)
    check(fits, f"{name}sdnr_db", f"{sdnr_db} dB", allowed=f"the scene has {have}", hint=hint)
    check(
        not snr_db is sdnr_db is None,
        f"{name}snr_db",
        "None",
        allowed="a level in dB where there is no other noise",
    )


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
            total += (
                np.sqrt(strength[0] / signals.power(around[0]) * 10.0 ** (-sdnr_db / 10.0))
                * around
                / pings
            )
    return total


def check_pings(pings: object, name: str = "pings") -> None:
    """Raise `BadValue` unless `pings` is a number of recordings to average."""
    check_whole(name, pings, low=1, high=100_000, hint="1 is a single recording")


def _mean(noise: Noise, array: MicArray, *, pings: int, **draw: Any) -> Array:
    """Return the mean of `pings` independent draws of a noise, shape (M, N); for white noise see
    the header.
    """
    if isinstance(noise, White):
        return noise(array, **draw) / np.sqrt(pings)
    return sum((noise(array, **draw) for _ in range(pings)), start=np.zeros(())) / pings
