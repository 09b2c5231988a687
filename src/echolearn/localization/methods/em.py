"""EM-MC: expectation-maximization over time and direction (Saqib, Gannot, Jensen 2020).

At R = 1 the E-step gives the recording itself whatever the last estimate was (beta = 1 / R = 1), so
every iteration is
the same exact search of the grid, and one is made: argmax of J(tau, phi) = sum_m w_m r_m(tau +
    eta_m(phi)). At R >= 2
there is something to iterate (`components.expect_maximize`). From random starts two components
often end on one echo, so EM starts from RELAX's.

The weights w_m, one over the noise power of each microphone, are what sets it apart from `joint`: a
    microphone that
crackles hardly counts (`faults.noise_weights`).
"""

from dataclasses import dataclass, field

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.checks import check_whole
from echolearn.localization import faults
from echolearn.localization.matched_filter import (
    MatchedFilter,
    check_echoes,
    joint_echoes,
    joint_search,
    matched_view,
    several,
)
from echolearn.localization.relax import expect_maximize
from echolearn.localization.whitening import check_whiten


@dataclass(frozen=True)
class Em:
    """EM-MC with noise weights; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation.
        iterations: of EM at most, at R >= 2.
        weigh: weight microphones by one over their noise power.
        refine: look between the samples and the grid's directions.
        whiten: divide by the square root of the observation's `noise_psd` first.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    echoes: int = 1
    iterations: int = 30
    weigh: bool = True
    refine: bool = True
    whiten: bool = False

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whiten(self.whiten)
        check_whole("localizer.echoes", self.echoes, low=1, high=64)
        check_whole("localizer.iterations", self.iterations, low=1, high=10_000)

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
        check_echoes(matched, self.echoes)
        faults.tell(matched.silent, reference=False)
        weights = faults.noise_weights(matched.observation, matched.silent) if self.weigh else None
        search = joint_search(
            matched, weights=weights, refine=self.refine, finer=2 if self.whiten else 1
        )
        peaks = several(matched, search, echoes=self.echoes)
        if self.echoes > 1:
            burst = matched.observation.probe.samples
            peaks = expect_maximize(
                matched.padded, search, peaks, burst=burst, iterations=self.iterations
            )
        return joint_echoes(matched, search, peaks)
