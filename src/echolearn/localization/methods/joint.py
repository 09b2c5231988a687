"""Joint time and direction: the largest J(tau, phi) = sum_m r_m(tau + eta_m(phi)).

All microphones are delayed for each direction in turn, summed, and correlated with the probe: the
matched filter for a plane wave of unknown time, direction and gain, which in independent white
noise is the maximum likelihood estimate. The directions are the array's plane and its axis, as for
`gated`. With several echoes, RELAX: each is subtracted and all are estimated again (`relax`).

`whiten: true` is the same in coloured noise, `whiten: spatial` in noise that is coloured and that
the microphones share (`localization/spatial.py`).
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.localization.correlations import PAD
from echolearn.localization.estimates import joint_echoes
from echolearn.localization.localizer import returned
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.preparation import check_arguments, check_directions, prepare
from echolearn.localization.relax import relax
from echolearn.localization.search import Search, joint_search
from echolearn.localization.silence import alike
from echolearn.localization.spatial import spatial
from echolearn.localization.wall_echoes import wall_echoes
from echolearn.localization.whitening import shared_noise
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Joint:
    """Joint S-NLS over all microphones; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation. auto: one, the strongest that comes from a wall.
        refine: whether to look between the samples and the grid's directions.
        whiten: whether to divide by the square root of the observation's `noise_psd` first;
            "spatial" also weighs microphones together by its `noise_covariance`.
        sign: of the echoes, positive or either (the largest |r|).
        elevations: size of the elevation grid, over (0, pi/2], or (0, pi) where the array tells up
            from down; 1 is the level plane and its axis.
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    echoes: int | str = 1
    refine: bool = True
    whiten: bool | str = False
    sign: str = field(default="positive", metadata=LATER)
    elevations: int = field(default=1, metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self, "spatial", tells_floor=True)
        check_directions(self.azimuths, self.elevations)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        if isinstance(self.echoes, str):
            return wall_echoes(self, observation, view=view)[0]
        if self.whiten == "spatial":
            return self._weighted(observation)
        matched = prepare(self, observation, view=view, whole=False, reference=False)
        return self._strongest(
            joint_search(matched, refine=self.refine, elevations=self.elevations)
        )

    def _weighted(self, observation: Observation) -> Echoes:
        """Estimate with all microphones weighed together by the noise they share."""
        observation, coherence = shared_noise(observation)
        view = prepare(self, observation, view=None, whole=False, reference=False)
        white = view.observation
        found = np.empty((len(fields(Echoes)), len(white.samples), returned(self)))
        for rows, silent in alike(view.silent):
            samples = white.samples[rows]
            noise = spatial(white, coherence, silent=silent)
            # Energies are those of recordings with independent noise, correlations have Gamma^-1.
            whiter = replace(view, observation=replace(white, samples=noise.whiten(samples)))
            matched = whiter.with_outputs(
                noise.correlate(samples, first=view.first - PAD, last=view.last + PAD)
            )
            ones = np.ones(samples.shape[:2])
            search = joint_search(
                matched,
                weights=ones,
                refine=self.refine,
                spatial=noise,
                elevations=self.elevations,
            )
            found[:, rows] = list(vars(self._strongest(search)).values())
        return Echoes(*found)

    def _strongest(self, search: Search) -> Echoes:
        """Return the R strongest echoes of a search."""
        return joint_echoes(search, relax(search, returned(self)))
