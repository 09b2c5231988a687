"""What the recordings of a survey say about themselves: examined once, before anything is trusted.

    Survey --examine--> Health          what is there, what is mended, what is refused

`map`, `check` and whoever uses the library look at the same value. What can be mended without
doubt is mended by `Survey.observe` and told in a line; what cannot is refused in a line, with its
number. Each recording is measured by itself (`levels`, `time_zero`, `echoes`), then all of them are
judged together (`time_zero`, `channels`): what one recording seems to say need not be so.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.storage.advice import assignment
from echolearn.survey import channels, echoes, levels, naming, time_zero
from echolearn.survey.arrivals import arrivals
from echolearn.survey.channels import Walk
from echolearn.survey.echoes import Echo
from echolearn.survey.levels import Levels
from echolearn.survey.mending import Mending
from echolearn.survey.reader import Survey
from echolearn.survey.time_zero import Direct, TimeZero

Row = TypeVar("Row", Levels, Direct, Echo)

SURE = 0.9
"""Share of recordings that must agree on a sign."""

SEGMENTS = 8
"""Stretches of a recording of which the quietest tells the noise."""

FAINT = 0.05
"""Power over the noise's below which it is not measurable: stretches of noise differ by as much."""

CLEAR = 10.0
"""Height over the noise from which an arrival tells of the clocks."""


@dataclass(frozen=True)
class Health:
    """What P recordings by M microphones say about themselves; NaN is not measurable.

    Attributes:
        numbers: `index` of each recording in `poses.csv`, P of them.
        direct: whether the recordings hold the direct path; if not, time zero is taken on trust.
        latency_samples: lag of the direct path behind where geometry puts it, shape (P, M); NaN
            where noise hides it, everywhere if there is none.
        time_zero: line on when recordings begin: in time, late, not measurable, taken on trust.
        direct_gain: fitted gain of the direct path, below 0 where the sign is turned, shape (P, M).
        negative_echoes: share of recordings whose strongest echo is negative, of those in which one
            is seen; what is mended is mended first.
        offset: mean of each channel in units of full scale, shape (P, M).
        hum_hz: frequency of the mains, 50 or 60 Hz and near it; 0 if there is no hum.
        hum_db: level of hum over the rest of the channel, in dB, shape (M,); -inf without.
        level_db: level of each channel in the probe's band, without offset and hum, full scale
            0 dB, shape (P, M).
        clipping: share of the loudest burst's length that is at the rails, shape (P, M).
        noise_db: level of the quietest stretch of each recording, full scale 0 dB, shape (P,): the
            noise, or the reverberation if that never ends.
        snr_db: level of the whole recording over that, in dB, shape (P,).
        clock_drift_ppm: rate of the player's clock over the recorder's less 1, in 1e-6.
        verdicts: what there is to say of each microphone, M lines; "fine" if nothing.
        mended, noticed, refused: lines, each of one kind of fault and all places where it is.
        mending: what `Survey.observe` does to the recordings; None if nothing.
    """

    numbers: tuple[int, ...]
    direct: bool
    latency_samples: Array
    time_zero: str
    direct_gain: Array
    negative_echoes: float
    offset: Array
    hum_hz: float
    hum_db: Array
    level_db: Array
    clipping: Array
    noise_db: Array
    snr_db: Array
    clock_drift_ppm: float
    verdicts: tuple[str, ...]
    mended: tuple[str, ...]
    noticed: tuple[str, ...]
    refused: tuple[str, ...]
    mending: Mending | None = None


class Measured(NamedTuple):
    """What is measured of one recording, or of all of them.

    Attributes:
        levels, direct, echo: by `levels`, `time_zero` and `echoes`.
        level: mean square in the probe's band, shape (M,).
        noise: that of the quietest stretch, of all microphones together.
    """

    levels: Levels
    direct: Direct
    echo: Echo
    level: Array
    noise: float


