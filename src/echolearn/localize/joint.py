"""Joint time and direction: the largest J(tau, phi) = sum_m r_m(tau + eta_m(phi)).

All microphones are delayed for each direction in turn, summed, and correlated with the probe: the matched filter for
a plane wave of unknown time, direction and gain, which in independent white noise is the maximum likelihood estimate.
The directions are the array's plane and its axis, as for `gated`. With several echoes, RELAX: each is subtracted
and all are estimated again (`components.relax`).
"""

from dataclasses import dataclass, field

from echolearn.geometry import SearchWindow
from echolearn.localize import faults
from echolearn.localize.matched import check_echoes, joint_echoes, joint_search, listen, several
from echolearn.types import Echoes, Observation, check_whole


@dataclass(frozen=True)
class Joint:
    """Joint S-NLS over all microphones; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        echoes: R, estimated per observation.
        refine: look between the samples and the grid's directions.
        whiten: divide by the square root of the observation's `noise_psd` first.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    echoes: int = 1
    refine: bool = True
    whiten: bool = False

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whole("localizer.echoes", self.echoes, low=1, high=64)

    def __call__(self, observation: Observation) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        matched = listen(observation, self.window, azimuths=self.azimuths, whiten=self.whiten, whole=False)
        check_echoes(matched, self.echoes)
        faults.tell(matched.silent, reference=False)
        search = joint_search(matched, refine=self.refine, finer=2 if self.whiten else 1)
        return joint_echoes(matched, search, several(matched, search, echoes=self.echoes))
