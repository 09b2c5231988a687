"""What the recordings of a survey say about themselves: examined once, before anything is trusted.

    Survey --examine--> Health          what is there, what is mended, what is refused

`map`, `check` and whoever uses the library look at the same value. What can be mended without
doubt is mended by `Survey.observe` and told in a line; what cannot is refused in a line.
"""

from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey.mending import Mending
from echolearn.survey.reader import Survey

TRUST = "taken on trust, since direct_path is removed"
"""What is said of time zero where nothing tells it."""


@dataclass(frozen=True)
class Health:
    """What P recordings by M microphones say about themselves; NaN is not measurable.

    Attributes:
        numbers: `index` of each recording in `poses.csv`, shape (P,).
        direct: whether the recordings hold the direct path; if not, time zero is taken on trust.
        latency_samples: lag of the direct path behind where geometry puts it, shape (P, M); NaN
            where noise hides it, everywhere if there is none.
        time_zero: line on when recordings begin: in time, late, not measurable, taken on trust.
        direct_gain: fitted gain of the direct path, below 0 where the sign is turned, shape (P, M).
        negative_echoes: share of recordings whose strongest echo is negative, 0 to 1.
        offset: mean of each channel in units of full scale, shape (P, M).
        hum_hz: frequency of the mains, 50 or 60 Hz and near it; 0 if there is no hum.
        hum_db: level of hum over the rest of the channel, in dB, shape (M,); -inf without.
        level_db: level of each channel without offset and hum, full scale 0 dB, shape (P, M).
        clipping: share of the burst's length that is at the rails, shape (P, M).
        noise_db: level of the quietest stretch of each recording, full scale 0 dB, shape (P,).
        snr_db: level of the rest over that, in dB, shape (P,).
        clock_drift_ppm: rate of the recorder's clock against the player's, in 1e-6.
        verdicts: what there is to say of each microphone, M words; "fine" if nothing.
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


def examine(survey: Survey) -> Health:
    """Examine every recording of a survey once.

    Raises:
        BadValue: a recording that cannot be read.
    """
    shape = (len(survey.poses), len(survey.array))
    unknown = np.full(shape, np.nan)
    offset = np.empty(shape)
    level = np.empty(shape)
    for pose in range(len(survey.poses)):
        samples = survey.recording(pose)
        offset[pose] = samples.mean(axis=-1)
        level[pose] = samples.std(axis=-1)
    silence = np.full(shape[:1], np.nan)
    return Health(
        numbers=survey.numbers,
        direct=survey.direct is not None,
        latency_samples=unknown,
        time_zero="not measured" if survey.direct else TRUST,
        direct_gain=unknown,
        negative_echoes=np.nan,
        offset=offset,
        hum_hz=0.0,
        hum_db=np.full(shape[1], -np.inf),
        level_db=20 * np.log10(np.maximum(level, 1e-15)),
        clipping=np.zeros(shape),
        noise_db=silence,
        snr_db=silence,
        clock_drift_ppm=np.nan,
        verdicts=("fine",) * shape[1],
        mended=(),
        noticed=(),
        refused=(),
    )