def examine(survey: Survey) -> Health:
    """Examine every recording of a survey once.

    Raises:
        BadValue: a recording that cannot be read.
    """
    found = [_measure(survey, pose) for pose in range(len(survey.poses))]
    direct = _stacked([each.direct for each in found])
    level = np.array([each.level for each in found])
    positions = survey.array.positions
    walk = Walk(
        numbers=survey.numbers,
        level_db=_db(level),
        levels=_stacked([each.levels for each in found]),
        echo=_stacked([each.echo for each in found]),
        used=survey.used,
        distances=np.linalg.norm(positions[:, None] - positions, axis=-1),
        headings=np.array([pose.heading for pose in survey.poses]),
        direct=survey.direct is not None,
    )
    verdicts = channels.judge(walk)
    deaf = ["dead" in word or "loopback" in word for word in verdicts.words]
    alive = survey.used & ~np.array(deaf)
    zero = TimeZero(time_zero.TRUST, np.zeros(len(found)))
    if survey.direct:
        zero = time_zero.judge(
            direct,
            numbers=survey.numbers,
            used=alive,
            sample_rate=survey.probe.sample_rate,
            speed=survey.speed_of_sound,
        )
    verdicts.refused += zero.refused

    # What a dead one seems to say is chance.
    sign = np.where(alive, _signs(direct, walk.echo), 1.0)
    mending = Mending(
        latency=zero.late,
        calibration=_calibration(survey),
        sign=sign,
        offset=walk.levels.shifted & alive,
        tones=tuple(each.levels.tones for each in found),
    )
    noise = np.array([each.noise for each in found])
    rest = np.maximum(level[:, survey.used].mean(axis=1) / np.maximum(noise, 1e-30) - 1.0, 0.0)
    rest = np.where(rest < FAINT, np.nan, rest)
    negative = _negative(walk.echo.sign * sign * alive)
    return Health(
        numbers=survey.numbers,
        direct=survey.direct is not None,
        latency_samples=direct.latency,
        time_zero=zero.line,
        direct_gain=direct.height / np.sqrt(survey.probe.energy),
        negative_echoes=negative,
        offset=walk.levels.offset,
        hum_hz=_fundamental(mending.tones, survey.probe.sample_rate),
        hum_db=_db(np.median(walk.levels.hum, axis=0), floor=0.0),
        level_db=walk.level_db,
        clipping=walk.levels.clipping,
        noise_db=_db(noise),
        snr_db=_db(rest),
        clock_drift_ppm=_drift(walk.echo),
        verdicts=tuple(verdicts.words),
        mended=tuple(_told(mending, walk, zero)),
        noticed=(*verdicts.noticed, *_reversed(negative, walk.echo)),
        refused=tuple(verdicts.refused),
        mending=None if mending.nothing else mending,
    )


