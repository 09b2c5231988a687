"""What the recordings of a survey say about themselves, and what is mended in them.

`map`, `check` and whoever uses the library look at the same value; `examining` finds it out. What
can be mended without doubt is mended by `Survey.observe` and told in a line; what cannot is refused
in a line, with its number.
"""

import shlex
from dataclasses import dataclass, replace

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.storage.advice import assignment
from echolearn.survey.containers import Containers
from echolearn.survey.mending import Mending
from echolearn.survey.survey import Survey


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
        snr_db: level of the whole recording over that, in dB, shape (P,): the SNR at least, as what
            reverberation is left in the quietest stretch counts as noise.
        removed_db: by how much removing the direct path softens what comes before the first echo,
            in dB; NaN if there is none.
        clock_drift_ppm: rate of the player's clock over the recorder's less 1, in 1e-6.
        verdicts: what there is to say of each microphone, M lines; "fine" if nothing.
        mended, noticed, refused: lines, each of one kind of fault and all places where it is.
        mending: what `Survey.observe` does to the recordings; None if nothing.
        containers: how the numbers of the survey's files are stored.
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
    removed_db: float
    clock_drift_ppm: float
    verdicts: tuple[str, ...]
    mended: tuple[str, ...]
    noticed: tuple[str, ...]
    refused: tuple[str, ...]
    mending: Mending | None = None
    containers: Containers = Containers()


def mended(survey: Survey, health: Health) -> Survey:
    """Return a survey whose recordings are mended when read.

    Raises:
        BadValue: it cannot be used, with the first reason and how many there are.
    """
    if health.refused:
        more = len(health.refused) - 1
        # What recordings say of themselves is the same for every bundle.
        words = [assignment("survey", str(survey.folder)), "bundle=null"]
        page = shlex.join(["echolearn", "check", *words])
        others = f" (and {more} more: {page})" if more else ""
        raise BadValue(f"{survey.folder}: {health.refused[0]}{others}")
    return as_found(survey, health)


def as_found(survey: Survey, health: Health) -> Survey:
    """Return a survey whose recordings are mended when read, even if it is refused."""
    return replace(survey, mending=health.mending, containers=health.containers)
