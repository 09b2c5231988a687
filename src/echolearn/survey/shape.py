"""The direct path in pieces: samples that were lost while it arrived.

    z(n) = sum_m g_m y_m(n + l_m),   a_q(l) = sum_n z(n + l) s_q(n) / (sum_m g_m^2 ||s_q||^2)

The burst is cut into pieces s_q, each of which must arrive with the others, so that a_q(0) is as
large as theirs; l_m is the direct path's lag, g_m its gain. Pieces after a loss arrive as many
samples earlier as were lost, and what the whole burst then tells of time zero is wrong. How large
a piece of a sweep is by itself depends on the loudspeaker, so it is compared with those of other
recordings; pieces of noise are compared with one another.
"""

from typing import NamedTuple

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, Probe
from echolearn.survey import naming
from echolearn.survey.time_zero import Direct

PIECES = 16

NEAR = 4
"""Samples by which a piece may be off: a clock that is 2 in 1000 fast shifts the last by 3."""

FAR = 2048
"""Samples within which a piece is sought elsewhere."""

MISSING = 0.4
THERE = 0.6
"""Share of what is expected below which a piece is missing, and from which it is found."""

ALIKE = 0.2
"""Share of the usual power that each piece of a burst of noise has in each quarter of its band."""

SURE = 7.0
"""Standard deviations of the noise by which a piece must be missing."""


class Shape(NamedTuple):
    """The pieces of one recording's direct path; NaN where it is not seen, or not recorded.

    Attributes:
        parts: a_q near lag 0, shape (PIECES,).
        doubt: standard deviations of a_q, shape (PIECES,).
        moved: samples by which a piece is off that is missing where it should be; 0 if none is.
    """

    parts: Array
    doubt: Array
    moved: float


def shape_of(samples: Array, probe: Probe, *, direct: Direct, lags: Array) -> Shape:
    """Return the shape of a recording's direct path.

    Args:
        samples: shape (M, N).
        probe: what was emitted.
        direct: the direct path as it was found.
        lags: where geometry puts it, shape (M,), in samples.
    """
    gain = np.nan_to_num(direct.height) / np.sqrt(probe.energy)
    if not gain.any():
        return Shape(np.full(PIECES, np.nan), np.full(PIECES, np.nan), 0.0)
    length = len(probe.samples)
    # Samples beyond either end are silence.
    starts = np.rint(np.nan_to_num(direct.latency) + lags).astype(int) + length
    around = np.pad(samples, ((0, 0), (length + FAR, length + FAR)))
    rows = zip(around, starts, gain, strict=True)
    together = sum(g * y[start : start + length + 2 * FAR] for y, start, g in rows if g)

    edges = np.linspace(0, length, PIECES + 1).astype(int)
    places = np.arange(length)
    piece = (places >= edges[:-1, None]) & (places < edges[1:, None])
    bursts = probe.samples * piece
    size = fft.next_fast_len(length + 2 * FAR, real=True)
    found = fft.irfft(fft.rfft(together, size) * fft.rfft(bursts, size).conj(), size)
    energy = np.sum(bursts**2, axis=-1)
    power = float(np.sum(gain**2))
    found = found[:, : 2 * FAR + 1] / (power * np.maximum(energy, 1e-300)[:, None])
    noise = np.sqrt(np.sum((gain * direct.noise) ** 2))
    doubt = noise / (power * np.sqrt(np.maximum(energy, 1e-300)))
    # Noise that is not white disturbs pieces differently, as echoes do.
    for beside in (found[:, : FAR - NEAR], found[:, FAR + NEAR + 1 :]):
        doubt = np.maximum(doubt, np.sqrt(np.mean(beside**2, axis=-1)))
    # A recording may have begun after the burst, or ended before it.
    first = int(starts[gain != 0].min()) - length
    last = int(starts[gain != 0].max()) - length
    heard = (edges[:-1] + first >= 0) & (edges[1:] + last <= samples.shape[-1])
    near = np.where(heard, found[:, FAR - NEAR : FAR + NEAR + 1].max(axis=-1), np.nan)
    return Shape(near, doubt, _moved(found, near, doubt=doubt))


def _moved(found: Array, near: Array, *, doubt: Array) -> float:
    """Return by how many samples a piece is off that is missing where it should be; 0 if none.

    Args:
        found: a_q at lags -FAR ... FAR, shape (PIECES, 2 FAR + 1).
        near: a_q near lag 0, shape (PIECES,).
        doubt: standard deviation of a_q, shape (PIECES,).
    """
    if not np.isfinite(near).any():
        return 0.0
    usual = np.nanmax(near)
    best = found.argmax(axis=-1)
    highest = found[np.arange(PIECES), best]
    gone = (near < MISSING * usual) & (highest > THERE * usual) & (highest > SURE * doubt)
    if not gone.any():
        return 0.0
    # Most pieces behind a loss are off by the same.
    return float(np.median(best[gone]) - FAR)


def broken(shape: Shape, *, alike: bool) -> Array:
    """Tell in which recordings, fields (P, ...), samples are lost from the direct path, (P,).

    Args:
        shape: of every recording.
        alike: whether the pieces of the burst sound alike; what is missing in every recording
            else is the loudspeaker's.
    """
    moved: Array = np.asarray(shape.moved) != 0
    parts = np.asarray(shape.parts)
    known = np.isfinite(parts).any(axis=-1)
    if not known.any() or (not alike and known.sum() < 3):
        return moved
    parts = np.where(known[:, None], parts, 0.0)
    with np.errstate(invalid="ignore"):
        usual = np.nanmax(parts, axis=-1, keepdims=True) if alike else np.nanmedian(parts, axis=0)
        # The largest of noisy pieces is too large by their noise, whichever piece it is.
        doubt = np.max(shape.doubt, axis=-1, keepdims=True)
        gone = (parts < MISSING * usual) & (usual - parts > SURE * np.sqrt(2) * doubt)
    return moved | gone.any(axis=-1)


def pieces_alike(burst: Array) -> bool:
    """Tell whether all pieces of a burst (L,) have a share of each quarter of its band."""
    size = max(len(burst) // PIECES, 8)
    pieces = burst[: len(burst) // size * size].reshape(-1, size)
    power = np.abs(np.fft.rfft(pieces, axis=-1)) ** 2
    bands = np.array([band.sum(axis=-1) for band in np.array_split(power, 4, axis=-1)])
    return bool((bands > ALIKE * bands.mean(axis=-1, keepdims=True)).all())


def judge_shape(shape: Shape, burst: Array, *, numbers: tuple[int, ...]) -> tuple[str, ...]:
    """Return the line on recordings that lost a part of the direct path; none if none did.

    Args:
        shape: of every recording, fields (P, ...).
        burst: what was emitted, shape (L,).
        numbers: `index` of each recording.
    """
    lost = broken(shape, alike=pieces_alike(burst))
    if not lost.any():
        return ()
    moved = np.asarray(shape.moved)[lost]
    most = float(moved[np.abs(moved).argmax()])
    much = f"{abs(most):.0f} samples" if most else "parts of the burst"
    return (
        f"lost within the direct path={much} in {naming.recordings(numbers, lost)}: the burst must "
        "arrive as a whole; did the recorder drop a buffer?",
    )