def _measure(survey: Survey, pose: int) -> Measured:
    """Measure one recording."""
    probe = survey.probe
    lags = time_zero.expected(survey.array, probe, survey.speed_of_sound)
    about, samples = levels.measure(survey.recording(pose), probe)
    found = arrivals(samples, probe)
    direct = time_zero.measure(found, lags) if survey.direct else time_zero.unknown(len(lags))
    echo = echoes.measure(
        samples,
        found,
        direct=direct if survey.direct else None,
        lags=lags,
        array=survey.array,
        scale=probe.sample_rate / survey.speed_of_sound,
    )
    square = found.outputs[:, found.zero :] ** 2
    # The burst is cut off by the end of the recording, where less of the noise is heard too.
    whole = max(survey.probe.length - len(probe.samples), survey.probe.length // 2)
    stretches = [each.mean() for each in np.array_split(square[survey.used, :whole], SEGMENTS, -1)]
    return Measured(about, direct, echo, square[:, :whole].mean(axis=-1), float(min(stretches)))


def _stacked(rows: Sequence[Row]) -> Row:
    """Return values of one class for each recording as one whose fields are arrays (P, ...)."""
    kind = type(rows[0])
    parts = zip(kind._fields, zip(*rows, strict=True), strict=True)
    # Tones are as many as there are in each recording, so they stay a tuple.
    made: Any = {name: part if name == "tones" else np.array(part) for name, part in parts}
    return kind(**made)


def _db(power: Array | float, *, floor: float = 1e-30) -> Any:
    with np.errstate(divide="ignore"):
        return 10 * np.log10(np.maximum(power, floor))


def _signs(direct: Direct, echo: Echo) -> Array:
    """Return -1 for microphones that are wired the other way, else 1, shape (M,).

    The direct path tells it; without one only a microphone that differs from the others shows.
    """
    turned = np.sign(direct.height)
    if not np.isfinite(turned).any():
        usual = np.sign(echo.sign.sum(axis=1, keepdims=True))
        turned = np.where((echo.sign != 0) & (usual != 0), echo.sign * usual, np.nan)
        # A few recordings without a direct path prove nothing.
        turned[:, np.isfinite(turned).sum(axis=0) < 5] = np.nan
    count = np.isfinite(turned).sum(axis=0)
    negative = (turned < 0).sum(axis=0)
    return np.where((count > 0) & (negative >= SURE * count), -1.0, 1.0)


def _negative(sign: Array) -> float:
    """Return the share of recordings whose strongest echo is negative; NaN if none is seen."""
    usual = sign.sum(axis=1)
    seen = usual != 0
    return float(np.mean(usual[seen] < 0)) if seen.any() else float("nan")


def _reversed(negative: float, echo: Echo) -> list[str]:
    """Return the line on a walk most of whose echoes are negative, if it is one."""
    seen = int((echo.sign.sum(axis=1) != 0).sum())
    # Two standard deviations of a coin that is tossed for each.
    if not (2 * negative - 1) * seen >= 2 * np.sqrt(max(seen, 1)):
        return []
    return [
        f"the strongest echo is negative in {100 * negative:.0f} % of {seen} recordings; "
        "localizer.sign=either takes the largest |r|"
    ]


def _calibration(survey: Survey) -> float:
    """Return how many samples `calibration.wav` is late; 0 if there is none, or it is in time."""
    if survey.direct != "calibration":
        return 0.0
    lags = time_zero.expected(survey.array, survey.probe, survey.speed_of_sound)
    found = time_zero.measure(arrivals(survey.arrivals, survey.probe), lags)
    if not np.isfinite(found.latency).any():
        return 0.0
    return float(time_zero.rounded(np.array([np.nanmedian(found.latency)]))[0])


def _fundamental(tones: tuple[tuple[float, ...], ...], sample_rate: float) -> float:
    """Return the frequency of the mains in Hz, 0 if there is no hum."""
    lowest = [min(each) * sample_rate for each in tones if each]
    if not lowest:
        return 0.0
    found = float(np.median(lowest))
    # The fundamental itself may be missing.
    nominal = min(levels.MAINS, key=lambda hz: abs(found / hz - round(found / hz)))
    return found / max(round(found / nominal), 1)


def _drift(echo: Echo) -> float:
    drift: Array = np.asarray(echo.drift)
    clear = np.isfinite(drift) & (echo.seen.max(axis=1) > CLEAR)
    return float(1e6 * np.median(drift[clear])) if clear.any() else float("nan")


def _told(mending: Mending, walk: Walk, zero: TimeZero) -> list[str]:
    """Return a line for everything that is mended."""
    numbers = walk.numbers
    lines = []
    if mending.latency.any():
        lines.append(f"{zero.line}; taken off")
    if mending.calibration:
        lines.append(f"calibration.wav begins {mending.calibration:.1f} samples late; taken off")
    if (mending.sign < 0).any():
        turned = naming.microphones(mending.sign < 0)
        lines.append(f"{turned} wired the other way; turned")
    if mending.offset.any():
        most = np.abs(np.asarray(walk.levels.offset)[mending.offset]).max()
        where = naming.recordings(numbers, mending.offset.any(axis=1))
        which = naming.microphones(mending.offset.any(axis=0))
        lines.append(f"offset up to {most:.3g} at {which} in {where}; subtracted")
    humming: Array = np.array([bool(each) for each in mending.tones])
    if humming.any():
        where = naming.recordings(numbers, humming)
        most = _db(np.median(walk.levels.hum[humming], axis=1).max())
        lines.append(f"hum of the mains {most:+.0f} dB over the rest in {where}; subtracted")
    return lines


def mended(survey: Survey, health: Health) -> Survey:
    """Return a survey whose recordings are mended when read.

    Raises:
        BadValue: it cannot be used, with the first reason and how many there are.
    """
    if health.refused:
        more = len(health.refused) - 1
        page = shlex.join(["echolearn", "check", assignment("survey", str(survey.folder))])
        others = f" (and {more} more: {page})" if more else ""
        raise BadValue(f"{survey.folder}: {health.refused[0]}{others}")
    return replace(survey, mending=health.mending)
