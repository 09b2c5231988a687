"""The recordings of a survey are examined once, before anything is trusted.

    Survey --examine--> Health          what is there, what is mended, what is refused

`map`, `check` and whoever uses the library look at the same value. What can be mended without
doubt is mended by `Survey.observe` and told in a line; what cannot is refused in a line, with its
number. Each recording is measured by itself (`measuring`), then all of them are judged together
(`time_zero`, `channels`): what one recording seems to say need not be so.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echolearn.acoustics.arrays import mirror_azimuth
from echolearn.acoustics.types import Array
from echolearn.survey import hidden, levels, naming, played, removal, time_zero
from echolearn.survey.audio import undecided_words
from echolearn.survey.calibrated import Calibrated, agreed, examine_calibration
from echolearn.survey.channels import judge_channels
from echolearn.survey.consistency import Heard, inconsistency
from echolearn.survey.containers import Containers, container_lines, numbers_of
from echolearn.survey.echoes import Echo
from echolearn.survey.health import Health
from echolearn.survey.measuring import Walk, decibels, measure_walk
from echolearn.survey.mending import Mending
from echolearn.survey.signs import turning_point, wiring_signs
from echolearn.survey.survey import NOISE, Survey
from echolearn.survey.time_zero import TimeZero

FAINT = 0.05
"""Power over the noise's below which it is not measurable: stretches of noise differ by as much."""

CLEAR = 10.0
"""Height over the noise from which an arrival tells of the clocks."""

SOME = 0.2
FEWEST = 5
"""Share and number of negative echoes that are told; of sound walks there is none."""


def examine(survey: Survey) -> Health:
    """Examine every recording of a survey once.

    Raises:
        BadValue: a recording that cannot be read.
    """
    return concluded(measure_walk(replace(survey, containers=stored(survey))))


def concluded(walk: Walk) -> Health:
    """Return what recordings that were measured say together."""
    survey = walk.survey
    verdicts = judge_channels(walk)
    zero = _zero(walk, verdicts.alive)
    calibrated = examine_calibration(walk, verdicts.alive)
    verdicts.refused += (*zero.refused, *calibrated.refused)
    mending = _mending(walk, zero, used=verdicts.alive, calibrated=calibrated)
    sound = replace(survey, mending=mending)
    removed = removal.removed_db(sound, walk.direct.noise)
    signs = walk.echo.sign * mending.sign * verdicts.alive
    rest = walk.level[:, survey.used].mean(axis=1) / np.maximum(walk.noise, 1e-30) - 1.0
    return Health(
        numbers=survey.numbers,
        direct=survey.direct is not None,
        latency_samples=walk.direct.latency,
        time_zero=zero.line,
        direct_gain=walk.direct.height / np.sqrt(survey.probe.energy),
        negative_echoes=_negative(signs),
        offset=walk.levels.offset,
        hum_hz=_fundamental(mending.tones, survey.probe.sample_rate),
        hum_db=decibels(np.median(walk.levels.hum, axis=0), floor=0.0),
        level_db=walk.level_db,
        clipping=walk.levels.clipping,
        noise_db=decibels(walk.noise),
        snr_db=decibels(np.where(rest < FAINT, np.nan, rest)),
        removed_db=removed,
        clock_drift_ppm=_drift(walk.echo),
        verdicts=tuple(verdicts.words),
        mended=(*_told(mending, walk, zero=zero, calibrated=calibrated), *_played(sound)),
        noticed=(
            *verdicts.noticed,
            *zero.noticed,
            *(() if _half_turned(mending) else _moving(walk, mending)),
            *hidden.hidden_lines(walk, verdicts.alive),
            *_reversed(signs, walk.numbers),
            *removal.removal_lines(survey, removed),
        ),
        refused=tuple(verdicts.refused),
        mending=None if mending.nothing else mending,
        containers=survey.containers,
    )


def stored(survey: Survey) -> Containers:
    """Return how the numbers of a survey's files are stored."""
    # Read one by one: the first that tells its bits ends it.
    recordings = numbers_of(undecided_words(survey.folder / file) for file in survey.files)
    noise = numbers_of([undecided_words(survey.folder / NOISE)], like=recordings)
    return survey.containers._replace(recordings=recordings, noise=noise)


def _zero(walk: Walk, used: Array) -> TimeZero:
    """Return when the recordings begin, by the microphones that are used, shape (M,), bool."""
    if not walk.survey.direct:
        return TimeZero(time_zero.TRUST, np.zeros(len(walk.noise)))
    return agreed(walk.survey, walk.direct, numbers=walk.numbers, used=used)


