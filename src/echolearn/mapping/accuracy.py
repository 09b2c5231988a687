"""How accurate echoes are: what the grids of a localizer and noise leave of distance and azimuth.

A number that is rounded to a grid keeps an error of at least its step / sqrt 12 (Sheppard). Noise
adds to it what the bound of Cramer and Rao says of an arrival: in white noise of variance s^2 per
sample, s^2 / (g^2 ||x'||^2), x' the derivative of the probe x and g the echo's gain. A score r
tells s^2: (1 - r^2) / r^2 of the echo's own mean square. Reverberation and neighbouring echoes are
not in it; of walls they show in the scatter of points (`uncertainty`).

Where the array's centre c is not the loudspeaker, D = |c + rho v| / 2 (`acoustics.bistatic`) hangs
on the direction v too: dD/dphi = rho (c . dv/dphi) / (4 D), near enough c . dv/dphi / 2.
"""

from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import SPEED_OF_SOUND, Array, Echoes, MicArray, Probe


@dataclass(frozen=True)
class Accuracy:
    """What limits the accuracy of a walk's echoes.

    Attributes:
        lag: distance to a wall that one lag stands for, in m.
        azimuth: angle between two directions of the grid, in rad.
        distance_noise: standard deviation of the distance to a wall where noise is as strong as the
            echo, in m.
        azimuth_noise: that of the azimuth, in rad.
        heading_bias_sd: standard deviation of an error that all headings share, in rad.
        array: the microphones, if their centre is not the loudspeaker.
    """

    lag: float = SPEED_OF_SOUND / 22050 / 2
    azimuth: float = np.deg2rad(2.0)
    distance_noise: float = 0.0
    azimuth_noise: float = 0.0
    heading_bias_sd: float = 0.0
    array: MicArray | None = None

    def of_echoes(self, echoes: Echoes) -> tuple[Array, Array]:
        """Return standard deviations of distances in m and azimuths in rad, shaped as the echoes.

        The poses' own errors are not in them.
        """
        square = np.clip(np.abs(echoes.score), 0.01, 1.0) ** 2
        noise = np.sqrt((1 - square) / square)
        distance = np.hypot(self.lag / np.sqrt(12), self.distance_noise * noise)
        azimuth = np.hypot(self.azimuth / np.sqrt(12), self.azimuth_noise * noise)
        if self.array is None:
            return distance, azimuth
        x, y, _ = self.array.centre
        lever = (y * np.cos(echoes.azimuth) - x * np.sin(echoes.azimuth)) / 2
        return np.hypot(distance, lever * azimuth), azimuth


def accuracy_of(
    probe: Probe,
    array: MicArray,
    *,
    azimuths: int,
    speed_of_sound: float,
    heading_bias_sd: float = 0.0,
) -> Accuracy:
    """Return what a probe, an array and a grid of directions leave.

    Args:
        probe: at the rate of what is localized.
        array: the microphones, robot frame.
        azimuths: directions of the grid.
        speed_of_sound: in m/s.
        heading_bias_sd: standard deviation of an error that all headings share, in rad.
    """
    slope = np.sum(np.gradient(probe.samples) ** 2)
    samples = np.sqrt(probe.energy / len(probe.samples) / slope)
    way = float(speed_of_sound * samples / probe.sample_rate)
    # A plane array's mean over all azimuths; what all microphones share tells no direction.
    apart = array.positions[:, :2] - array.positions[:, :2].mean(axis=0)
    aperture = float(np.sqrt(np.sum(apart**2) / 2))
    return Accuracy(
        lag=speed_of_sound / probe.sample_rate / 2,
        azimuth=2 * np.pi / azimuths,
        distance_noise=way / 2,
        azimuth_noise=way / max(aperture, way),
        heading_bias_sd=heading_bias_sd,
        array=array if array.centre[:2].any() else None,
    )
