"""What arrives before the first possible echo, fitted to a recording: `direct=fir`.

The direct sound as loudspeaker and microphone make it, and all that the robot's own body sends
back, are copies of the burst at lags before the search window:

    y(n) = sum_k a_k s(n - k) + rest(n),     first <= k < last

Least squares asks for no calibration: R a = r with r_k = sum_n y(n) s(n - k), the matched filter,
and R_kl = sum_n s(n - k) s(n - l), over samples that were recorded. R is Toeplitz but for the ends
of the burst that were not. By Cholesky, R = C C', z = C^-1 r, and the first K lags alone explain
the energy z_1^2 + ... + z_K^2, so one factor serves all orders K. Each recording and microphone
takes the order of the largest

    (z_1^2 + ... + z_K^2) / sigma^2 - 3 K,

an information criterion (Akaike 1974, with 2 K): a lag that explains no more than noise would is
left alone. All lags taken off a recording of noise would take their share of an echo with them, 8 %
of the energy of the paper's burst, since the burst is a little like its own later copies.
"""

import math

import numpy as np
from scipy import fft, linalg

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import check
from echolearn.survey.played import AFTER, AHEAD, FADE

BEFORE = 6
"""Lags before the direct path's at which a response may begin: between samples it rings."""

SPARED = 8
"""Lags before the search window that are left alone: an echo at its beginning rings there."""

MOST = 2048
"""Lags that are fitted, at most; their products take 32 MiB."""

PENALTY = 3.0
"""Gain in explained energy, over the noise's, that a lag must bring. Among hundreds of orders one
wins by chance at 2, Akaike's, at 3 seldom."""

RIDGE = 1e-6
"""Share of the burst's energy on the diagonal of R: where a sweep has no power, R is singular."""


def early_lags(
    probe: Probe, array: MicArray, *, window: SearchWindow, speed_of_sound: float
) -> tuple[int, int]:
    """Return the first lag that is fitted, and the one after the last.

    Args:
        probe: its sample rate.
        array: the microphones around the loudspeaker.
        window: where echoes are sought.
        speed_of_sound: in m/s.

    Raises:
        BadValue: a microphone that the burst reaches after the end of the recording.
    """
    rate = probe.sample_rate
    direct = np.linalg.norm(array.positions, axis=1) * rate / speed_of_sound
    # An echo that reaches microphone 1 within the window reaches others before it.
    reference = array.positions[0]
    ahead = np.linalg.norm(array.positions - reference, axis=1).max()
    nearest = 2 * window.nearest - np.linalg.norm(reference) - ahead
    start = math.floor(nearest * rate / speed_of_sound + 1e-9)
    first = max(int(direct.min()) - BEFORE, 0)
    inside = bool(direct.max() + BEFORE < probe.length)
    check(
        inside,
        "microphones",
        f"{array.radius:g} m",
        allowed="must hear the direct path within the recording",
    )
    # The direct sound itself goes, even where echoes are sought from its arrival on.
    last = max(start - SPARED, int(direct.max()) + BEFORE)
    return first, min(last, first + MOST, probe.length)


def early_responses(
    samples: Array,
    probe: Probe,
    *,
    lags: tuple[int, int],
    lost: int = 0,
    penalty: float = PENALTY,
) -> Array:
    """Return the gains a_k of copies of the burst in recordings, shape (..., last - first).

    Args:
        samples: recordings y, shape (..., N).
        probe: the burst s.
        lags: the first that is fitted, and the one after the last.
        lost: samples at the beginning that were not recorded.
        penalty: gain in explained energy that a lag must bring; 0 fits all.
    """
    first, last = lags
    r = signals.matched_filter(samples, probe, first=first, last=last - 1)
    factor = linalg.cholesky(_products(probe, lags=lags, lost=lost), lower=True)
    parts = _solved(factor, r)
    explained = np.cumsum(parts**2, axis=-1)

    # The noise is what no lag explains of the samples that they reach.
    reached = samples[..., lost : last + len(probe.samples)]
    rest = np.sum(reached**2, axis=-1) - explained[..., -1]
    orders = np.arange(1, last - first + 1)
    free = max(reached.shape[-1] - len(orders), 1)
    noise = np.maximum(rest, 1e-12 * explained[..., -1] + 1e-300) / free
    worth = explained / noise[..., None] - penalty * orders
    order = np.where(worth.max(axis=-1) > 0, worth.argmax(axis=-1) + 1, 0)
    chosen = np.where(orders <= order[..., None], parts, 0.0)
    return _solved(factor, chosen, transposed=True)


