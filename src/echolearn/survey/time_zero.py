"""When a recording begins: the direct path against where geometry puts it.

    latency_m = lag of the first arrival at microphone m - |p_m| fs / c

All microphones of a recording begin together, so their latencies agree within what positions and
noise leave. One that is the same in every recording is an interface's; one that changes is a
program's, or a lost buffer's, and is taken off recording by recording. What is lost after the
direct path and leaves no mark cannot be seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.survey import naming
from echolearn.survey.arrivals import SEEN, Arrivals, crests
from echolearn.survey.moved import PLACED, moved_loudspeaker

TRUST = "time zero is taken on trust, since direct_path is removed"
HIDDEN = "time zero is not measurable at this SNR"
"""What is said of time zero where nothing tells it."""

REST = 0.25
"""Samples of latency that are left: geometry and sampling are not known better."""

ROUGH = 1.0
"""Samples by which one microphone may be off where only times and directions are wanted, which are
right within 10 samples and 10 degrees: it is told, and the recordings are used as they are."""

USED = "used as it is, since map: false asks for times and directions alone"

SPREAD = 0.55
"""Standard deviation of a crest's lag in samples, times its height over the noise, for a burst of
all frequencies: sqrt(3) / pi."""

JOINT = 9.0
"""The same as `SEEN` for the root of the summed squares of all microphones, which is larger."""

SPARED = 5.0
"""Samples from its usual lag within which a soft direct path is one."""

LOUD = 12.0
"""Height over the noise at which a direct path as loud as in other recordings would be seen."""


class Direct(NamedTuple):
    """The direct path in one recording; NaN where it is not seen.

    Attributes:
        latency: behind the geometry's, in samples, shape (M,).
        height: of the matched filter there, below 0 where the sign is turned, shape (M,).
        noise: standard deviation of the matched filter beside it, shape (M,).
    """

    latency: Array
    height: Array
    noise: Array


def expected(array: MicArray, probe: Probe, *, speed_of_sound: float) -> Array:
    """Return the lags at which the direct path arrives, shape (M,), in samples.

    Args:
        array: microphones, as seen from the loudspeaker.
        probe: tells the sample rate.
        speed_of_sound: in m/s.
    """
    distance: Array = np.linalg.norm(array.positions, axis=1)
    return distance * probe.sample_rate / speed_of_sound


def unknown(count: int) -> Direct:
    """Return a direct path that is not there, for so many microphones."""
    nothing = np.full(count, np.nan)
    return Direct(nothing, nothing, nothing)


def direct_path_of(found: Arrivals, lags: Array) -> Direct:
    """Return the direct path of one recording.

    Args:
        found: its matched filter.
        lags: where the direct path is expected, shape (M,), in samples.
    """
    outputs = found.outputs
    noise = found.noise
    together = _together(found, lags)
    seen = bool(together.max() > JOINT)
    common = found.first(together, JOINT / SEEN)
    alone = np.abs(outputs).max(axis=-1) > SEEN * noise
    places = np.zeros(len(lags), dtype=int)
    for m, lag in enumerate(lags):
        # Too faint to be found alone, it must be where it is at the others.
        start = max(common + round(lag) - 2, 0)
        beside = start + int(np.abs(outputs[m, start : start + 5]).argmax())
        places[m] = found.first(outputs[m], noise[m]) if alone[m] else beside
    where, r = crests(outputs, places)
    there = (alone | seen) & (np.abs(r) > SEEN * noise / 2)
    latency = np.where(there, where - found.zero - lags, np.nan)
    height = np.where(there, r, np.nan)
    return Direct(latency, height, noise)


def _together(found: Arrivals, lags: Array) -> Array:
    """Return the root of the summed squares of r_m at the direct path's lags, shape (L + N,)."""
    square = (found.outputs / found.noise[:, None]) ** 2
    aligned = [np.roll(each, -round(lag)) for each, lag in zip(square, lags, strict=True)]
    # What comes round from the beginning is before any sound.
    return np.sqrt(np.sum(aligned, axis=0))


@dataclass(frozen=True)
class TimeZero:
    """What the direct paths of P recordings say.

    Attributes:
        line: in words.
        late: samples to take off each recording, shape (P,); 0 where nothing is.
        refused: what cannot be mended.
        noticed: what is told only.
    """

    line: str
    late: Array
    refused: tuple[str, ...] = ()
    noticed: tuple[str, ...] = ()


