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
from echolearn.localization.silence import energies

ROUNDS = 50
"""Most rounds of RELAX after each new echo."""

EPSILON = 1e-4
"""Relative change of the residual's energy that ends the rounds."""


def relax(search: Search, echoes: int) -> list[Peak]:
    """Return R echoes of each observation by RELAX."""
    padded = search.padded
    energy = energies(search.view.observation.samples[:, : padded.shape[1]])
    models = np.zeros((echoes, *padded.shape))
    peaks: Array = np.zeros((echoes, len(Peak._fields), len(padded)))
    strongest = search()
    peaks[0] = strongest
    models[0] = search.model(strongest)
    for count in range(2, echoes + 1):
        rows = np.arange(len(padded))
        before = np.full(len(padded), np.inf)
        for _ in range(ROUNDS):
            # The newest first, since it is not estimated yet.
            for r in reversed(range(count)):
                others = sum(model[rows] for q, model in enumerate(models) if q != r)
                found = search.only(rows)(padded[rows] - others)
                peaks[r][:, rows] = found
                models[r][rows] = search.model(found)

            # Observations whose residual has settled are left alone.
            rest = residual(search, peaks=peaks[:count], models=models, energy=energy)
            moving = before - rest >= EPSILON * np.where(np.isfinite(before), before, 0.0)
            rows = rows[moving[rows]]
            before = rest
            if not len(rows):
                break
    return [Peak(*columns) for columns in peaks]


def expect_maximize(search: Search, starts: Sequence[Peak], *, iterations: int) -> list[Peak]:
    """Return the echoes that EM reaches; a fixed point is left as it is.

    Args:
        search: over the matched filters.
        starts: R echoes of each observation to begin with.
        iterations: most of them.
    """
    padded = search.padded
    peaks: Array = np.array(starts)
    models = np.stack([search.model(peak) for peak in starts])
    rows = np.arange(len(padded))
    for _ in range(iterations):
        # E: each echo gets its share of what all of them leave. M: each is searched again.
        rest = (padded[rows] - sum(models[:, rows])) / len(peaks)
        found = [search.only(rows)(model[rows] + rest) for model in models]

        moved = np.zeros(len(rows), dtype=bool)
        for r, peak in enumerate(found):
            moved |= differs(peak, Peak(*peaks[r][:, rows]))
            peaks[r][:, rows] = peak
            models[r][rows] = search.model(peak)
        rows = rows[moved]
        if not len(rows):
            break
    return [Peak(*columns) for columns in peaks]


def differs(peak: Peak, former: Peak) -> Array:
    """Tell which echoes have moved by more than 1e-4 samples, rad, or of their gain, (B,), bool."""
    lag = np.isclose(peak.lag, former.lag, rtol=0, atol=1e-4)
    gain = np.isclose(peak.gain, former.gain, rtol=1e-4, atol=0)
    azimuth = np.abs(np.sin(peak.azimuth - former.azimuth)) < 1e-4
    return ~(lag & gain & azimuth)


def residual(search: Search, *, peaks: Array, models: Array, energy: Array) -> Array:
    """Return the energy that echoes leave: ||y||^2 - sum_q g_q <y + rest, s_q>, shape (B,).

    Args:
        search: over the matched filters.
        peaks: columns of the echoes, shape (R, 5, B).
        models: correlations of each, shape (R, B, M, L + 2 PAD).
        energy: of each recording, shape (B, M).
    """
    left = (search.weights * energy).sum(axis=-1)
    both = 2 * search.padded - sum(models)
    for peak in peaks:
        lag, azimuth, elevation, gain, _ = peak
        alike = search.read(both, (lag, azimuth, elevation))
        left = left - gain * (search.weights * alike).sum(axis=-1)
    return left
