"""Each of several echoes as the others leave it: the view by which an echo is described and judged.

A recording with R echoes has correlations r_m(t) = sum_q g_qm a(t - tau_q - eta_m(phi_q)) + noise,
a the probe's autocorrelation. The gains g_qm are fitted to each microphone by itself, so that at
every echo's own sample nothing is left:

    r_m(t_p) = sum_q g_qm a(t_p - tau_q - eta_m(phi_q)),      t_p the sample nearest to tau_p + eta_m(phi_p).

That takes neither the estimator's gain nor its direction on trust: where a direction is wrong, its
echo is not found at the other microphones, and little is taken from them. Two echoes that one
microphone hears at the same time share what is there. What remains when all echoes but one are
subtracted is what a recording with that one echo would have given.
"""

import numpy as np

from echolearn.acoustics.types import Array, Echoes
from echolearn.localization import beamforming
from echolearn.localization.matched_filter import MatchedFilter, joint_search
from echolearn.localization.relax import heard
from echolearn.localization.search import Peak, Search

TOGETHER = 0.1
"""Singular values of the fit, relative to the largest, below which echoes count as one."""


def apart(matched: MatchedFilter, echoes: Echoes) -> list[MatchedFilter]:
    """Return a view for each of R echoes (B, R) in which the others have been subtracted; R = 1 is
    the view itself.
    """
    count = echoes.toa.shape[1]
    if count == 1:
        return [matched]
    search = joint_search(matched)
    peaks = [_unit(matched, echoes, r) for r in range(count)]
    shapes = np.stack([_shape(matched, search, peak) for peak in peaks], axis=2)
    places = np.stack(
        [np.rint(search.delays(p.lag, p.azimuth, p.elevation)) for p in peaks], axis=-1
    ).astype(int)
    places = np.clip(places + beamforming.PAD, 0, matched.padded.shape[-1] - 1)
    parts = fitted(matched.padded, shapes, places)[..., None] * shapes
    rest = matched.padded - parts.sum(axis=2)
    return [matched.having(rest + parts[:, :, r]) for r in range(count)]


def fitted(padded: Array, shapes: Array, places: Array) -> Array:
    """Return the gains that leave nothing at each echo's sample, shape (B, M, R).

    Args:
        padded: correlations, shape (B, M, L).
        shapes: those of echoes of gain 1, shape (B, M, R, L).
        places: samples of the echoes, shape (B, M, R).
    """
    system = np.take_along_axis(
        shapes, places[:, :, None, :], axis=-1
    )  # [.., q, p]: echo q at the sample of p
    there = np.take_along_axis(padded, places, axis=-1)
    inverse = np.linalg.pinv(np.swapaxes(system, -1, -2), rcond=TOGETHER)
    return (inverse @ there[..., None])[..., 0]


def _unit(matched: MatchedFilter, echoes: Echoes, r: int) -> Peak:
    """Return echo number r of each observation with gain 1."""
    lag = echoes.toa[:, r] * matched.observation.probe.sample_rate - matched.first
    one = np.ones(len(lag))
    return Peak(lag, echoes.azimuth[:, r], echoes.elevation[:, r], one, one)


def _shape(matched: MatchedFilter, search: Search, peak: Peak) -> Array:
    return heard(peak, search, matched.observation.probe.samples, matched.padded.shape[-1])
