"""How much a simulated robot and its room differ from ideal ones: ranges, one draw for each row.

    Realism --draw--> Imperfections --> a `Scene` whose responses have them

The simulator's walls are mirrors, its rooms empty, its microphones equal, its loudspeaker without a
response. Each field here is the range of one departure from that, uniform between its two ends; a
range of (0, 0) leaves the departure out, and all of them are so by default. Where the defaults of
`conf/realism/measured.yaml` come from is in docs/realism.md. How sound is changed is in
`imperfect_scene`.

**Truth stays geometric**: the first-order echo of a plain wall, at microphone 1 where the robot
believes it to be. The loudspeaker's group delay is taken off, as a calibration by the direct path
does that finds its largest peak; `latency_samples` is what such a calibration leaves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from echolearn.acoustics.types import Array, Probe
from echolearn.checks import Range, check, check_range
from echolearn.simulation.imperfections import Imperfections
from echolearn.simulation.kernels import band_db, clusters, minimum_phase, ripple
from echolearn.simulation.noise.white import White
from echolearn.simulation.scene import Scene

BOUNDS: dict[str, Range] = {
    "spread": (0.0, 0.01, "s"),
    "scattering": (0.0, 1.0),
    "absorption_db": (0.0, 40.0, "dB"),
    "scatterers": (0.0, 200.0),
    "scatterer_radius": (0.0, 1.0, "m"),
    "microphone_db": (0.0, 10.0, "dB"),
    "microphone_ripple_db": (0.0, 10.0, "dB"),
    "microphone_offset": (0.0, 0.02, "m"),
    "loudspeaker_low": (0.0, 5_000.0, "Hz"),
    "loudspeaker_high": (0.0, 100_000.0, "Hz"),
    "loudspeaker_ripple_db": (0.0, 20.0, "dB"),
    "directivity": (0.0, 1.0),
    "latency_samples": (-50.0, 50.0, "samples"),
    "residual": (0.0, 1.0),
    "gain_db": (-100.0, 100.0, "dB"),
    "coloured": (0.0, 1.0),
    "colour_hz": (0.0, 10_000.0, "Hz"),
}
"""Least and largest value of each range, with its unit."""

MICROPHONE_TAPS = 16
"""Length of a microphone's own response."""

LOUDSPEAKER_TAPS = 256
"""Length of a loudspeaker's response; low frequencies ring longest."""

MOST_BEFORE = 32
"""Samples of a measured response that are kept before its largest peak."""

NEAREST_WAY = 0.3
"""Least share of the way to the wall at which there is clutter."""

Limits = tuple[float, float]

NONE: Limits = (0.0, 0.0)


