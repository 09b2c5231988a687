"""Each of several echoes as the others leave it: the view by which an echo is described.

A recording with R echoes has correlations r_m(t) = sum_q g_qm a(t - tau_q - eta_m(phi_q)) + noise,
a the probe's autocorrelation. The gains g_qm are fitted to each microphone by itself, so that at
every echo's own sample nothing is left:

    r_m(t_p) = sum_q g_qm a(t_p - tau_q - eta_m(phi_q)),
    t_p the sample nearest to tau_p + eta_m(phi_p).

That takes neither the estimator's gain nor its direction on trust: where a direction is wrong, its
echo is not found at the other microphones, and little is taken from them. Two echoes that reach one
microphone at the same time share what is there. What remains when all echoes but one are subtracted
is what a recording with that one echo would have given.
"""

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array, Echoes
from echolearn.localization.correlations import PAD, echo_model
from echolearn.localization.matched_filter import MatchedFilter, check_extent

TOGETHER = 0.1
"""Singular values of the fit, relative to the largest, below which echoes count as one."""


def separate(matched: MatchedFilter, echoes: Echoes) -> list[MatchedFilter]:
    """Return a view for each of R echoes (B, R), the others subtracted; R = 1 is that view."""
    count = echoes.toa.shape[1]
    if count == 1:
        return [matched]
    check_extent(matched)
    observation = matched.observation
    padded = matched.padded
    size = padded.shape[-1]

    # Delays of every echo at every microphone, shape (B, M, R).
    lag = echoes.toa * observation.probe.sample_rate - matched.first
    eta = matched.eta(direction(echoes.azimuth, echoes.elevation))
    delays = np.swapaxes(lag[..., None] + eta, 1, 2)

    models = [
        echo_model(observation.probe.samples, delays[..., r], size=size) for r in range(count)
    ]
    shapes = np.stack(models, axis=2)
    places = np.clip(np.rint(delays).astype(int) + PAD, 0, size - 1)
    parts = fit_gains(padded, shapes, places=places)[..., None] * shapes
    rest = padded - parts.sum(axis=2)
    return [matched.with_outputs(rest + parts[:, :, r]) for r in range(count)]


def fit_gains(padded: Array, shapes: Array, *, places: Array) -> Array:
    """Return the gains that leave nothing at each echo's sample, shape (B, M, R).

    Args:
        padded: correlations, shape (B, M, L).
        shapes: those of echoes of gain 1, shape (B, M, R, L).
        places: samples of the echoes, shape (B, M, R).
    """
    # system[..., q, p]: echo q at the sample of echo p.
    system = np.take_along_axis(shapes, places[:, :, None, :], axis=-1)
    there = np.take_along_axis(padded, places, axis=-1)
    # Two echoes at one place cannot be told from one, which they share.
    inverse = np.linalg.pinv(np.swapaxes(system, -1, -2), rcond=TOGETHER)
    return (inverse @ there[..., None])[..., 0]
