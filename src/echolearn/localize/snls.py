"""The paper's estimator: S-NLS for the time, whole-recording SRP-MPDR for the direction.

TOA: argmax of r_1(tau) in the search window (Eq. 13), gain by Eq. 11.
DOA: argmax over directions of the MPDR beam power summed over STFT bins (Eqs. 15-18). It listens to the whole
recording, so below 0 dB it finds the noise or the late reverberation rather than the echo.
"""

from dataclasses import dataclass, field

import numpy as np

from echolearn import signals
from echolearn.geometry import SearchWindow
from echolearn.localize import beam
from echolearn.localize.matched import Matched
from echolearn.types import Array, Echoes, Observation, check, check_number, check_whole


@dataclass(frozen=True)
class Snls:
    """S-NLS and SRP-MPDR, R = 1.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        elevations: size of the elevation grid over (0, pi/2]; 1 stays in the array's plane.
        gamma: regularisation of the covariance (Eq. 18).
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    elevations: int = 1
    gamma: float = 0.1

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whole("localizer.elevations", self.elevations, low=1, high=90)
        directions = self.azimuths * self.elevations
        allowed = "azimuths * elevations up to 7200, for memory"
        check(directions <= 7200, "localizer.azimuths", self.azimuths, allowed=allowed)
        check_number("localizer.gamma", self.gamma, low=0.0, high=1.0)

    def __call__(self, observation: Observation) -> Echoes:
        """Estimate the strongest echo of each observation, samples (B, M, N) -> fields (B, 1)."""
        matched = Matched(observation, self.window, self.azimuths)
        strongest = matched.strongest
        power = mpdr_spectrum(observation, azimuths=self.azimuths, elevations=self.elevations, gamma=self.gamma)
        azimuth, elevation = beam.direction_grid(self.azimuths, self.elevations)
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


def mpdr_spectrum(observation: Observation, *, azimuths: int = 180, elevations: int = 1, gamma: float = 0.1) -> Array:
    """Return the whole-recording SRP-MPDR power over directions (Eq. 16), shape (B, A), from samples (B, M, N)."""
    return spectrum_of(
        recording_covariance(observation), observation, azimuths=azimuths, elevations=elevations, gamma=gamma
    )


def recording_covariance(observation: Observation) -> Array:
    """Return the covariance of the whole recording per STFT bin (Eq. 17), shape (B, F, M, M), complex64."""
    return beam.covariance(signals.stft(observation.samples.astype(np.float32)))


def spectrum_of(
    covariances: Array, observation: Observation, *, azimuths: int = 180, elevations: int = 1, gamma: float = 0.1
) -> Array:
    """Return the SRP-MPDR power over directions, shape (B, A), of covariances (B, F, M, M)."""
    weights = beam.steering_weights(
        observation.array,
        azimuths,
        elevations,
        frame=signals.FRAME,
        sample_rate=observation.probe.sample_rate,
        speed_of_sound=observation.speed_of_sound,
    )
    return beam.mpdr_power(covariances, weights, gamma=gamma)
