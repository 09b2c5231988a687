"""What is measured of each recording by itself, and of all of them side by side: a `Walk`."""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey import echoes, levels, overflow, time_zero
from echolearn.survey.arrivals import arrivals
from echolearn.survey.echoes import Echo
from echolearn.survey.levels import Levels
from echolearn.survey.shape import Shape, shape_of
from echolearn.survey.survey import Survey
from echolearn.survey.time_zero import Direct

Row = TypeVar("Row", bound=tuple[Any, ...])

SEGMENTS = 8
"""Stretches of a recording of which the quietest tells the noise."""


class Walk(NamedTuple):
    """What was measured of all recordings.

    Attributes:
        survey: what was measured.
        levels, direct, shape, echo: of `levels`, `time_zero`, `shape`, `echoes`, fields (P, ...).
        level: mean square of each channel in the probe's band, shape (P, M).
        noise: that of the quietest stretch, of all microphones together, shape (P,).
        tones: frequencies of the mains in each recording, in cycles per sample.
        wrapped: samples of each channel that overflowed, shape (P, M).
        marks: a number that only equal samples share, of each channel, shape (P, M).
    """

    survey: Survey
    levels: Levels
    direct: Direct
    shape: Shape
    echo: Echo
    level: Array
    noise: Array
    tones: tuple[tuple[float, ...], ...]
    wrapped: Array
    marks: Array

    @property
    def numbers(self) -> tuple[int, ...]:
        """`index` of each recording."""
        return self.survey.numbers

    @property
    def used(self) -> Array:
        """Microphones that are used, shape (M,), bool."""
        return self.survey.used

    @property
    def level_db(self) -> Array:
        """Level of each channel, full scale 0 dB, shape (P, M)."""
        return decibels(self.level)


Measured = tuple[Levels, Direct, Shape, Echo, Array, float, Array, Array]
"""What is measured of one recording, in the order of the fields of a `Walk`."""


def measure_walk(survey: Survey) -> Walk:
    """Return what is measured of every recording of a survey."""
    return walk_of(survey, [measure_recording(survey, pose) for pose in range(len(survey.poses))])


def walk_of(survey: Survey, rows: Sequence[Measured]) -> Walk:
    """Return what was measured of each recording of a survey side by side."""
    kinds = zip(*rows, strict=True)
    about, direct, shape, echo, level, noise, wrapped, marks = kinds
    tones = tuple(each.tones for each in about)
    return Walk(
        survey=survey,
        # Tones are as many as there are in each recording, so they are no array.
        levels=_stacked([each._replace(tones=()) for each in about]),
        direct=_stacked(direct),
        shape=_stacked(shape),
        echo=_stacked(echo),
        level=np.array(level),
        noise=np.array(noise),
        tones=tones,
        wrapped=np.array(wrapped),
        marks=np.array(marks),
    )


def measure_recording(survey: Survey, pose: int) -> Measured:
    """Measure one recording."""
    probe = survey.probe
    lags = time_zero.expected(survey.around(pose), probe, speed_of_sound=survey.speed_of_sound)
    recorded = survey.recording(pose)
    marks = marks_of(recorded)
    about, samples = levels.measure_levels(recorded, probe)
    found = arrivals(samples, probe)
    # A factor that a channel was given moves the ends of its range.
    factors = np.ones(len(recorded)) if survey.gains is None else survey.gains
    unit = np.where(factors, factors, np.inf)[:, None]
    over = overflow.wrapped(recorded / unit, found)
    direct = (
        time_zero.direct_path_of(found, lags) if survey.direct else time_zero.unknown(len(lags))
    )
    echo = echoes.measure_echoes(
        samples,
        found,
        direct=direct if survey.direct else None,
        lags=lags,
        array=survey.array,
        scale=probe.sample_rate / survey.speed_of_sound,
    )
    # The burst is cut off by the end of the recording, where less of the noise is heard too.
    whole = max(probe.length - len(probe.samples), probe.length // 2)
    level, noise = _levels_of(found.outputs[:, found.zero : found.zero + whole], survey.used)
    shape = shape_of(samples, probe, direct=direct, lags=lags)
    return (
        about,
        direct,
        shape,
        echo,
        level,
        noise,
        over,
        marks,
    )


def _levels_of(outputs: Array, used: Array) -> tuple[Array, float]:
    """Return the mean square of each channel, shape (M,), and that of the quietest stretch of all.

    Args:
        outputs: of the matched filter, shape (M, K).
        used: microphones that tell the noise, shape (M,), bool.
    """
    stretches = np.array_split(outputs, SEGMENTS, axis=-1)
    energy = np.array([np.vecdot(each, each) for each in stretches])
    lengths = [each.shape[-1] for each in stretches]
    quietest = float((energy[:, used].mean(axis=-1) / lengths).min())
    return energy.sum(axis=0) / outputs.shape[-1], quietest


def _stacked(rows: Sequence[Row]) -> Row:
    """Return values of one class for each recording as one whose fields are arrays (P, ...)."""
    parts: Any = zip(*rows, strict=True)
    return type(rows[0])(*map(np.array, parts))


def decibels(power: Array, *, floor: float = 1e-30) -> Array:
    """Return a power in dB, of nothing that of the floor."""
    with np.errstate(divide="ignore"):
        found: Array = 10 * np.log10(np.maximum(power, floor))
    return found


def marks_of(samples: Array) -> Array:
    """Return a number that only equal samples share, of each channel of (M, N), shape (M,).

    In this process: the hash of bytes is salted, but faster than any digest.
    """
    # 24 bits of each sample tell recordings apart as well as all do.
    return np.array([hash(each.tobytes()) for each in samples.astype(np.float32)])
