"""S-NLS with the echo-gated direction: from the matched filters around the estimated time only.

TOA: S-NLS (Eq. 13); several echoes by RELAX. DOA: the strongest beam on the matched-filter outputs
aligned for phi, z_k = r_m(tau + k + eta_m(phi)), |k| <= GATE, M-vectors:

- `das`, delay-and-sum: argmax over phi of sum_k (1' z_k)^2 = sum_k J(tau + k, phi)^2;
- `mpdr`: argmax of 1 / (1' R_bar^-1 1), R_bar from Eq. 18 and R = sum_k z_k z_k', the steered
  minimum variance beamformer (Krolik, Swingler 1989), which takes one covariance per direction
  because an echo is not narrowband.

The matched filter has concentrated the echo's energy into one instant, so noise and reverberation
from all other times stay out, which the paper's direction lets in. The directions are the array's
plane and its axis, so an echo from the floor or the ceiling, which a planar array cannot tell
from one another, is not mistaken for a wall. Echoes that arrive within `GATE` samples of each other
share a gate, and so a direction; `joint` and `em` resolve such echoes.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import SearchWindow, direction
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.checks import check, check_choice
from echolearn.localization.beamforming import invert, regularize
from echolearn.localization.correlations import PAD, interpolate
from echolearn.localization.estimates import (
    from_upright_walls,
    reference_echoes,
)
from echolearn.localization.matched_filter import GATE, MatchedFilter, check_extent
from echolearn.localization.preparation import check_arguments, prepare
from echolearn.localization.wall_echoes import on_no_axis, wall_echoes
from echolearn.storage.identity import LATER

TABLE = 16
"""Points per lag of the table from which aligned outputs are read, linearly in between."""


@dataclass(frozen=True)
class Gated:
    """S-NLS and an echo-gated beam; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R; several are found by RELAX. auto: one, the strongest that comes from a wall.
        beam: das or mpdr.
        gamma: regularisation of the covariance (Eq. 18); `das` has no use for it.
        whiten: whether to divide by the square root of the observation's `noise_psd` first.
        sign: of the echoes, positive or either (the largest |r|).
        elevations: 1; directions off the level plane and its axis are for others.
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    echoes: int | str = 1
    beam: str = "das"
    gamma: float = 0.1
    whiten: bool = False
    sign: str = field(default="positive", metadata=LATER)
    elevations: int = field(default=1, metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self, tells_floor=True)
        check_choice("localizer.beam", self.beam, "das", "mpdr")
        # Its tables of gates are those of the plane and the axis, shared with the columns.
        hint = "joint, em, snls and mclam seek directions off the level plane"
        level = self.elevations == 1
        check(level, "localizer.elevations", self.elevations, allowed="must be 1", hint=hint)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        if isinstance(self.echoes, str):
            return wall_echoes(self, observation, view=view)[0]
        matched = prepare(self, observation, view=view, whole=False, reference=True)
        check_extent(matched)
        times = reference_echoes(matched, self.echoes)
        # Each echo has a gate of its own, and with it a direction.
        spectra = [self.spectrum(matched, index) for index in matched.index(times.toa).T]
        power = np.stack(spectra, axis=1)
        best = power.argmax(axis=-1)
        azimuth, elevation = matched.directions
        found = replace(
            times,
            azimuth=azimuth[best],
            elevation=elevation[best],
            power=power.max(axis=-1).astype(float),
        )
        return from_upright_walls(matched, found, level=on_no_axis(found))

    def spectrum(self, matched: MatchedFilter, index: Array) -> Array:
        """Return the beam's power over directions around lag indices (B,), shape (B, A)."""
        if self.beam == "das":
            return matched.gated_power(index)
        return gated_mpdr(matched, index, gamma=self.gamma)


def gated_mpdr(matched: MatchedFilter, index: Array, *, gamma: float = 0.1) -> Array:
    """Return the steered minimum variance power, silent microphones left out, shape (B, A).

    Args:
        matched: recordings.
        index: lag indices of the echoes, shape (B,).
        gamma: regularisation of the covariance (Eq. 18).
    """
    aligned = aligned_outputs(matched, index)
    inverse = invert(regularize(aligned @ np.swapaxes(aligned, -1, -2), gamma))
    # The distortionless response is asked of the microphones that are not silent.
    ones = (~matched.silent).astype(aligned.dtype)[:, None]
    ones = np.broadcast_to(ones, aligned.shape[:3])
    quadratic = np.einsum("bamn,bam,ban->ba", inverse, ones, ones)
    return 1.0 / np.maximum(quadratic, np.finfo(quadratic.dtype).tiny)


def aligned_outputs(matched: MatchedFilter, index: Array) -> Array:
    """Return z_k for |k| <= `GATE` around lag indices (B,), shape (B, A, M, 2 GATE + 1)."""
    padded = matched.padded.astype(np.float32)
    size = padded.shape[-1]
    # A table is read faster than every direction's fractional delays are computed.
    table = interpolate(fft.rfft(padded), size=size, finer=TABLE)

    eta = matched.eta(direction(*matched.directions))
    lags = index[:, None, None, None] + PAD + eta[..., None] + np.arange(-GATE, GATE + 1)
    place = np.clip(lags, 0, size - 2) * TABLE
    lower = np.floor(place).astype(np.int64)

    rows = np.arange(len(padded))[:, None, None, None]
    channels = np.arange(padded.shape[1])[:, None]
    before = table[rows, channels, lower]
    after = table[rows, channels, lower + 1]
    return before + (place - lower).astype(np.float32) * (after - before)
