"""Joint time and direction: the largest J(tau, phi) = sum_m r_m(tau + eta_m(phi)).

All microphones are delayed for each direction in turn, summed, and correlated with the probe: the
    matched filter for
a plane wave of unknown time, direction and gain, which in independent white noise is the maximum
likelihood estimate. The directions are the array's plane and its axis, as for `gated`. With several
echoes, RELAX: each is subtracted and all are estimated again (`components.relax`).

`whiten: true` is the same in coloured noise, `whiten: spatial` in noise that is coloured and that
the microphones share (`spatial.py`).
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.checks import check_whole
from echolearn.localization import beamforming, faults
from echolearn.localization.matched_filter import (
    MatchedFilter,
    check_echoes,
    joint_echoes,
    joint_search,
    matched_view,
    several,
)
from echolearn.localization.spatial import Spatial, spatial, with_density
from echolearn.localization.whitening import check_whiten

FINER_GRID = 2
"""Points of the grid per lag for whitened recordings, see `search.Search`."""


@dataclass(frozen=True)
class Joint:
    """Joint S-NLS over all microphones; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation.
        refine: look between the samples and the grid's directions.
        whiten: divide by the square root of the observation's `noise_psd` first; "spatial" also
            weighs microphones together by its `noise_covariance`.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    echoes: int = 1
    refine: bool = True
    whiten: bool | str = False

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whole("localizer.echoes", self.echoes, low=1, high=64)
        check_whiten(self.whiten, "spatial")

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        if self.whiten == "spatial":
            return self._weighted(observation)
        matched = matched_view(
            observation,
            self.window,
            azimuths=self.azimuths,
            whiten=bool(self.whiten),
            whole=False,
            view=view,
        )
        check_echoes(matched, self.echoes)
        faults.tell(matched.silent, reference=False)
        search = joint_search(matched, refine=self.refine, finer=FINER_GRID if self.whiten else 1)
        return joint_echoes(matched, search, several(matched, search, echoes=self.echoes))

    def _weighted(self, observation: Observation) -> Echoes:
        """Estimate with all microphones weighed together, those that do not hear left out of each
        recording.
        """
        observation = with_density(observation)
        white = matched_view(
            observation, self.window, azimuths=self.azimuths, whiten=True, whole=False
        )
        check_echoes(white, self.echoes)
        faults.tell(white.silent, reference=False)
        patterns, which = np.unique(white.silent, axis=0, return_inverse=True)
        found = np.empty((len(fields(Echoes)), len(which), self.echoes))
        for number, silent in enumerate(patterns):
            rows = which.ravel() == number
            weighting = spatial(white.observation, observation, heard=~silent)
            echoes = self._alike(
                weighting, replace(white.observation, samples=white.observation.samples[rows])
            )
            found[:, rows] = [getattr(echoes, f.name) for f in fields(Echoes)]
        return Echoes(*found)

    def _alike(self, weighting: Spatial, white: Observation) -> Echoes:
        """Estimate from whitened recordings (B, M, N) that share their silent microphones."""
        samples = weighting.whiten(white.samples)
        matched = MatchedFilter(replace(white, samples=samples), self.window, self.azimuths)
        lags = {"first": matched.first - beamforming.PAD, "last": matched.last + beamforming.PAD}
        weights = np.ones(samples.shape[:2])
        search = replace(
            joint_search(matched, weights=weights, refine=self.refine, finer=FINER_GRID),
            spatial=weighting,
        )
        padded = weighting.correlate(white.samples, **lags)
        return joint_echoes(
            matched, search, several(matched, search, echoes=self.echoes, padded=padded)
        )
