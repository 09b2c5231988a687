"""The paper's estimator: S-NLS for the time, whole-recording SRP-MPDR for the direction.

TOA: argmax of r_1(tau) in the search window (Eq. 13), gain by Eq. 11. With several echoes, RELAX
with refinement between samples (`relax`).

DOA: argmax over directions of the MPDR beam power summed over STFT bins (Eqs. 15-18). It takes in
the whole recording, so below 0 dB it finds the noise or the late reverberation rather than the
echo. Several echoes share the highest peaks of that power: the pairs of time and direction in which
the aligned matched filters agree most, one to one.
"""

from dataclasses import dataclass, field

from echolearn.acoustics.arrays import tells_up
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.checks import check
from echolearn.localization.beamforming import Mpdr
from echolearn.localization.estimates import mpdr_echoes, reference_echoes
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.preparation import check_arguments, check_directions, prepare
from echolearn.storage.identity import LATER


@dataclass(frozen=True)
class Snls:
    """S-NLS and SRP-MPDR.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        elevations: size of the elevation grid, over (0, pi/2], or (0, pi) where the array tells up
            from down; 1 stays in the level plane.
        gamma: regularisation of the covariance (Eq. 18).
        echoes: R; 1 is the paper, more are found by RELAX, in the array's plane.
        whiten: whether to divide by the square root of the observation's `noise_psd` first.
        sign: of the echoes, positive or either (the largest |r|).
    """

    window: SearchWindow = SearchWindow()
    azimuths: int = 180
    elevations: int = 1
    gamma: float = 0.1
    echoes: int = 1
    whiten: bool = False
    sign: str = field(default="positive", metadata=LATER)

    def __post_init__(self) -> None:
        check_arguments(self)
        check_directions(self.azimuths, self.elevations)
        check(
            self.echoes == 1 or self.elevations == 1,
            "localizer.elevations",
            self.elevations,
            allowed="must be 1 with several echoes",
        )

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        matched = prepare(self, observation, view=view, whole=True, reference=True)
        below = tells_up(observation.array)
        mpdr = Mpdr(self.azimuths, self.elevations, self.gamma, below)
        return mpdr_echoes(matched, reference_echoes(matched, self.echoes), mpdr=mpdr)