@dataclass(frozen=True)
class Realism:
    """Ranges of what is not ideal.

    Attributes:
        suffix: ends the names of sets and surveys, so that they stand beside the clean ones.
        spread: time over which a rough wall spreads an echo, in s.
        scattering: share of an echo's energy that is spread, the scattering coefficient; the rest
            arrives at once.
        absorption_db: how much more of high frequencies (`kernels.CROSSOVER`) a reflection takes.
        scatterers: number of rigid spheres about, which make clutter.
        scatterer_radius: of each of them, in m.
        microphone_db: standard deviation of the microphones' gains, in dB.
        microphone_ripple_db: standard deviation of each one's own response over frequency, in dB.
        microphone_offset: standard deviation of each coordinate of a microphone, in m.
        loudspeaker_low, loudspeaker_high: corners of its band, in Hz, 12 dB an octave; 0 is none.
        loudspeaker_ripple_db: standard deviation of its response within the band, in dB.
        loudspeaker: response that was measured, instead of one that is drawn; None is drawn.
        directivity: of the loudspeaker at high frequencies, 0 a sphere, 1 a cardioid, which turns
            its back on a direction that is drawn, in the horizontal plane.
        latency_samples: by which all that is recorded is late, beyond what calibration knows.
        residual: share of the direct path's amplitude that its subtraction leaves.
        gain_db: of the recording, beside the plan's.
        coloured: share of the white sensor noise's power that is coloured instead.
        colour_hz: corner above which coloured noise falls by 6 dB an octave, in Hz.
    """

    suffix: str = ""
    spread: Limits = NONE
    scattering: Limits = NONE
    absorption_db: Limits = NONE
    scatterers: Limits = NONE
    scatterer_radius: Limits = NONE
    microphone_db: Limits = NONE
    microphone_ripple_db: Limits = NONE
    microphone_offset: Limits = NONE
    loudspeaker_low: Limits = NONE
    loudspeaker_high: Limits = NONE
    loudspeaker_ripple_db: Limits = NONE
    directivity: Limits = NONE
    latency_samples: Limits = NONE
    residual: Limits = NONE
    gain_db: Limits = NONE
    coloured: Limits = NONE
    colour_hz: Limits = NONE
    loudspeaker: Probe | None = None

    def __post_init__(self) -> None:
        allowed = "must be the end of a name, such as _measured"
        check(isinstance(self.suffix, str), "realism.suffix", self.suffix, allowed=allowed)
        for name, bounds in BOUNDS.items():
            limits = getattr(self, name)
            check_range(f"realism.{name}", limits, bounds=bounds)
            object.__setattr__(self, name, tuple(map(float, limits)))

    @property
    def clean(self) -> bool:
        """Whether nothing is drawn."""
        return self.loudspeaker is None and all(getattr(self, name) == NONE for name in BOUNDS)

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        """Lower end and width of each range, in the order of `BOUNDS`."""
        low, high = np.array([getattr(self, name) for name in BOUNDS]).T
        return low, high - low

    def check_scene(self, scene: Scene) -> None:
        """Raise `BadValue` where noise is not white, or a response has another rate."""
        fits = self.coloured == NONE or isinstance(scene.noise, White)
        allowed = "must be [0, 0] where the sensor noise is not white"
        check(fits, "realism.coloured", list(self.coloured), allowed=allowed)
        if self.loudspeaker is not None:
            rate = scene.probe.sample_rate
            found = self.loudspeaker.sample_rate
            allowed = f"must have the probe's rate, {rate:g} Hz"
            check(found == rate, "realism.loudspeaker", f"{found:g} Hz", allowed=allowed)

    def draw(
        self, scene: Scene, rng: np.random.Generator, *, robot: np.random.Generator | None = None
    ) -> Imperfections:
        """Draw the imperfections of one recording.

        No draw depends on how wide the range of another is: each part has a generator of its own.

        Args:
            scene: the ideal one.
            rng: draws them.
            robot: draws what stays the same from pose to pose of a walk, all numbers and the
                robot's own parts; None: `rng` does.
        """
        here = rng.spawn(5)
        # The robot has three of the five parts, walls and clutter are those of a place.
        numbers, _, _, microphones, loudspeaker = robot.spawn(5) if robot else here
        _, walls, clutter, _, _ = here
        low, width = self._limits
        # As `uniform` draws them, without its checks of seventeen ranges for every row.
        values = low + width * numbers.random(len(low))
        drawn = dict(zip(BOUNDS, values.tolist(), strict=True))
        rate = scene.probe.sample_rate
        facing = loudspeaker.uniform(0.0, 2.0 * np.pi)
        count = round(drawn["scatterers"])
        return Imperfections(
            drawn=drawn,
            # Each wall takes between nothing and twice what was drawn, which is their mean.
            dulling=10.0 ** (-drawn["absorption_db"] * walls.uniform(0.0, 2.0, 6) / 20.0),
            clusters=clusters(
                7, spread=drawn["spread"] * rate, scattering=drawn["scattering"], rng=walls
            ),
            scatterers=_directions(count, clutter),
            ways=clutter.uniform(NEAREST_WAY, 1.0, count),
            facing=np.array([np.cos(facing), np.sin(facing), 0.0]),
            offsets=drawn["microphone_offset"] * microphones.standard_normal((len(scene.array), 3)),
            microphones=_microphones(drawn, len(scene.array), sample_rate=rate, rng=microphones),
            loudspeaker=_loudspeaker(drawn, sample_rate=rate, rng=loudspeaker)
            if self.loudspeaker is None
            else _measured(self.loudspeaker.samples),
        )


def _directions(count: int, rng: np.random.Generator) -> Array:
    """Draw unit vectors, as many on each side, shape (count, 3)."""
    vectors = rng.standard_normal((count, 3))
    return vectors / np.sqrt(np.vecdot(vectors, vectors))[:, None]


def _microphones(
    drawn: Mapping[str, float], count: int, *, sample_rate: float, rng: np.random.Generator
) -> Array:
    """Draw the responses of microphones, shape (count, MICROPHONE_TAPS).

    Args:
        drawn: deviations of gains and responses, in dB.
        count: number of microphones.
        sample_rate: in Hz.
        rng: draws them.
    """
    # Made with room to die away, then cut: the rest is 60 dB weaker.
    frequencies = _frequencies(sample_rate, 2 * MICROPHONE_TAPS)
    level = ripple(frequencies, drawn["microphone_ripple_db"], count=count, rng=rng)
    gain = 10.0 ** (drawn["microphone_db"] * rng.standard_normal((count, 1)) / 20.0)
    return gain * minimum_phase(level)[:, :MICROPHONE_TAPS]


def _loudspeaker(
    drawn: Mapping[str, float], *, sample_rate: float, rng: np.random.Generator
) -> Array:
    """Draw the response of a loudspeaker, of energy 1, shape (LOUDSPEAKER_TAPS,)."""
    frequencies = _frequencies(sample_rate, LOUDSPEAKER_TAPS)
    level = ripple(frequencies, drawn["loudspeaker_ripple_db"], count=1, rng=rng)[0]
    level += band_db(frequencies, low=drawn["loudspeaker_low"], high=drawn["loudspeaker_high"])
    response = minimum_phase(level)
    return response / np.linalg.norm(response)


@lru_cache
def _frequencies(sample_rate: float, count: int) -> Array:
    """Return frequencies from 0 to half the sample rate, evenly spaced, shape (count + 1,)."""
    return np.linspace(0.0, sample_rate / 2, count + 1)


def _measured(response: Array) -> Array:
    """Return a measured response, of energy 1, from a little before its largest peak on."""
    peak = int(np.argmax(np.abs(response)))
    kept = response[max(0, peak - MOST_BEFORE) : peak + LOUDSPEAKER_TAPS]
    return kept / np.linalg.norm(kept)
