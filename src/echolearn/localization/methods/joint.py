"""Joint time and direction: the largest J(tau, phi) = sum_m r_m(tau + eta_m(phi)).

All microphones are delayed for each direction in turn, summed, and correlated with the probe: the
matched filter for a plane wave of unknown time, direction and gain, which in independent white
noise is the maximum likelihood estimate. The directions are the array's plane and its axis, as for
`gated`. With several echoes, RELAX: each is subtracted and all are estimated again (`relax`).

`whiten: true` is the same in coloured noise, `whiten: spatial` in noise that is coloured and that
the microphones share (`localization/spatial.py`).
"""

from dataclasses import dataclass, field, replace

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.localization.correlations import PAD
from echolearn.localization.estimates import joint_echoes, joint_search, strongest_peaks
from echolearn.localization.localizer import check_arguments, prepare
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.spatial import spatial
from echolearn.localization.whitening import noise_coherence, with_density
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Joint:
    """Joint S-NLS over all microphones; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation.
        refine: whether to look between the samples and the grid's directions.
        whiten: whether to divide by the square root of the observation's `noise_psd` first;
            "spatial" also weighs microphones together by its `noise_covariance`.
        sign: of the echoes, positive or either (the largest |r|).
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    echoes: int = 1
    refine: bool = True
    whiten: bool | str = False
    sign: str = field(default="positive", metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self, "spatial")

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        if self.whiten == "spatial":
            return self._weighted(observation)
        matched = prepare(self, observation, view=view, whole=False, reference=False)
        search = joint_search(matched, refine=self.refine)
        return joint_echoes(matched, search, strongest_peaks(matched, search, echoes=self.echoes))

    def _weighted(self, observation: Observation) -> Echoes:
        """Estimate with all microphones weighed together by the noise they share."""
        observation = with_density(observation)
        white = prepare(self, observation, view=None, whole=False, reference=False)
        coherence = noise_coherence(observation)

        # Recordings with the same silent microphones have one weighting.
        patterns, which = np.unique(white.silent, axis=0, return_inverse=True)
        found: dict[str, Array] = {}
        for number, silent in enumerate(patterns):
            rows = np.flatnonzero(which.ravel() == number)
            for name, values in vars(self._alike(white, coherence, rows, silent)).items():
                whole = found.setdefault(name, np.empty((len(which), self.echoes)))
                whole[rows] = values
        return Echoes(**found)

    def _alike(self, view: MatchedFilter, coherence: Array, rows: Array, silent: Array) -> Echoes:
        """Estimate from some of the whitened recordings, which share their silent microphones."""
        white = view.observation
        weighting = spatial(white, coherence, silent=silent)
        # Energies are those of recordings with independent noise, correlations those with Gamma^-1.
        samples = white.samples[rows]
        whiter = replace(view, observation=replace(white, samples=weighting.whiten(samples)))
        matched = whiter.with_outputs(
            weighting.correlate(samples, first=view.first - PAD, last=view.last + PAD)
        )
        search = joint_search(matched, weights=np.ones(samples.shape[:2]), refine=self.refine)
        search = replace(search, spatial=weighting)
        return joint_echoes(matched, search, strongest_peaks(matched, search, echoes=self.echoes))
