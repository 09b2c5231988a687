"""S-NLS with the echo-gated direction: listen to the matched filters around the estimated time only.

TOA: S-NLS (Eq. 13). DOA: argmax over phi of sum_k J(tau + k, phi)^2, |k| <= GATE: a delay-and-sum beamformer on the
matched-filter outputs, gated by the echo. The matched filter has concentrated the echo's energy into one
instant, so noise and reverberation from all other times stay out, which the paper's direction lets in. The
directions are the array's plane and its axis, so an echo from the floor or the ceiling, which a planar array
cannot tell apart, is not mistaken for a wall.
"""

from dataclasses import dataclass, field

import numpy as np

from echolearn.geometry import SearchWindow
from echolearn.localize.matched import Matched
from echolearn.types import Echoes, Observation, check_whole


@dataclass(frozen=True)
class Gated:
    """S-NLS and echo-gated delay-and-sum, R = 1; elevation is pi/2 in the array's plane, 0 on its axis.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)

    def __call__(self, observation: Observation) -> Echoes:
        """Estimate the strongest echo of each observation, samples (B, M, N) -> fields (B, 1)."""
        matched = Matched(observation, self.window, self.azimuths)
        strongest = matched.strongest
        power = matched.gated_power(strongest)
        azimuth, elevation = matched.directions
        best = power.argmax(axis=-1)
        fields = (
            matched.toa(strongest),
            matched.score(strongest),
            matched.gain(strongest),
            azimuth[best],
            elevation[best],
            power.max(axis=-1),
        )
        return Echoes(*(np.asarray(value, dtype=float)[:, None] for value in fields))
