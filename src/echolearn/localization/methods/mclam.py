"""McLAM, a reconstruction: one direction for all, then one time from all microphones.

The text of the method (Saqib, Jensen 2022) is not public. What is known of it, and built here:

1. direction phi: whole-recording SRP-MPDR (Eqs. 15-18), as in `snls`;
2. S-NLS's cost of each microphone, r_m(tau), aligned by eta_m(phi) and summed; S-NLS on the sum:
   tau = argmax sum_m r_m(tau + eta_m(phi));
3. an energy detector, H1: ||y - x_direct||^2 > 2 sigma^2 ln gamma. The direct path has been removed before, so y is
   what is left, here over the samples that echoes in the window touch, of the T = K M samples of
   all microphones.
   Without an echo ||y||^2 / sigma^2 is chi-square with T degrees of freedom, so 2 ln gamma is its quantile for the
   wanted rate of false alarms. sigma^2 comes from `noise_psd` where it is known and else from the
   recording's last quarter, which late reverberation fills too.

Where nothing is detected, gain and score are 0, as of silence; time and direction stay, for whoever
judges them.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtri

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.checks import check_number, check_whole
from echolearn.localization import beamforming, faults
from echolearn.localization.matched_filter import (
    FINER,
    MatchedFilter,
    joint_echoes,
    joint_search,
    matched_view,
    reference_search,
)
from echolearn.localization.methods.snls import heard_spectrum
from echolearn.localization.search import Peak
from echolearn.localization.whitening import check_whiten


@dataclass(frozen=True)
class Mclam:
    """MPDR direction, aligned S-NLS time, energy detector; R = 1.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        gamma: regularisation of the covariance (Eq. 18).
        false_alarm: share of recordings without an echo in which the detector sees one.
        whiten: divide by the square root of the observation's `noise_psd` first.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    gamma: float = 0.1
    false_alarm: float = 0.05
    whiten: bool = False

    @property
    def echoes(self) -> int:
        """R: one direction serves one echo."""
        return 1

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whiten(self.whiten)
        check_number("localizer.gamma", self.gamma, low=0.0, high=1.0)
        check_number("localizer.false_alarm", self.false_alarm, low=1e-12, high=1.0)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echo of each observation, samples (B, M, N) -> fields (B, 1)."""
        matched = matched_view(
            observation,
            self.window,
            azimuths=self.azimuths,
            whiten=self.whiten,
            whole=True,
            view=view,
        )
        faults.tell(matched.silent, reference=False)
        power = heard_spectrum(matched, azimuths=self.azimuths, gamma=self.gamma)
        azimuth = beamforming.azimuth_grid(self.azimuths)[power.argmax(axis=-1)]
        level = np.full(len(azimuth), np.pi / 2)
        search = joint_search(matched)
        eta = search.delays(np.zeros(len(azimuth)), azimuth, level)
        aligned = beamforming.advance(matched.padded * search.weights[..., None], eta[:, None])[
            :, 0
        ].sum(axis=1, keepdims=True)
        one = reference_search(matched, refine=self.whiten, finer=FINER if self.whiten else 1)(
            aligned
        )
        peak = Peak(one.lag, azimuth, level, one.gain / search.weights.sum(axis=-1), one.height)
        present = detected(matched, self.false_alarm)[:, None]
        echoes = joint_echoes(matched, search, [peak])
        score, gain = np.where(present, echoes.score, 0.0), np.where(present, echoes.gain, 0.0)
        return Echoes(
            echoes.toa,
            score,
            gain,
            echoes.azimuth,
            echoes.elevation,
            power.max(axis=-1)[:, None].astype(float),
        )


def detected(matched: MatchedFilter, false_alarm: float) -> Array:
    """Tell in which observations ||y||^2 > 2 sigma^2 ln gamma over the window's samples, shape (B,), bool."""
    observation, heard = matched.observation, ~matched.silent
    touched = observation.samples[
        ..., matched.first : matched.last + len(observation.probe.samples)
    ]
    variance = faults.noise_variance(observation)
    safe = np.where(heard & (variance > 0), variance, np.inf)
    energy = (faults.energies(touched) / safe).sum(axis=-1)
    loud = (heard & (variance == 0) & (faults.energies(touched) > 0)).any(axis=-1)
    return loud | (energy > chdtri(heard.sum(axis=-1) * touched.shape[-1], false_alarm))