def _mending(walk: Walk, zero: TimeZero, *, used: Array, calibrated: Calibrated) -> Mending:
    """Return what is to be mended.

    Args:
        walk: what was measured.
        zero: when the recordings begin.
        used: microphones that tell something, shape (M,), bool; what a dead one says is chance.
        calibrated: what `calibration.wav` says.
    """
    return Mending(
        latency=zero.late,
        calibration=calibrated.late,
        calibration_offset=calibrated.offset,
        calibration_tones=calibrated.tones,
        sign=np.where(used, wiring_signs(walk.direct, walk.echo.sign), 1.0),
        offset=levels.steady(walk.levels) & used,
        tones=levels.humming(walk.tones, walk.levels),
    )


def _half_turned(mending: Mending) -> bool:
    """Tell whether microphones were turned against one another, which hides whence echoes come."""
    return bool((mending.sign != mending.sign[:, :1]).any())


def _negative(sign: Array) -> float:
    """Return the share of recordings whose strongest echo is negative; NaN if none is seen."""
    usual = sign.sum(axis=1)
    seen = usual != 0
    return float(np.mean(usual[seen] < 0)) if seen.any() else float("nan")


def _reversed(sign: Array, numbers: Sequence[object]) -> list[str]:
    """Return the line on a walk whose echoes are negative, mostly or from some place on.

    Args:
        sign: of the strongest echo at each microphone, mended, shape (P, M); 0 if unseen.
        numbers: `index` of each recording.
    """
    usual = np.sign(sign.sum(axis=1))
    seen = int(np.count_nonzero(usual))
    share = _negative(sign)
    either = "localizer.sign=either takes the largest |r|"
    place = turning_point(usual)
    if place:
        begun = numbers[place]
        return [f"the strongest echo turns its sign at recording {begun}; was a plug? {either}"]
    # Two standard deviations of a coin that is tossed for each; or some, of which walls have none.
    mostly = (2 * share - 1) * seen >= 2 * np.sqrt(max(seen, 1))
    some = share >= SOME and share * seen >= FEWEST
    if not (mostly or some):
        return []
    return [f"the strongest echo is negative in {100 * share:.0f} % of {seen} recordings; {either}"]


def _moving(walk: Walk, mending: Mending) -> list[str]:
    """Return the line on poses with which the echoes do not move, if they do not."""
    survey = walk.survey
    # Of an echo on the wrong side of the array nothing is said by where it seems to go.
    if mirror_azimuth(survey.array) is not None:
        return []
    metres = survey.speed_of_sound / survey.probe.sample_rate
    # Echoes were measured before anything is mended.
    late = np.asarray(mending.latency)[:, None]
    order = np.argsort(survey.numbers)
    poses = [survey.poses[place] for place in order]
    heard = Heard(
        places=np.array([pose.position[:2] for pose in poses]),
        headings=np.array([pose.heading for pose in poses]),
        distance=metres / 2 * (np.asarray(walk.echo.path) - late)[order],
        azimuth=np.asarray(walk.echo.azimuth)[order],
    )
    line = inconsistency(heard)
    return [line] if line else []


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


def _told(mending: Mending, walk: Walk, *, zero: TimeZero, calibrated: Calibrated) -> list[str]:
    """Return a line for everything that is mended.

    Args:
        mending: what is done.
        walk: what was measured.
        zero: when recordings begin.
        calibrated: what `calibration.wav` says.
    """
    numbers = walk.numbers
    lines = container_lines(walk.survey.containers)
    if mending.latency.any():
        lines.append(f"{zero.line}; taken off")
    lines += calibrated.mended
    wired = mending.sign < 0
    if wired.any():
        which = naming.microphones(wired.any(axis=0))
        # Whoever is turned in all recordings was so before the walk.
        always = (wired == wired.any(axis=0)).all()
        where = "" if always else f" in {naming.recordings(numbers, wired.any(axis=1))}"
        lines.append(f"{which} wired the other way{where}; turned")
    if mending.offset.any():
        most = np.abs(np.asarray(walk.levels.offset)[mending.offset]).max()
        where = naming.recordings(numbers, mending.offset.any(axis=1))
        which = naming.microphones(mending.offset.any(axis=0))
        lines.append(f"offset up to {most:.3g} at {which} in {where}; subtracted")
    humming: Array = np.array([bool(each) for each in mending.tones])
    if humming.any():
        where = naming.recordings(numbers, humming)
        most = decibels(np.median(walk.levels.hum[humming], axis=1).max())
        lines.append(f"hum of the mains {most:+.0f} dB over the rest in {where}; subtracted")
    return lines


def _played(sound: Survey) -> list[str]:
    """Return the line on the burst by which echoes of a mended survey are sought, if it is told."""
    if not sound.played:
        return []
    return [played.played_line(sound.played, sound.response, recordings=len(sound.looked_at))]
