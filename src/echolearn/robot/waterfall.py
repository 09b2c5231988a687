"""The waterfall: what the matched filter hears along a walk, lags against poses.

A wall is a bright line that bends as the robot drives; what is late, lost or the wrong way round
breaks the lines. The image of a microphone is |r_m(tau)|; that of the array is the largest |J(tau,
phi)| over directions, what the microphones hear together (`localization.correlations`). Before the
search window both are of the recording, and the array listens to its own loudspeaker; in it they
are of what `map` hears: without the direct path, whose side lobes are louder than echoes. Levels
are dB over the median of either part of a pose, so neither gains nor distances hide anything.

Many poses or lags are drawn as the largest of those that share a pixel: a line one lag wide stays.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow, microphone_positions
from echolearn.acoustics.sides import first_echoes
from echolearn.acoustics.types import Array, MicArray, Observation
from echolearn.localization.beamforming import direction_grid
from echolearn.localization.correlations import PAD, advance, steered_response
from echolearn.robot.png import LEVELS
from echolearn.survey.health import Health, as_found
from echolearn.survey.survey import Survey, blocks

LOWEST, HIGHEST = 4.0, 28.0
"""dB over the median at which colours begin and end: noise alone reaches 13."""

SIZE = (480, 640)
"""Most poses and lags that the array's image shows; a microphone's shows half of each."""

AZIMUTHS = 72
"""Directions in the array's plane, 5 degrees apart."""

BEYOND = 1.08
"""Share of the search window's last lag up to which is drawn."""


@dataclass(frozen=True)
class Waterfall:
    """Images of a walk, and the lines to draw in them.

    Attributes:
        images: levels from 0 to `LEVELS` - 1: the array's, shape (H, W), then one of each
            microphone.
        lags: lags that the images span, from 0.
        window: first and last lag of the search window.
        direct: lag of the direct path at each microphone, shape (M,); NaN if it was removed.
        echoes: lags of the true echoes of each wall, shape (P, M, S); NaN where a wall sends none
            back; None where no walls are told.
    """

    images: list[Array]
    lags: int
    window: tuple[int, int]
    direct: Array
    echoes: Array | None


class Canvas:
    """An image that recordings are added to, block by block."""

    def __init__(self, poses: int, lags: int, *, share: int = 1) -> None:
        self.poses = poses
        self.rows = min(poses, SIZE[0] // share)
        self.columns = min(lags, SIZE[1] // share)
        self.levels = np.zeros((self.rows, self.columns), dtype=np.uint8)

    def add(self, block: Array, colours: Array) -> None:
        """Draw the colours (B, L) of the numbered poses (B,)."""
        starts = np.arange(self.columns) * colours.shape[-1] // self.columns
        columns = np.maximum.reduceat(colours, starts, axis=-1)
        np.maximum.at(self.levels, block * self.rows // self.poses, columns)


def colours_of(outputs: Array) -> Array:
    """Return the colours of outputs (..., L) by their magnitude over its median, uint8."""
    magnitude = np.abs(outputs)
    # Half of the lags hear no echo, so the median is that of what is no echo.
    usual = np.median(magnitude, axis=-1, keepdims=True)
    above = 2 * signals.decibel(magnitude / np.maximum(usual, 1e-30))
    share = (above - LOWEST) / (HIGHEST - LOWEST)
    return (np.clip(share, 0.0, 1.0) * (LEVELS - 1)).round().astype(np.uint8)


def outputs(observation: Observation, *, lags: int, near: bool) -> Array:
    """Return what the array hears at lags from 0, and then each microphone, shape (B, 1 + M, L).

    Args:
        observation: recordings (B, M, N).
        lags: their number L.
        near: whether the array listens to its own loudspeaker; else to walls all around.
    """
    probe = observation.probe
    scale = probe.sample_rate / observation.speed_of_sound
    heard = signals.matched_filter(observation.samples, probe, first=0, last=lags + PAD - 1)
    padded = np.pad(heard, ((0, 0), (0, 0), (PAD, 0)))
    if near:
        away = np.linalg.norm(observation.array.positions, axis=1) * scale
        together = advance(padded, (away - away[0])[None]).sum(axis=-2)
    else:
        together = _all_around(padded, observation.array, scale=scale)
    return np.concatenate([together[..., PAD:-PAD], heard[..., :lags]], axis=-2)


def _all_around(padded: Array, array: MicArray, *, scale: float) -> Array:
    """Return the largest |J| over directions, shape (B, 1, L), of correlations (B, M, L)."""
    azimuth, elevation = direction_grid(AZIMUTHS)
    # The axis besides, for floor and ceiling.
    directions = (np.append(azimuth, 0.0), np.append(elevation, 0.0))
    steered = steered_response(padded, array, directions=directions, scale=scale)
    return np.abs(steered).max(axis=-2, keepdims=True)


def waterfall(survey: Survey, health: Health, *, window: SearchWindow) -> Waterfall:
    """Return what the matched filter hears along a walk, the direct path among it.

    Args:
        survey: what was recorded; time zero is where it is mended to be.
        health: what the recordings say about themselves.
        window: where echoes are sought.

    Raises:
        BadValue: a recording that cannot be read.
    """
    probe = survey.probe
    scale = probe.sample_rate / survey.speed_of_sound
    first, last = window.lags(survey.array, probe.sample_rate, speed_of_sound=survey.speed_of_sound)
    lags = min(math.ceil(last * BEYOND), probe.length)
    away = np.linalg.norm(survey.array.positions, axis=1)
    poses = len(survey.poses)
    canvases = [
        Canvas(poses, lags),
        *(Canvas(poses, lags, share=2) for _ in survey.array.positions),
    ]
    sound = as_found(survey, health)
    for block in blocks(survey):
        heard = sound.observe(block)
        recorded = np.stack([sound.mended(pose) for pose in block])
        before = outputs(replace(heard, samples=recorded), lags=lags, near=True)[..., :first]
        within = outputs(heard, lags=lags, near=False)[..., first:]
        drawn = np.concatenate([colours_of(before), colours_of(within)], axis=-1)
        for canvas, each in zip(canvases, np.moveaxis(drawn, 1, 0), strict=True):
            canvas.add(np.array(block), each)
    return Waterfall(
        images=[canvas.levels for canvas in canvases],
        lags=lags,
        window=(first, last),
        direct=np.where(health.direct, scale * away, math.nan),
        echoes=true_lags(survey, lags),
    )


def true_lags(survey: Survey, lags: int) -> Array | None:
    """Return the lags of first echoes, shape (P, M, S), NaN beyond `lags`; None without walls."""
    if survey.walls is None:
        return None
    scale = survey.probe.sample_rate / survey.speed_of_sound
    ways = []
    for pose in survey.poses:
        microphones = microphone_positions(survey.array, pose)
        ways.append(first_echoes(survey.walls, pose.position, microphones=microphones))
    found = scale * np.array(ways)
    return np.where(found < lags, found, math.nan)
