"""How far microphones agree on an echo, and how far it stands out from its competitors.

What a column says of a level (a peak over the noise, over the energy of the recording) shifts from
simulated to measured rooms with whatever else there is to hear. Comparisons within one recording
hardly do. With r_m(tau) the matched filters of M microphones in the search window, z_m(k) =
r_m(toa + eta_m(doa) + k) those aligned at the echo (`tensors.align`), a_m = z_m(0), and J and the
gated power G as in `matched_filter`:

    level            sin(elevation): 1 in the array's plane, 0 on its axis
    exceeded         mean_m of the share of lags tau at which |r_m(tau)| > a_m, a rank
    agreement        mean_{p != q} u_p . u_q,  u_m = z_m / |z_m| over |k| <= CLOSE
    coherence_wide   sum_k (sum_m z_m(k))^2 / (M sum_k sum_m z_m(k)^2)  over |k| <= WIDE
    peak_offset      mean_m |argmax_k z_m(k)|  over |k| <= NEAR
    peak_share       sum_m a_m / sum_m max_k z_m(k)  over |k| <= NEAR
    direction_second max G(toa, phi) of phi APART and more from the doa, over G(toa, doa)
    joint_second     max J(tau, phi) of tau `PEAK_SPACING` lags or more from toa, over J(toa, doa)

An agreement over CLOSE lags is that of the pulse itself; WIDE takes in the echo that a rough wall
has smeared. NEAR is where a microphone's own peak can be if it is displaced, or late, or of an echo
that is not flat.
"""

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array
from echolearn.localization.correlations import ratio_or_zero
from echolearn.localization.matched_filter import PEAK_SPACING, SEGMENT, MatchedFilter, align

CLOSE = 4
"""Lags on either side of an echo over which pairs of microphones are compared."""

WIDE = 8
"""Lags on either side of a smeared echo."""

NEAR = 6
"""Lags on either side of an echo within which a microphone's own peak is sought."""

APART = np.deg2rad(30.0)
"""Angle to an echo's direction from which on another direction competes with it, in rad."""


def agreement_columns(matched: MatchedFilter, index: Array, *, toward: Array) -> dict[str, Array]:
    """Return the columns of one echo per observation, fields (B,), all without a level.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    aligned = align(matched, index, toward=toward)
    here = lags_about_echo(aligned, 0)[..., 0]
    return {
        "level": np.hypot(toward[:, 0], toward[:, 1]),
        "exceeded": exceeded(matched.correlation, here),
        "agreement": agreement(lags_about_echo(aligned, CLOSE)),
        "coherence_wide": mean_coherence(lags_about_echo(aligned, WIDE)),
        **own_peaks(lags_about_echo(aligned, NEAR)),
        "direction_second": direction_second(matched, index, toward=toward),
        "joint_second": joint_second(matched, index, here=here.sum(axis=-1)),
    }


def lags_about_echo(aligned: Array, lags: int) -> Array:
    """Return aligned outputs (..., SEGMENT) at `lags` on either side, (..., 2 lags + 1)."""
    middle = SEGMENT // 2
    return aligned[..., middle - lags : middle + lags + 1]


def exceeded(correlation: Array, here: Array) -> Array:
    """Return the mean share of lags of (B, M, L) that are larger than those at the echo (B, M)."""
    return np.mean(np.abs(correlation) > here[..., None], axis=(-2, -1))


def agreement(aligned: Array) -> Array:
    """Return the mean correlation of pairs of microphones, -1 / (M - 1) to 1, from (B, M, K)."""
    # Each microphone counts the same, however loud it is.
    unit = ratio_or_zero(aligned, np.linalg.norm(aligned, axis=-1, keepdims=True))
    count = aligned.shape[-2]
    total = np.sum(unit.sum(axis=-2) ** 2, axis=-1)
    return (total - np.sum(unit**2, axis=(-2, -1))) / (count * (count - 1))


def mean_coherence(aligned: Array) -> Array:
    """Return the share of the energy of (B, M, K) that the sum of microphones has, 0 to 1."""
    together = np.sum(aligned.sum(axis=-2) ** 2, axis=-1)
    return ratio_or_zero(together, aligned.shape[-2] * np.sum(aligned**2, axis=(-2, -1)))


def own_peaks(aligned: Array) -> dict[str, Array]:
    """Return how far from the echo, and how much higher, microphones have their own peaks.

    Args:
        aligned: shape (B, M, 2 NEAR + 1).
    """
    return {
        "peak_offset": np.mean(np.abs(aligned.argmax(axis=-1) - NEAR), axis=-1),
        "peak_share": ratio_or_zero(
            aligned[..., NEAR].sum(axis=-1), aligned.max(axis=-1).sum(axis=-1)
        ),
    }


def direction_second(matched: MatchedFilter, index: Array, *, toward: Array) -> Array:
    """Return the power of the strongest other direction over that of the echo's, shape (B,).

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    gated = matched.gated_power(index).astype(float)
    cosine = toward @ direction(*matched.directions).T
    own = np.take_along_axis(gated, cosine.argmax(axis=-1)[:, None], axis=-1)[:, 0]
    # A grid has directions that are just so far apart, give or take the last bit.
    competing = cosine <= np.cos(APART) + 1e-9
    other = np.max(gated, axis=-1, where=competing, initial=0.0)
    return ratio_or_zero(other, own)


def joint_second(matched: MatchedFilter, index: Array, *, here: Array) -> Array:
    """Return the largest J at another time over that of the echo, shape (B,).

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        here: J of the echoes, shape (B,).
    """
    highest = matched.steered.max(axis=-2).astype(float)
    elsewhere = np.abs(np.arange(highest.shape[-1]) - index[:, None]) >= PEAK_SPACING
    return ratio_or_zero(np.max(highest, axis=-1, where=elsewhere, initial=-np.inf), here)
