"""What the echoes of one recording say of its microphones, the direct path subtracted.

The strongest echo reaches the microphones as a plane wave, at lags

    l_m = l - (u . p_m) fs / c

so lags that fit no plane, but do when two microphones change places, tell that these have. Signs of
the echo tell which microphone is wired the other way. Sound that reaches two channels at the same
instant, at all frequencies alike, did not come through air:

    rho_ij = sum_f Re(Y_i conj(Y_j)) / P,   P(f) the mean power of all channels

is 1 for channels that are one, and a little for those that leak into one another.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.survey.arrivals import SEEN, Arrivals, crest
from echolearn.survey.time_zero import Direct

AFTER = 32
"""Samples after the direct path at which echoes begin."""

FITS = 1.0
AMISS = 2.0
"""Samples, rms, up to which lags fit a plane wave, and from which they do not."""

ECHOES = 6
"""Echoes of a recording that are looked at: those of floor and ceiling reach a level ring at once,
and say nothing of who is where."""

NOBODY = (-1, -1)
"""No pair of microphones."""

NEAR = 8
"""Lags on either side of an arrival in which the halves of its burst are sought."""


class Echo(NamedTuple):
    """What the strongest echo of one recording says.

    Attributes:
        seen: height over the noise at each microphone, shape (M,).
        sign: of the echo at each microphone, shape (M,); 0 where it is not seen.
        lag: of the largest |r| of each microphone by itself, shape (M,), in samples.
        score: of that as a normalised correlation, shape (M,).
        swapped: pair of microphones whose exchange makes the lags a plane wave, or (-1, -1).
        plane: whether the lags are one as they are.
        alike: rho between microphones, shape (M, M).
        drift: rate of the recorder's clock against the player's less 1; NaN if not measured.
    """

    seen: Array
    sign: Array
    lag: Array
    score: Array
    swapped: tuple[int, int]
    plane: bool
    alike: Array
    drift: float


def measure(
    samples: Array,
    found: Arrivals,
    *,
    direct: Direct | None,
    lags: Array,
    array: MicArray,
    scale: float,
) -> Echo:
    """Return what the echoes of one recording say.

    Args:
        samples: the recording, shape (M, N).
        found: its matched filter.
        direct: its direct path, None if it holds none.
        lags: at which the direct path is expected, shape (M,), in samples.
        array: the microphones.
        scale: samples per metre of path.
    """
    strongest = [crest(each, int(np.abs(each).argmax())) for each in found.outputs]
    start = found.zero
    if direct is not None:
        late = np.nan_to_num(direct.latency) + lags
        found = found.without(np.nan_to_num(direct.height), late)
        start += int(late.max()) + AFTER
    outputs = found.outputs[:, start:]
    loudest = int((np.abs(outputs).max(axis=-1) / found.noise).argmax())

    # What the others hear of an echo lies as near as the array is wide.
    reach = int(np.ceil(2 * scale * array.radius)) + 2
    places = strongest_places(outputs[loudest], ECHOES, apart=reach)
    waves = [wave(outputs, place, reach=reach) for place in places]
    votes = [
        exchanged(where, np.abs(height) > SEEN * found.noise, positions=array.positions * scale)
        for where, height in waves
    ]
    pairs = [pair for pair, _ in votes if pair != NOBODY]
    height = waves[0][1]
    seen = np.abs(height) / found.noise
    burst = np.array([place - found.zero for place, _ in strongest])
    return Echo(
        seen=seen,
        sign=np.where(seen > SEEN, np.sign(height), 0.0),
        lag=burst,
        score=scores(samples, strongest, zero=found.zero, probe=found.probe),
        swapped=max(pairs, key=pairs.count) if pairs else NOBODY,
        plane=any(plane for _, plane in votes),
        alike=instant(samples, found),
        drift=drift(samples, burst, probe=found.probe),
    )


def strongest_places(outputs: Array, count: int, *, apart: int) -> list[int]:
    """Return the places of the largest |r| (K,), so many, no two nearer than `apart`."""
    left = np.abs(outputs)
    places = []
    for _ in range(count):
        place = int(left.argmax())
        places.append(place)
        left[max(place - apart, 0) : place + apart + 1] = 0.0
    return places


def wave(outputs: Array, place: int, *, reach: int) -> tuple[Array, Array]:
    """Return where each microphone has its largest |r| near a place, and r there, each (M,).

    Args:
        outputs: of the matched filter, shape (M, K).
        place: of an echo at one microphone.
        reach: lags on either side within which it is at the others.
    """
    low = max(place - reach, 0)
    near = outputs[:, low : place + reach + 1]
    found = [crest(each, int(np.abs(each).argmax())) for each in near]
    return np.array([where for where, _ in found]), np.array([r for _, r in found])


def scores(samples: Array, peaks: list[tuple[float, float]], *, zero: int, probe: Probe) -> Array:
    """Return |r| at crests as a normalised correlation, shape (M,).

    Args:
        samples: the recording, shape (M, N).
        peaks: place in the outputs, and r, of each microphone.
        zero: place of lag 0.
        probe: what was emitted.
    """
    found = []
    for channel, (place, r) in zip(samples, peaks, strict=True):
        start = max(round(place) - zero, 0)
        energy = float(np.sum(channel[start : start + len(probe.samples)] ** 2))
        found.append(abs(r) / np.sqrt(energy) if energy else 0.0)
    return np.array(found)


def exchanged(lags: Array, known: Array, *, positions: Array) -> tuple[tuple[int, int], bool]:
    """Return the pair whose exchange makes lags a plane wave, and whether they are one already.

    Args:
        lags: of an echo, shape (M,).
        known: microphones at which it is seen, shape (M,), bool.
        positions: in samples of path, shape (M, 3).
    """
    used = np.flatnonzero(known)
    # Without more microphones than unknowns every lag fits.
    design = np.column_stack([np.ones(len(used)), positions[used]])
    if len(used) < np.linalg.matrix_rank(design) + 2:
        return NOBODY, False
    rest = np.eye(len(used)) - design @ np.linalg.pinv(design)
    here = lags[used]
    if _rms(rest @ here) <= FITS:
        # An echo on the axis would fit in any order.
        return NOBODY, bool(np.ptp(here) > 4 * AMISS)
    if _rms(rest @ here) < AMISS:
        return NOBODY, False

    pairs = list(combinations(range(len(used)), 2))
    tried = np.tile(here, (len(pairs), 1))
    for row, (i, j) in enumerate(pairs):
        tried[row, [i, j]] = tried[row, [j, i]]
    left = np.sqrt(np.mean((tried @ rest) ** 2, axis=-1))
    best = int(left.argmin())
    if left[best] > FITS:
        return NOBODY, False
    first, second = pairs[best]
    return (int(used[first]), int(used[second])), False


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def coherence(spectrum: Array) -> Array:
    """Return rho between all microphones from spectra (M, F), 0 to itself, shape (M, M)."""
    power = np.mean(np.abs(spectrum) ** 2, axis=0)
    white = spectrum / np.sqrt(np.maximum(power, 1e-12 * power.max() + 1e-300))
    cross = (white @ white.conj().T).real
    size = np.sqrt(np.maximum(np.diag(cross), 1e-300))
    alike: Array = cross / np.outer(size, size)
    np.fill_diagonal(alike, 0.0)
    return alike


def instant(samples: Array, found: Arrivals) -> Array:
    """Return rho between microphones that holds of the whole recording and of its end, (M, M).

    Walls at equal distances reach some microphones together, but what is left at the end, the
    noise of each, no wall makes alike.

    Args:
        samples: the recording, shape (M, N).
        found: its matched filter, the direct path subtracted.
    """
    whole = coherence(found.spectrum)
    tail = coherence(fft.rfft(samples[:, -samples.shape[-1] // 4 :]))
    return np.where(np.abs(tail) < np.abs(whole), tail, whole)


def drift(samples: Array, lags: Array, *, probe: Probe) -> float:
    """Return how much faster the player's clock is than the recorder's, less 1; NaN if unknown.

    The second half of the burst comes late against the first: a clock that is one in a thousand
    slow has lost 0.75 samples over 750.

    Args:
        samples: the recording, shape (M, N).
        lags: of an arrival at each microphone, shape (M,), in samples.
        probe: what was emitted.
    """
    half = len(probe.samples) // 2
    halves = (probe.samples[:half], probe.samples[half : 2 * half])
    found = []
    for channel, lag in zip(samples, lags, strict=True):
        start = round(lag) - NEAR
        stretch = channel[max(start, 0) : start + len(probe.samples) + 2 * NEAR]
        if start < 0 or len(stretch) < len(probe.samples) + 2 * NEAR:
            continue
        parts = (stretch[: half + 2 * NEAR], stretch[half : 2 * half + 2 * NEAR])
        pairs = zip(parts, halves, strict=True)
        outputs = [np.correlate(part, burst, "valid") for part, burst in pairs]
        first, second = (crest(each, int(np.abs(each).argmax()))[0] for each in outputs)
        found.append((second - first) / half)
    return float(np.median(found)) if found else float("nan")
