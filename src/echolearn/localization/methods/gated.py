"""S-NLS with the echo-gated direction: matched_view to the matched filters around the estimated
time only.

TOA: S-NLS (Eq. 13); several echoes by RELAX. DOA: the strongest beam on the matched-filter outputs
    aligned for phi,
z_k = r_m(tau + k + eta_m(phi)), |k| <= GATE, M-vectors:

- `das`, delay-and-sum: argmax over phi of sum_k (1' z_k)^2 = sum_k J(tau + k, phi)^2;
- `mpdr`: argmax of 1 / (1' R_bar^-1 1), R_bar from Eq. 18 and R = sum_k z_k z_k', the steered
  minimum variance beamformer (Krolik, Swingler 1989), which takes one covariance per direction
  because an echo is not narrowband.

The matched filter has concentrated the echo's energy into one instant, so noise and reverberation
from all other times stay out, which the paper's direction lets in. The directions are the array's
plane and its axis, so an echo from the floor or the ceiling, which a planar array cannot tell
apart, is not mistaken for a wall. Echoes that arrive within `GATE` samples of each other share a
gate, and so a direction; `joint` and `em` tell such echoes apart.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import SearchWindow, relative_delays
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.checks import check, check_number, check_whole
from echolearn.localization import beamforming, faults
from echolearn.localization.matched_filter import (
    GATE,
    MatchedFilter,
    check_echoes,
    check_extent,
    matched_view,
)
from echolearn.localization.methods.snls import reference_echoes
from echolearn.localization.whitening import check_whiten

TABLE = 16
"""Points per lag of the table from which aligned outputs are read, linearly in between."""


@dataclass(frozen=True)
class Gated:
    """S-NLS and an echo-gated beam; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R; several are found by RELAX.
        beam: das or mpdr.
        gamma: regularisation of the covariance (Eq. 18); `das` has no use for it.
        whiten: divide by the square root of the observation's `noise_psd` first.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    echoes: int = 1
    beam: str = "das"
    gamma: float = 0.1
    whiten: bool = False

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whiten(self.whiten)
        check_whole("localizer.echoes", self.echoes, low=1, high=64)
        check(self.beam in ("das", "mpdr"), "localizer.beam", self.beam, allowed="das or mpdr")
        check_number("localizer.gamma", self.gamma, low=0.0, high=1.0)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        matched = matched_view(
            observation,
            self.window,
            azimuths=self.azimuths,
            whiten=self.whiten,
            whole=False,
            view=view,
        )
        check_extent(matched)
        check_echoes(matched, self.echoes)
        faults.tell(matched.silent, reference=True)
        times = reference_echoes(matched, self.echoes, fine=self.whiten)
        index = matched.index(times.toa)
        power = np.stack([self.spectrum(matched, column) for column in index.T], axis=1)
        best = power.argmax(axis=-1)
        azimuth, elevation = (angle[best] for angle in matched.directions)
        fields = (times.toa, times.score, times.gain, azimuth, elevation, power.max(axis=-1))
        return Echoes(*(np.asarray(value, dtype=float) for value in fields))

    def spectrum(self, matched: MatchedFilter, index: Array) -> Array:
        """Return the beam's power over directions around lag indices (B,), shape (B, A)."""
        return (
            matched.gated_power(index)
            if self.beam == "das"
            else gated_mpdr(matched, index, gamma=self.gamma)
        )


def gated_mpdr(matched: MatchedFilter, index: Array, *, gamma: float = 0.1) -> Array:
    """Return the steered minimum variance power around lag indices (B,), shape (B, A); silent
    microphones left out.
    """
    aligned = aligned_outputs(matched, index)
    covariances = beamforming.regularize(aligned @ np.swapaxes(aligned, -1, -2), gamma)
    heard = (~matched.silent).astype(aligned.dtype)[:, None]
    inverse = beamforming.invert(covariances)
    quadratic = np.einsum(
        "bamn,bam,ban->ba", inverse, *(np.broadcast_to(heard, aligned.shape[:3]),) * 2
    )
    return 1.0 / np.maximum(quadratic, np.finfo(quadratic.dtype).tiny)


def aligned_outputs(matched: MatchedFilter, index: Array) -> Array:
    """Return z_k = r_m(tau + k + eta_m(phi)) for |k| <= GATE around lag indices (B,), shape (B, A, M, 2 GATE + 1)."""
    padded = matched.padded.astype(np.float32)
    size = padded.shape[-1]
    table = beamforming.interpolate(fft.rfft(padded), size, TABLE)
    eta = relative_delays(matched.observation.array, *matched.directions, 1.0) * matched.scale
    lags = (
        index[:, None, None, None] + beamforming.PAD + eta[..., None] + np.arange(-GATE, GATE + 1)
    )
    place = np.clip(lags, 0, size - 2) * TABLE
    lower = np.floor(place).astype(np.int64)
    rows, channels = (
        np.arange(len(padded))[:, None, None, None],
        np.arange(padded.shape[1])[:, None],
    )
    before, after = table[rows, channels, lower], table[rows, channels, lower + 1]
    return before + (place - lower).astype(np.float32) * (after - before)
