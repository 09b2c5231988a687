"""What `calibration.wav` says about itself, as recordings of a walk do: time zero, offset, hum.

It is a single recording, so nothing is told by how often it comes; a hum is the mains only if the
walk hums as well, or if it is louder than all else.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey import levels, naming, time_zero
from echolearn.survey.arrivals import arrivals
from echolearn.survey.measuring import Walk, decibels, marks_of
from echolearn.survey.mending import steadied
from echolearn.survey.survey import CALIBRATION, Survey
from echolearn.survey.time_zero import Direct, TimeZero

DIRECT_SHARE = 0.01
"""Share of a calibration's energy that is the direct path, at least; of noise some thousandths."""


class Calibrated(NamedTuple):
    """What a calibration says about itself.

    Attributes:
        late: samples by which it begins late.
        offset: microphones whose mean is subtracted, shape (M,), bool.
        tones: frequencies of the mains, in cycles per sample.
        mended, refused: lines.
    """

    late: float
    offset: Array
    tones: tuple[float, ...]
    mended: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()


def examine_calibration(walk: Walk, used: Array) -> Calibrated:
    """Return what a calibration says, by the microphones that are used, shape (M,), bool."""
    survey = walk.survey
    nothing = Calibrated(0.0, np.zeros(len(used), dtype=bool), ())
    if "calibration" not in (survey.direct, survey.played):
        return nothing
    recorded = survey.calibration_recorded
    copied = used & (walk.marks == marks_of(recorded)).any(axis=0)
    if copied.any():
        where = naming.recordings(walk.numbers, (walk.marks == marks_of(recorded)).any(axis=1))
        line = "must be a recording of its own, where nothing reflects; was a file copied?"
        return nothing._replace(refused=(f"{CALIBRATION}={where}: {line}",))

    steady = _steadiness(walk, recorded, used=used)
    if steady.refused:
        return steady
    sound = np.where(used[:, None], steadied(recorded, steady.offset, tones=steady.tones), 0.0)
    begun = _begun(survey, sound, used=used)
    late = float(begun.late[0])
    if late:
        word = "late" if late > 0 else "early"
        lines = (f"{CALIBRATION} begins {abs(late):.1f} samples {word}; taken off",)
        steady = steady._replace(mended=(*lines, *steady.mended))
    return steady._replace(late=late, refused=begun.refused)


def _steadiness(walk: Walk, recorded: Array, *, used: Array) -> Calibrated:
    """Return what is said of offset, hum and clipping, for a recording (M, K)."""
    probe = walk.survey.probe
    nothing = Calibrated(0.0, np.zeros(len(used), dtype=bool), ())
    # Of less than a burst no level can be told.
    if recorded.shape[-1] < len(probe.samples):
        return nothing
    found, _ = levels.measure_levels(recorded, probe)
    clipped = used & (found.clipping > levels.CLIPPED)
    if clipped.any():
        line = (
            f"{CALIBRATION} clipped={100 * found.clipping[clipped].max():.0f} % of a burst at "
            f"{naming.microphones(clipped)}: must be at most {100 * levels.CLIPPED:g} %; record "
            "with less gain"
        )
        return nothing._replace(refused=(line,))
    lines = []
    offset = found.shifted & used
    if offset.any():
        most = np.abs(found.offset[offset]).max()
        lines.append(f"{CALIBRATION}: offset up to {most:.3g}; subtracted")
    hums = any(walk.tones) or found.hum.max() > 1.0
    tones = found.tones if hums else ()
    if tones:
        level = decibels(np.median(found.hum))
        lines.append(f"{CALIBRATION}: hum of the mains {level:+.0f} dB over the rest; subtracted")
    return Calibrated(0.0, offset, tones, tuple(lines))


def _begun(survey: Survey, sound: Array, *, used: Array) -> TimeZero:
    """Return when a calibration (M, K) begins."""
    lags = time_zero.expected(survey.array, survey.probe, speed_of_sound=survey.speed_of_sound)
    whole = np.pad(sound, ((0, 0), (0, survey.probe.length - sound.shape[-1])))
    found = time_zero.direct_path_of(arrivals(whole, survey.probe), lags)
    share = found.height**2 / np.maximum(np.sum(whole**2, axis=-1), 1e-300)
    if np.mean(share[used] >= DIRECT_SHARE) <= 0.5:
        faint = "must hold it alone, at each microphone; was the probe played, and in the open?"
        return TimeZero("", np.zeros(1), (f"direct path in {CALIBRATION}=not seen: {faint}",))
    # A single recording, with the same proof that all microphones began together.
    alone = Direct(*(each[None] for each in found))
    return agreed(survey, alone, numbers=(CALIBRATION,), used=used)


def agreed(survey: Survey, direct: Direct, *, numbers: Sequence[object], used: Array) -> TimeZero:
    """Return what direct paths say together; see `time_zero_of`.

    Args:
        survey: what was recorded.
        direct: of P recordings, fields (P, M).
        numbers: what names each recording.
        used: microphones that are used, shape (M,), bool.
    """
    return time_zero.time_zero_of(
        direct,
        numbers=numbers,
        used=used,
        sample_rate=survey.probe.sample_rate,
        speed=survey.speed_of_sound,
        positions=survey.array.positions if survey.loudspeakers is None else None,
        mapped=survey.mapped,
    )