def time_zero_of(
    direct: Direct,
    *,
    numbers: Sequence[object],
    used: Array,
    sample_rate: float,
    speed: float,
    positions: Array | None = None,
    mapped: bool = True,
) -> TimeZero:
    """Return what direct paths, fields (P, M), say together.

    Args:
        direct: of every recording.
        numbers: `index` of each recording, or what else names it.
        used: microphones that are used, shape (M,), bool.
        sample_rate: in Hz.
        speed: of sound, in m/s.
        positions: of the microphones around a loudspeaker that is carried, shape (M, 3), in m.
        mapped: whether echoes are placed on a map; if not, little is told and not refused.
    """
    latency = np.where(used, direct.latency, np.nan)
    with np.errstate(invalid="ignore"):
        doubt = SPREAD * direct.noise / np.abs(direct.height)
    nothing = np.zeros(len(latency))
    seen = np.isfinite(latency).any(axis=-1)
    if not seen.any():
        return TimeZero(HIDDEN, nothing)

    allowed = max(0.5, PLACED * sample_rate / speed)
    unit = _Unit(sample_rate, speed)
    middle = _middle(latency)
    missing = _missing(direct, used) & ~_there(latency, middle, allowed=allowed)
    lines = _lost(numbers, missing)
    off = latency - middle[:, None]
    wrong = (np.abs(off) > allowed + 5 * doubt) & ~missing[:, None]
    wrong &= _again(wrong, direct, count=int(seen.sum()))
    told: tuple[str, ...] = ()
    if wrong.any():
        elsewhere = moved_loudspeaker(off, positions, metre=speed / sample_rate, allowed=allowed)
        about: Any = {"numbers": numbers, "unit": unit, "allowed": allowed}
        line = _disagree(off, wrong, elsewhere=elsewhere, **about)
        if mapped or float(np.abs(off[wrong]).max()) > ROUGH:
            lines.append(line)
        else:
            told = (f"{line} {USED}",)
    if lines:
        return TimeZero(f"direct paths do not agree; {lines[0]}", nothing, tuple(lines))
    return replace(_common(middle, doubt, numbers=numbers, unit=unit), noticed=told)


def _again(wrong: Array, direct: Direct, *, count: int) -> Array:
    """Tell which readings that are wrong are so often enough.

    Args:
        wrong: those that are too far off, shape (P, M), bool.
        direct: of every recording.
        count: recordings whose direct path is seen.
    """
    # One reading in a hundred may be another arrival; a channel that is late is so again.
    # A single one must stand far out of the noise, which need not be white.
    with np.errstate(invalid="ignore"):
        clear = np.abs(direct.height) > LOUD * direct.noise
    often: Array = wrong.sum(axis=0) > np.where(clear, 0.02, 0.2) * count
    return often


class _Unit(NamedTuple):
    """Says lags in samples and ms."""

    sample_rate: float
    speed: float

    def __call__(self, lag: float) -> str:
        seconds = lag / self.sample_rate
        return f"{lag:.1f} samples ({1000 * seconds:.3g} ms)"


def _middle(latency: Array) -> Array:
    """Return the median microphone's latency of each recording, (P,), one that there is."""
    ordered = np.sort(latency, axis=-1)
    count = np.isfinite(latency).sum(axis=-1)
    place = np.maximum(count - 1, 0) // 2
    return np.take_along_axis(ordered, place[:, None], axis=-1)[:, 0]


def _there(latency: Array, middle: Array, *, allowed: float) -> Array:
    """Tell where a direct path, however soft, arrives as it always does, shape (P,), bool.

    A gain that was turned down softens it.

    Args:
        latency: shape (P, M); NaN where it is not seen.
        middle: the median microphone's, shape (P,).
        allowed: samples by which microphones may differ.
    """
    usual = np.abs(middle - np.nanmedian(middle)) < SPARED
    spread = np.nanmax(np.abs(latency - middle[:, None]), axis=-1, initial=0.0)
    return np.asarray(usual & (spread <= allowed))


