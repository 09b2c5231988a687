"""RIR-PP: estimate the room impulse response at microphone 1, pick its peaks.

    H1(f) = G_xy / (G_xx + loading * mean G_xx),    h = ifft(H1),    tau = argmax h in the window

x is the probe and y the recording, one block of N samples each. Plain (`loading` 0), as the paper's
comparison, it divides by whatever little the probe has at some frequencies, and so amplifies the
noise there: a random burst's |S(f)|^2 comes close to zero many times. With `loading` it is the fair
version, and tends to the matched filter as `loading` grows. The direction is that of `snls`, the
whole-recording SRP-MPDR.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.checks import check
from echolearn.localization.beamforming import Mpdr
from echolearn.localization.estimates import echoes_at, mpdr_echoes
from echolearn.localization.matched_filter import PEAK_SPACING, MatchedFilter
from echolearn.localization.preparation import check_arguments, prepare
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Peaks:
    """Peaks of the dual-channel response estimate, and SRP-MPDR.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        gamma: regularisation of the covariance (Eq. 18).
        echoes: R, the highest peaks at least `matched_filter.PEAK_SPACING` samples apart.
        loading: addition to the probe's power density, relative to its mean; 0 is plain division.
        whiten: whether to divide by the square root of the observation's `noise_psd` first.
        sign: of the echoes, positive or either (the largest |r|).
        elevations: 1; it compares times, with the direction of `snls` in the level plane.
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    gamma: float = 0.1
    echoes: int = 1
    loading: float = 0.0
    whiten: bool = False
    sign: str = field(default="positive", metadata=LATER)
    elevations: int = field(default=1, metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self)
        hint = "joint, em, snls and mclam seek directions off the level plane"
        level = self.elevations == 1
        check(level, "localizer.elevations", self.elevations, allowed="must be 1", hint=hint)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the highest peaks of each observation, samples (B, M, N) -> fields (B, R)."""
        matched = prepare(self, observation, view=view, whole=True, reference=True)
        index = highest(response(matched, self.loading), self.echoes)
        mpdr = Mpdr(self.azimuths, gamma=self.gamma)
        return mpdr_echoes(matched, echoes_at(matched, index), mpdr=mpdr)


def response(matched: MatchedFilter, loading: float) -> Array:
    """Return the estimated response at microphone 1 inside the window, shape (B, L)."""
    observation = matched.observation
    size = fft.next_fast_len(observation.samples.shape[-1], real=True)
    emitted = fft.rfft(observation.probe.samples, size)
    density = np.abs(emitted) ** 2 + loading * matched.probe_energy
    # Division by a density of 0 must give no NaN; what is there is noise anyway.
    inverse = emitted.conj() / np.maximum(density, np.finfo(float).tiny)
    estimate = fft.irfft(fft.rfft(observation.samples[:, 0], size) * inverse, size)
    return estimate[:, matched.first : matched.last + 1]


def highest(curve: Array, count: int) -> Array:
    """Return the lags (B, count) of the highest values of (B, L), `PEAK_SPACING` apart at least."""
    left = curve.copy()
    lags = np.arange(curve.shape[-1])
    found = []
    for _ in range(count):
        best = left.argmax(axis=-1)
        # Side lobes of a peak are no peaks.
        left[np.abs(lags - best[:, None]) < PEAK_SPACING] = -np.inf
        found.append(best)
    return np.stack(found, axis=-1)
