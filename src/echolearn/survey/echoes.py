"""What the echoes of one recording say of its microphones, the direct path subtracted.

Signs of the strongest echo tell which microphone is wired the other way. Sound that reaches two
channels at the same instant, at all frequencies alike, did not come through air:

    rho_ij = sum_f Re(Y_i conj(Y_j)) / P,   P(f) the mean power of all channels

is 1 for channels that are one, and a little for those that leak into one another.
"""

from typing import NamedTuple

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.survey.arrivals import SEEN, Arrivals, largest
from echolearn.survey.exchange import strongest
from echolearn.survey.time_zero import Direct

AFTER = 32
"""Samples after the direct path at which echoes begin."""

NEAR = 8
"""Lags on either side of an arrival in which the halves of its burst are sought."""


class Echo(NamedTuple):
    """What the strongest echo of one recording says.

    Attributes:
        seen: height over the noise at each microphone, shape (M,).
        sign: of the echo at each microphone, shape (M,); 0 where it is not seen.
        lag: of the largest |r| of each microphone by itself, shape (M,), in samples.
        score: of that as a normalised correlation, shape (M,).
        louder, path, azimuth: of the strongest echoes, as `exchange` has them, shape (ECHOES, ...);
            the path in samples since the emission.
        alike: rho between microphones, shape (M, M).
        drift: rate of the recorder's clock against the player's less 1; NaN if not measured.
    """

    seen: Array
    sign: Array
    lag: Array
    score: Array
    louder: Array
    path: Array
    azimuth: Array
    alike: Array
    drift: float


def measure_echoes(
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
    crest, highest = largest(found.outputs)
    burst = crest - found.zero
    start = found.zero
    if direct is not None:
        late = np.nan_to_num(direct.latency) + lags
        found = found.without(np.nan_to_num(direct.height), late)
        start += int(late.max()) + AFTER
    outputs = found.outputs[:, start:]
    loudest = int((np.abs(outputs).max(axis=-1) / found.noise).argmax())

    # What the others hear of an echo lies as near as the array is wide.
    reach = int(np.ceil(2 * scale * array.reach)) + 2
    place = int(np.abs(outputs[loudest]).argmax())
    _, height = wave(outputs, place, reach=reach)
    seen = np.abs(height) / found.noise
    echoes = strongest(outputs, found.noise, positions=array.positions * scale)
    return Echo(
        seen=seen,
        sign=np.where(seen > SEEN, np.sign(height), 0.0),
        lag=burst,
        score=scores(samples, burst, heights=highest, length=len(found.probe.samples)),
        louder=echoes.louder,
        path=echoes.lag + start - found.zero,
        azimuth=echoes.azimuth,
        alike=instant(samples, found),
        drift=drift(samples, burst, probe=found.probe),
    )


def wave(outputs: Array, place: int, *, reach: int) -> tuple[Array, Array]:
    """Return where each microphone has its largest |r| near a place, and r there, each (M,).

    Args:
        outputs: of the matched filter, shape (M, K).
        place: of an echo at one microphone.
        reach: lags on either side within which it is at the others.
    """
    low = max(place - reach, 0)
    near = outputs[:, low : place + reach + 1]
    return largest(near)


def scores(samples: Array, lags: Array, *, heights: Array, length: int) -> Array:
    """Return |r| at crests as a normalised correlation, shape (M,).

    Args:
        samples: the recording, shape (M, N).
        lags: of the crests, shape (M,), in samples.
        heights: r there, shape (M,).
        length: of the burst.
    """
    starts = np.maximum(np.rint(lags).astype(int), 0)
    rows = zip(samples, starts, strict=True)
    energy = np.array([np.sum(channel[start : start + length] ** 2) for channel, start in rows])
    return np.abs(heights) / np.sqrt(np.where(energy > 0, energy, np.inf))


def instant_correlation(spectrum: Array) -> Array:
    """Return rho between all microphones from spectra (M, F), 0 to itself, shape (M, M)."""
    # Real and imaginary parts side by side: only the real part of products is wanted.
    parts = np.ascontiguousarray(spectrum).view(float)
    power = np.mean(parts**2, axis=0).reshape(-1, 2).sum(axis=-1)
    white = parts / np.repeat(np.sqrt(np.maximum(power, 1e-12 * power.max() + 1e-300)), 2)
    cross = white @ white.T
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
    whole = instant_correlation(found.spectrum)
    tail = instant_correlation(fft.rfft(samples[:, -samples.shape[-1] // 4 :]))
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
    starts = np.rint(lags).astype(int) - NEAR
    size = 2 * half + 2 * NEAR
    whole = (starts >= 0) & (starts + size <= samples.shape[-1])
    if not whole.any():
        return float("nan")
    stretches = samples[np.flatnonzero(whole)[:, None], starts[whole, None] + np.arange(size)]
    windows = np.lib.stride_tricks.sliding_window_view(stretches, half, axis=-1)
    first, _ = largest(windows[:, : 2 * NEAR + 1] @ probe.samples[:half])
    second, _ = largest(windows[:, half:] @ probe.samples[half : 2 * half])
    return float(np.median(second - first) / half)
