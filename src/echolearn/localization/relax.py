"""Several echoes at once: subtract, estimate again, all on the matched filters.

A recording that is a sum of echoes has correlations that are sums of the probe's autocorrelation a,

    r_m(t) = sum_q g_q a(t - tau_q - eta_m(phi_q)) + noise,

so an echo is subtracted from a recording by subtracting one a from 300 lags, and everything below
is exact without ever touching the recording again.

RELAX (Li, Stoica 1996): the strongest echo; then the strongest of what it leaves; then each again
on what the others leave, until the residual's energy changes by less than epsilon of itself; then
the next.

EM (Saqib, Gannot, Jensen 2020), beta = 1 / R, from RELAX's echoes:

    E:  x_{r,m} = g_r s(n - tau_r - eta_m(phi_r)) + beta (y_m - sum_q g_q s(n - tau_q -
        eta_m(phi_q)))
    M:  (tau, phi)_r = argmax sum_m w_m <x_{r,m}(n + eta_m(phi)), s(n - tau)>,   g_r that sum / (||s||^2 sum_m w_m)
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array
from echolearn.localization.beamforming import PAD
from echolearn.localization.search import Peak, Search

PHASES = 64
"""Tabled fractions of a sample; linear interpolation between them is exact to 3e-4 of the peak."""

ROUNDS = 50
"""Most rounds of RELAX after each new echo."""


def relax(
    padded: Array,
    search: Search,
    *,
    echoes: int,
    burst: Array,
    energy: Array,
    epsilon: float = 1e-4,
    surface: Array | None = None,
) -> list[Peak]:
    """Return R echoes of each observation by RELAX.

    Args:
        padded: correlations, shape (B, M, L + 2 PAD).
        search: over them.
        echoes: R.
        burst: the probe's samples.
        energy: of each recording, shape (B, M).
        epsilon: relative change of the residual's energy that ends the rounds.
        surface: J of `padded` on the search's grid, shape (B, A, L), where it is known already.
    """
    peaks = [search(padded, surface)]
    models = [heard(peaks[0], search, burst, padded.shape[-1])]
    for count in range(2, echoes + 1):
        peaks.append(replace(peaks[0], gain=np.zeros(len(padded)), height=np.zeros(len(padded))))
        models.append(np.zeros_like(padded))
        rows, before = np.arange(len(padded)), np.full(len(padded), np.inf)
        for _ in range(ROUNDS):
            for r in reversed(range(count)):
                others = sum(models[q][rows] for q in range(count) if q != r)
                _put(
                    peaks,
                    models,
                    r,
                    rows=rows,
                    found=_some(search, rows)(padded[rows] - others),
                    how=(search, burst),
                )
            rest = residual(padded, search, peaks, models=models, energy=energy)
            moving = before - rest >= epsilon * np.where(np.isfinite(before), before, 0.0)
            rows, before = rows[moving[rows]], rest
            if not len(rows):
                break
    return peaks


def expect_maximize(
    padded: Array, search: Search, starts: Sequence[Peak], *, burst: Array, iterations: int
) -> list[Peak]:
    """Return the echoes that EM reaches from `starts` in at most `iterations`; a fixed point is
    left as it is.
    """
    peaks = list(starts)
    models = [heard(peak, search, burst, padded.shape[-1]) for peak in peaks]
    rows = np.arange(len(padded))
    for _ in range(iterations):
        rest = (padded[rows] - sum(model[rows] for model in models)) / len(peaks)
        found = [_some(search, rows)(model[rows] + rest) for model in models]
        moved = np.zeros(len(rows), dtype=bool)
        for r, peak in enumerate(found):
            moved |= differs(peak, _some_peak(peaks[r], rows))
            _put(peaks, models, r, rows=rows, found=peak, how=(search, burst))
        rows = rows[moved]
        if not len(rows):
            break
    return peaks


def differs(peak: Peak, former: Peak) -> Array:
    """Tell which echoes have moved by more than 1e-4 samples, rad, or of their gain, shape (B,),
    bool.
    """
    still = np.isclose(peak.lag, former.lag, rtol=0, atol=1e-4) & np.isclose(
        peak.gain, former.gain, rtol=1e-4, atol=0
    )
    return ~(still & (np.abs(np.sin(peak.azimuth - former.azimuth)) < 1e-4))


def heard(peak: Peak, search: Search, burst: Array, size: int) -> Array:
    """Return the correlations that echoes (B,) have with the probe: g a(t - tau - eta_m(phi)),
    shape (B, M, size).
    """
    delays = search.delays(peak.lag, peak.azimuth, peak.elevation)
    if search.spatial is not None:
        return search.spatial.heard(peak.gain, delays, size)
    table = _autocorrelation(np.asarray(burst, dtype=float).tobytes(), size)
    reach = table.shape[-1] // 2
    whole = np.floor(delays)
    row, part = np.divmod((delays - whole) * PHASES, 1.0)
    lags = np.arange(size) - PAD - whole.astype(int)[..., None] + reach
    lags = np.clip(lags, 0, 2 * reach)
    lower, upper = (
        table[row.astype(int)[..., None], lags],
        table[row.astype(int)[..., None] + 1, lags],
    )
    return peak.gain[:, None, None] * (lower + part[..., None] * (upper - lower))


def residual(
    padded: Array, search: Search, peaks: Sequence[Peak], *, models: Sequence[Array], energy: Array
) -> Array:
    """Return the weighted energy that echoes leave: ||y||^2 - sum_q g_q <y + rest, s_q>, shape (B,)."""
    left = (search.weights * energy).sum(axis=-1)
    both = 2 * padded - sum(models)
    for peak in peaks:
        alike = search.read(both, peak.lag, peak.azimuth, peak.elevation)
        left = left - peak.gain * (search.weights * alike).sum(axis=-1)
    return left


def _some(search: Search, rows: Array) -> Search:
    return replace(search, weights=search.weights[rows])


def _some_peak(peak: Peak, rows: Array) -> Peak:
    return Peak(*(getattr(peak, f.name)[rows] for f in fields(Peak)))


def _put(
    peaks: list[Peak],
    models: list[Array],
    r: int,
    *,
    rows: Array,
    found: Peak,
    how: tuple[Search, Array],
) -> None:
    """Put echoes of some rows, and what is heard of them, in their places."""
    columns = {f.name: np.array(getattr(peaks[r], f.name)) for f in fields(Peak)}
    for name, column in columns.items():
        column[rows] = getattr(found, name)
    peaks[r] = Peak(**columns)
    models[r][rows] = heard(found, how[0], how[1], models[r].shape[-1])


@lru_cache(maxsize=4)
def _autocorrelation(burst: bytes, size: int) -> Array:
    """Return a(k - p / PHASES) for p = 0 ... PHASES and lags k around 0, shape (PHASES + 1, 2 reach
    + 1).
    """
    samples = np.frombuffer(burst)
    reach = size + 8 * PAD
    length = fft.next_fast_len(2 * (len(samples) + reach), real=True)
    power = np.abs(fft.rfft(samples, length)) ** 2
    late = np.arange(PHASES + 1)[:, None] / PHASES * 2 * np.pi * np.fft.rfftfreq(length)
    table = fft.irfft(power * np.exp(-1j * late), length)
    return np.concatenate([table[:, -reach:], table[:, : reach + 1]], axis=-1)
