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
    M:  (tau, phi)_r = argmax sum_m w_m <x_{r,m}(n + eta_m(phi)), s(n - tau)>,
        g_r that sum / (||s||^2 sum_m w_m)
"""

from collections.abc import Sequence

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.localization.search import Peak, Search

ROUNDS = 50
"""Most rounds of RELAX after each new echo."""

EPSILON = 1e-4
"""Relative change of the residual's energy that ends the rounds."""


def relax(
    padded: Array,
    search: Search,
    *,
    echoes: int,
    energy: Array,
    surface: Array | None = None,
) -> list[Peak]:
    """Return R echoes of each observation by RELAX.

    Args:
        padded: correlations, shape (B, M, L + 2 PAD).
        search: over them.
        echoes: R.
        energy: of each recording, shape (B, M).
        surface: J of `padded` on the search's grid, shape (B, A, L), where it is known already.
    """
    peaks = [search(padded, surface)]
    models = [search.model(peaks[0], size=padded.shape[-1])]
    nothing = np.zeros(len(padded))
    for _ in range(1, echoes):
        peaks.append(peaks[0]._replace(gain=nothing, height=nothing))
        models.append(np.zeros_like(padded))
        rows = np.arange(len(padded))
        before = np.full(len(padded), np.inf)
        for _ in range(ROUNDS):
            # The newest first, since it is not estimated yet.
            for r in reversed(range(len(peaks))):
                others = sum(model[rows] for q, model in enumerate(models) if q != r)
                found = search.only(rows)(padded[rows] - others)
                _replace_rows(peaks, models, r, rows=rows, found=found, search=search)

            # Observations whose residual has settled are left alone.
            rest = residual(padded, search, peaks=peaks, models=models, energy=energy)
            moving = before - rest >= EPSILON * np.where(np.isfinite(before), before, 0.0)
            rows = rows[moving[rows]]
            before = rest
            if not len(rows):
                break
    return peaks


def expect_maximize(
    padded: Array, search: Search, *, starts: Sequence[Peak], iterations: int
) -> list[Peak]:
    """Return the echoes that EM reaches from `starts`; a fixed point is left as it is.

    Args:
        padded: correlations, shape (B, M, L + 2 PAD).
        search: over them.
        starts: R echoes of each observation to begin with.
        iterations: most of them.
    """
    peaks = list(starts)
    models = [search.model(peak, size=padded.shape[-1]) for peak in peaks]
    rows = np.arange(len(padded))
    for _ in range(iterations):
        # E: each echo gets its share of what all of them leave. M: each is searched again.
        rest = (padded[rows] - sum(model[rows] for model in models)) / len(peaks)
        found = [search.only(rows)(model[rows] + rest) for model in models]

        moved = np.zeros(len(rows), dtype=bool)
        for r, peak in enumerate(found):
            moved |= differs(peak, Peak(*np.array(peaks[r])[:, rows]))
            _replace_rows(peaks, models, r, rows=rows, found=peak, search=search)
        rows = rows[moved]
        if not len(rows):
            break
    return peaks


def differs(peak: Peak, former: Peak) -> Array:
    """Tell which echoes have moved by more than 1e-4 samples, rad, or of their gain, (B,), bool."""
    lag = np.isclose(peak.lag, former.lag, rtol=0, atol=1e-4)
    gain = np.isclose(peak.gain, former.gain, rtol=1e-4, atol=0)
    azimuth = np.abs(np.sin(peak.azimuth - former.azimuth)) < 1e-4
    return ~(lag & gain & azimuth)


def residual(
    padded: Array, search: Search, *, peaks: Sequence[Peak], models: Sequence[Array], energy: Array
) -> Array:
    """Return the energy that echoes leave: ||y||^2 - sum_q g_q <y + rest, s_q>, shape (B,).

    Args:
        padded: correlations, shape (B, M, L + 2 PAD).
        search: over them.
        peaks: the echoes.
        models: correlations of each, shape (B, M, L + 2 PAD).
        energy: of each recording, shape (B, M).
    """
    left = (search.weights * energy).sum(axis=-1)
    both = 2 * padded - sum(models)
    for peak in peaks:
        alike = search.read(both, peak[:3])
        left = left - peak.gain * (search.weights * alike).sum(axis=-1)
    return left


def _replace_rows(
    peaks: list[Peak], models: list[Array], r: int, *, rows: Array, found: Peak, search: Search
) -> None:
    """Put what was found for some observations in place of their echo number r, and its model."""
    columns = np.array(peaks[r])
    columns[:, rows] = found
    peaks[r] = Peak(*columns)
    models[r][rows] = search.model(found, size=models[r].shape[-1])