def without_early(samples: Array, probe: Probe, *, lags: tuple[int, int], lost: int = 0) -> Array:
    """Return recordings without what arrives at early lags, shape (..., N).

    Args:
        samples: shape (..., N).
        probe: the burst.
        lags: the first that is fitted (`early_lags`), and the one after the last.
        lost: samples at the beginning that were not recorded, and are silent.
    """
    first, _ = lags
    responses = early_responses(samples, probe, lags=lags, lost=lost)
    left = samples.copy()
    early = signals.convolve(probe.samples, responses, length=samples.shape[-1] - first)
    early[..., : max(lost - first, 0)] = 0.0
    left[..., first:] -= early
    return left


def _products(probe: Probe, *, lags: tuple[int, int], lost: int) -> Array:
    """Return R with its ridge, shape (K, K).

    Args:
        probe: the burst, and N.
        lags: the first, and the one after the last.
        lost: samples at the beginning that were not recorded.
    """
    first, last = lags
    burst = probe.samples
    size = fft.next_fast_len(len(burst) + last - first, real=True)
    alike = fft.irfft(np.abs(fft.rfft(burst, size)) ** 2, size)[: last - first]
    products = linalg.toeplitz(alike)

    # Less what copies of the burst have before the first recorded sample, and after the last.
    for start, stop in ((first, lost), (probe.length, len(burst) + last - 1)):
        if start < stop:
            place = np.arange(start, stop)[:, None] - np.arange(first, last)
            inside = (place >= 0) & (place < len(burst))
            copies = np.where(inside, burst[np.clip(place, 0, len(burst) - 1)], 0.0)
            products -= copies.T @ copies
    products[np.diag_indices(len(products))] += RIDGE * alike[0]
    return products


def _solved(factor: Array, values: Array, *, transposed: bool = False) -> Array:
    """Return C^-1 v, or C'^-1 v, of vectors v (..., K)."""
    columns = values.reshape(-1, values.shape[-1]).T
    found = linalg.solve_triangular(factor, columns, lower=True, trans=int(transposed))
    return np.ascontiguousarray(found.T).reshape(values.shape)


def loudspeaker_response(
    samples: Array, probe: Probe, *, positions: Array, last: int, speed_of_sound: float
) -> Array:
    """Return what the loudspeaker plays of an impulse, of energy 1, shape (AHEAD + AFTER + 1,).

    Args:
        samples: recordings of its direct sound, shape (..., M, N).
        probe: the burst.
        positions: microphones around the loudspeaker, shape (M, 3), in m.
        last: lag after the last at which no echo comes.
        speed_of_sound: in m/s.
    """
    ways = np.linalg.norm(positions, axis=1) * probe.sample_rate / speed_of_sound
    first = max(int(ways.min()) - AHEAD, 0)
    responses = early_responses(samples, probe, lags=(first, last), penalty=0.0)

    # What is moved to before lag 0 comes round at the end.
    size = fft.next_fast_len(responses.shape[-1] + int(ways.max()) + 2 * (AHEAD + AFTER), real=True)
    earlier = np.exp(2j * np.pi * (ways - first)[:, None] * fft.rfftfreq(size))
    moved = fft.irfft(fft.rfft(responses, size) * earlier * ways[:, None], size)
    common = moved.mean(axis=tuple(range(moved.ndim - 1)))
    response = np.roll(common, AHEAD)[: AHEAD + AFTER + 1]
    response[-FADE:] *= np.hanning(2 * FADE + 1)[FADE + 1 :]
    return np.asarray(response / np.linalg.norm(response))
