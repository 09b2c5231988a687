"""EM-MC: expectation-maximization over time and direction (Saqib, Gannot, Jensen 2020).

At R = 1 the E-step gives the recording itself whatever the last estimate was (beta = 1 / R = 1), so
every iteration is the same exact search of the grid, and one is made: argmax of
J(tau, phi) = sum_m w_m r_m(tau + eta_m(phi)). At R >= 2 there is something to iterate
(`relax.expect_maximize`). From random starts two components often end on one echo, so EM starts
from RELAX's.

The weights w_m, one over the noise power of each microphone, are what sets it apart from `joint`: a
microphone that crackles hardly counts (`whitening.noise_weights`).
"""

from dataclasses import dataclass, field

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.localization.estimates import joint_echoes
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.preparation import check_arguments, check_directions, prepare
from echolearn.localization.relax import expect_maximize, relax
from echolearn.localization.search import joint_search
from echolearn.localization.wall_echoes import wall_echoes
from echolearn.localization.whitening import noise_weights
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Em:
    """EM-MC with noise weights; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation. auto: one, the strongest that comes from a wall.
        iterations: most iterations of EM, at R >= 2.
        weigh: whether to weight microphones by one over their noise power.
        refine: whether to look between the samples and the grid's directions.
        whiten: whether to divide by the square root of the observation's `noise_psd` first.
        sign: of the echoes, positive or either (the largest |r|).
        elevations: size of the elevation grid, over (0, pi/2], or (0, pi) where the array tells up
            from down; 1 is the level plane and its axis.
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    echoes: int | str = 1
    iterations: int = 30
    weigh: bool = True
    refine: bool = True
    whiten: bool = False
    sign: str = field(default="positive", metadata=LATER)
    elevations: int = field(default=1, metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self, tells_floor=True)
        check_directions(self.azimuths, self.elevations)

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        if isinstance(self.echoes, str):
            return wall_echoes(self, observation, view=view)[0]
        matched = prepare(self, observation, view=view, whole=False, reference=False)
        # One over the noise power makes the sum of correlations the likelihood.
        weights = noise_weights(matched.observation, matched.silent) if self.weigh else None
        search = joint_search(
            matched, weights=weights, refine=self.refine, elevations=self.elevations
        )
        peaks = relax(search, self.echoes)
        if self.echoes > 1:
            peaks = expect_maximize(search, peaks, iterations=self.iterations)
        return joint_echoes(search, peaks)
