"""The tensors of an echo: what networks look at, from the matched filters around its place.

`covariance_gated` and `covariance_steered` average Y Y^H over a band and scale it to its trace, so
level and pulse are lost, and what is left is how coherent the microphones are. Two things are
coherent: an echo, and a side lobe of the burst's autocorrelation that a louder echo outside the
search window leaves in it. A network that sees coherence alone takes one for the other.

`covariance_steered_ideal` therefore has one more microphone, which hears an ideal echo,

    r_0(k) = a(k) / a(0) sqrt(mean_tau r_1(tau)^2),    a the probe's autocorrelation,

r_1 over the search window. Its diagonal entry beside the others tells the echo's level against what
else is in the window, whatever the recording's gain; the entries beside it tell in which bands the
echo has the pulse's shape, which a side lobe has not.
"""

from collections.abc import Collection

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array
from echolearn.localization import beamforming
from echolearn.localization.correlations import PAD, echo_model
from echolearn.localization.matched_filter import SEGMENT, MatchedFilter, align, cut


def echo_covariances(
    matched: MatchedFilter, index: Array, *, toward: Array, names: Collection[str]
) -> dict[str, Array]:
    """Return the covariances about an echo of each observation that `names` want, some besides.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
        names: what is wanted.
    """
    if not any(name.startswith("covariance_") for name in names):
        return {}
    segments = {
        "covariance_gated": cut(matched.padded, index),
        "covariance_steered": align(matched, index, toward=toward),
    }
    if "covariance_steered_ideal" in names:
        heard = [segments["covariance_steered"], ideal_echo(matched)]
        segments["covariance_steered_ideal"] = np.concatenate(heard, axis=1)
    return {name: segment_covariance(segment) for name, segment in segments.items()}


def segment_covariance(segment: Array) -> Array:
    """Return the packed covariances of matched filters around an echo, (B, M, `SEGMENT`)."""
    window = np.hanning(SEGMENT + 1)[:-1]
    spectrum = fft.rfft(segment * window)[..., None]
    return beamforming.band_average(beamforming.covariance(spectrum))


def ideal_echo(matched: MatchedFilter) -> Array:
    """Return the probe's autocorrelation at the rms of r_1 in the window, (B, 1, `SEGMENT`)."""
    size = PAD + SEGMENT // 2
    pulse = echo_model(matched.observation.probe.samples, np.zeros((1, 1)), size=size)[0, 0]
    level = np.sqrt(np.mean(np.square(matched.correlation[:, 0]), axis=-1))
    # Lag 0 lies in the middle of the segment, where `align` puts the echo.
    return level[:, None, None] * (pulse[-SEGMENT:] / pulse[PAD])
