"""McLAM, a reconstruction: one direction for all, then one time from all microphones.

The text of the method (Saqib, Jensen 2022) is not public. What is known of it, and built here:

1. direction phi: whole-recording SRP-MPDR (Eqs. 15-18), as in `snls`;
2. S-NLS's cost of each microphone, r_m(tau), aligned by eta_m(phi) and summed; S-NLS on the sum:
   tau = argmax sum_m r_m(tau + eta_m(phi));
3. an energy detector, H1: ||y - x_direct||^2 > 2 sigma^2 ln gamma. The direct path has been removed
   before, so y is what is left, here over the samples that echoes in the window touch, of the
   T = K M samples of all microphones. Without an echo ||y||^2 / sigma^2 is chi-square with T
   degrees of freedom, so 2 ln gamma is its quantile for the wanted rate of false alarms. sigma^2
   comes from `noise_psd` where it is known and else from the recording's last quarter, which late
   reverberation fills too.

Where nothing is detected, gain and score are 0, as of silence; time and direction stay, for whoever
wants to decide alone.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from echolearn.acoustics.arrays import tells_up
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.localization.beamforming import Mpdr
from echolearn.localization.correlations import advance
from echolearn.localization.estimates import joint_echoes
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.preparation import check_arguments, check_directions, prepare
from echolearn.localization.search import Peak, joint_search, reference_search
from echolearn.localization.silence import energies
from echolearn.localization.whitening import noise_variance
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Mclam:
    """MPDR direction, aligned S-NLS time, energy detector; R = 1.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        gamma: regularisation of the covariance (Eq. 18).
        false_alarm: share of recordings without an echo in which the detector sees one.
        whiten: whether to divide by the square root of the observation's `noise_psd` first.
        sign: of the echoes, positive or either (the largest |r|).
        elevations: size of the elevation grid, over (0, pi/2], or (0, pi) where the array tells up
            from down; 1 stays in the level plane.
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    gamma: float = 0.1
    false_alarm: float = 0.05
    whiten: bool = False
    sign: str = field(default="positive", metadata=LATER)
    elevations: int = field(default=1, metadata=LATER)

    @property
    def echoes(self) -> int:
        """Number R: one direction serves one echo."""
        return 1

    def __post_init__(self) -> None:
        check_arguments(self)
        check_directions(self.azimuths, self.elevations)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echo of each observation, samples (B, M, N) -> fields (B, 1)."""
        matched = prepare(self, observation, view=view, whole=True, reference=False)
        below = tells_up(observation.array)
        mpdr = Mpdr(self.azimuths, self.elevations, self.gamma, below)
        power = mpdr.without(matched.observation, matched.silent)
        azimuth, plane = (angle[power.argmax(axis=-1)] for angle in mpdr.directions)

        # The microphones that are not silent, aligned for that direction, become one.
        search = joint_search(matched, elevations=self.elevations)
        eta = search.delays((np.zeros(len(azimuth)), azimuth, plane))
        weighted = matched.padded * search.weights[..., None]
        aligned = advance(weighted, eta[:, None])[:, 0].sum(axis=1, keepdims=True)
        one = reference_search(matched, refine=self.whiten)(aligned)

        gain = one.gain / search.weights.sum(axis=-1)
        echoes = joint_echoes(search, [Peak(one.lag, azimuth, plane, gain, one.height)])
        present = detected(matched, self.false_alarm)[:, None]
        return replace(
            echoes,
            score=np.where(present, echoes.score, 0.0),
            gain=np.where(present, echoes.gain, 0.0),
            power=power.max(axis=-1)[:, None].astype(float),
        )


def detected(matched: MatchedFilter, false_alarm: float) -> Array:
    """Tell where ||y||^2 > 2 sigma^2 ln gamma over the samples of the window, shape (B,), bool."""
    observation = matched.observation
    end = matched.last + len(observation.probe.samples)
    touched = observation.samples[..., matched.first : end]
    energy = energies(touched)
    variance = noise_variance(observation)

    # A microphone without any noise tells of an echo by any sound at all.
    certain = ~matched.silent & (variance == 0) & (energy > 0)
    safe = np.where(~matched.silent & (variance > 0), variance, np.inf)
    samples = (~matched.silent).sum(axis=-1) * touched.shape[-1]
    return certain.any(axis=-1) | ((energy / safe).sum(axis=-1) > chdtri(samples, false_alarm))