def _missing(direct: Direct, used: Array) -> Array:
    """Tell which recordings have no direct path where it would be seen, shape (P,), bool.

    It is as loud at every pose: what is 10 dB softer is something else.
    """
    height = np.where(used, np.abs(direct.height), np.nan)
    with np.errstate(invalid="ignore"):
        there = np.isfinite(height).any(axis=0)
        usual = np.nanmedian(np.where(there, height, 0.0), axis=0)
        visible = usual > LOUD * direct.noise
        soft = ~(height > 0.3 * usual)
    return visible.any(axis=-1) & ((visible & soft).sum(axis=-1) > visible.sum(axis=-1) / 2)


def _lost(numbers: Sequence[object], missing: Array) -> list[str]:
    """Return the line on recordings whose direct path is missing, (P,), bool, if there are any."""
    if not missing.any():
        return []
    return [
        f"direct path missing in {naming.recordings(numbers, missing)}: must be there where "
        "direct_path is present; was a buffer lost, or is it removed already?"
    ]


def _disagree(
    off: Array,
    wrong: Array,
    *,
    numbers: Sequence[object],
    unit: _Unit,
    allowed: float,
    elsewhere: str,
) -> str:
    """Return the line on direct paths that do not agree with the others.

    Args:
        off: latency less that of the median microphone, shape (P, M).
        wrong: those that are too far off, shape (P, M), bool.
        numbers: `index` of each recording, or what else names it.
        unit: says lags.
        allowed: samples by which they may be off.
        elsewhere: what is said of a loudspeaker that would explain it; "" if none would.
    """
    which: Array = np.asarray(wrong.any(axis=0))
    if not elsewhere and which.mean() > 0.5 and len(which) > 2:
        return (
            f"direct path at {naming.microphones(which)}=none where geometry puts it in "
            f"{naming.recordings(numbers, wrong.any(axis=-1))}: must be there where direct_path is "
            "present; is it removed already, are loudspeaker and microphones elsewhere, or are the "
            "sample rates of player and recorder not the same?"
        )
    most = float(off[wrong][np.abs(off[wrong]).argmax()])
    place = naming.recordings(numbers, wrong.any(axis=-1))
    return (
        f"direct path at {naming.microphones(which)}={unit(most)} off in {place}: must be within "
        f"{allowed:.1f} samples of where geometry puts it beside the others; "
        f"{elsewhere or 'is a channel delayed, or a position wrong?'}"
    )


def _common(latency: Array, doubt: Array, *, numbers: Sequence[object], unit: _Unit) -> TimeZero:
    """Return what latencies (P,), each of all microphones, say together.

    Args:
        latency: NaN where it is not seen.
        doubt: standard deviation at each microphone, shape (P, M).
        numbers: `index` of each recording, or what else names it.
        unit: says lags.
    """
    seen = np.isfinite(latency)
    usual = float(np.median(latency[seen]))
    best = np.nanmin(np.where(seen[:, None], doubt, 0.0), axis=-1)
    same = np.abs(latency - usual) <= np.maximum(2 * REST, 5 * best)
    hidden = f"; {naming.recordings(numbers, ~seen)}: not measurable at this SNR"
    hidden = "" if seen.all() else hidden
    if same[seen].all():
        late = rounded(np.full(len(latency), usual))
        if not late.any():
            right = unit(max(abs(usual), 0.05))
            return TimeZero(f"the direct path is in time, within {right}{hidden}", late)
        when = f"{unit(abs(usual))} {'later' if usual > 0 else 'earlier'}"
        return TimeZero(f"the direct path arrives {when} than geometry says{hidden}", late)

    lowest = unit(float(latency[seen].min()))
    highest = unit(float(latency[seen].max()))
    line = f"the direct path arrives {lowest} to {highest} later than geometry says"
    if not seen.all():
        where = naming.recordings(numbers, ~seen)
        lost = f"{line}, and in {where} is not measurable at this SNR: must be known of each"
        return TimeZero(line, np.zeros(len(latency)), (lost,))
    return TimeZero(line, rounded(latency))


def rounded(latency: Array) -> Array:
    """Return latencies without a rest of at most `REST` beyond whole samples."""
    whole = np.round(latency)
    return np.where(np.abs(latency - whole) <= REST, whole, latency)
