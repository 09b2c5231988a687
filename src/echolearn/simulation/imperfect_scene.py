"""A scene that is not ideal: the responses that follow from drawn imperfections.

An ideal response h_m is split by linearity into the direct path d_m, the first-order echo e_wm of
each wall and the rest; each part has a filter of its own, and clutter is added:

    h'_m = mic_m * (D_m d_m + sum_w A_w R_w e_wm + B R_0 rest_m + clutter_m)
    x_m  = s * loudspeaker * h'_m

R are the clusters that rough walls make of a pulse; A, B, D leave a share of the high frequencies:
what the loudspeaker sends in a direction, times what reflections leave of it. In the rest these
are one for each mean free path 4 V / S that sound has gone, so its highs decay faster.

Small rigid spheres at r_1 from the loudspeaker and r_2 from a microphone scatter, a their radius,
a / 2 / (4 pi r_1 r_2) to all sides alike (Morse and Ingard, Theoretical Acoustics, section 8.2, far
above k a = 1, without the shadow).
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy import fft

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import turned
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.types import Array, Pose
from echolearn.simulation.arrivals import SoundPaths
from echolearn.simulation.imperfections import Imperfections
from echolearn.simulation.kernels import low_pass
from echolearn.simulation.noise.coloured import Coloured
from echolearn.simulation.realism import Realism
from echolearn.simulation.scene import Scene
from echolearn.simulation.ways import first_ways, free_path, ways_out

AHEAD = 64
"""Samples before time 0 that are kept until the loudspeaker's delay is taken off."""

SETTLED = 128
"""Samples after an arrival until nothing of it is left but what the loudspeaker makes of it."""

STEP = 64
"""Samples in a coarse step of a decay."""

REACH = 6.0
"""Metres to the farthest clutter."""


@dataclass(frozen=True, eq=False)
class ImperfectScene(Scene):
    """What an estimator is told of it is ideal; what is recorded has imperfections.

    Attributes:
        imperfections: those of one recording.
    """

    imperfections: Imperfections | None = None

    @cached_property
    def direct(self) -> Array:
        """Direct path at the microphones as calibration knows it, shape (M, N)."""
        direct = np.zeros((len(self.array), self.probe.length))
        direct[:, : self.beginning.shape[1]] = self.beginning
        return direct

    @cached_property
    def beginning(self) -> Array:
        """The direct path without the zeros behind it, which each recording would write and read.

        That would be a thirtieth of the time that a realistic response takes.
        """
        response = np.zeros((len(self.array), int(self._straight.delay.max()) + SETTLED))
        left = np.array(1.0 - self._flaws.drawn["residual"])
        self._add(self._straight.scaled(left), response)
        # All that the transform of `convolve` gives, to the last sample that only rounding fills.
        size = fft.next_fast_len(len(self._emitted) + response.shape[1] - 1, real=True)
        return self._recorded(response, length=min(size - AHEAD, self.probe.length))

    @cached_property
    def _straight(self) -> SoundPaths:
        """The direct path to the microphones, the same however the robot is turned."""
        places = self.array.positions + self._flaws.offsets
        distance = np.linalg.norm(places, axis=-1)[None]
        highs = self._flaws.sent(self.array.positions)[None]
        return self._arrivals(distance, highs=highs, clusters=np.ones((1, 1)))

    def received(self, room: AnyRoom, pose: Pose) -> Array:
        """Return the probe as received, without noise, shape (M, N)."""
        source = np.asarray(pose.position, dtype=float)
        places = turned(self.array.positions + self._flaws.offsets, pose.heading)
        response = self.rir(
            room,
            source,
            microphones=source + places,
            sample_rate=self.probe.sample_rate,
            speed_of_sound=self.speed_of_sound,
        )

        # What arrives with a wall or without is told apart from the rest, and changed for itself.
        single = self._straight.beside(self._walls(room, pose, places=places))
        single.subtract(response)
        response = self._rest(response, room)
        self._add(single.beside(self._clutter(room, pose, places=places)), response)
        return self._recorded(response, length=self.probe.length)

    def _add(self, arrivals: SoundPaths, response: Array) -> None:
        """Add arrivals to a response as the microphones hear them."""
        rate = self.probe.sample_rate
        arrivals.add(response, microphones=self._flaws.microphones, sample_rate=rate)

    @property
    def _flaws(self) -> Imperfections:
        """The imperfections, which every such scene has."""
        assert self.imperfections is not None
        return self.imperfections

    @property
    def _scale(self) -> float:
        """Samples per metre."""
        return self.probe.sample_rate / self.speed_of_sound

    def _walls(self, room: AnyRoom, pose: Pose, *, places: Array) -> SoundPaths:
        """Return the first-order echoes of a room's walls.

        Args:
            room, pose: where.
            places: of the microphones about the loudspeaker, in the room's frame, shape (M, 3).
        """
        source = np.asarray(pose.position, dtype=float)
        toward, way, reflection = first_ways(
            room, source, microphones=source + places, speed_of_sound=self.speed_of_sound
        )
        # A room of more walls than six has some that are alike.
        wall = np.arange(len(toward)) % len(self._flaws.dulling)
        highs = self._flaws.sent(turned(toward, -pose.heading)) * self._flaws.dulling[wall]
        echoes = self._arrivals(way, highs=highs[:, None], clusters=self._flaws.clusters[wall])
        return echoes.scaled(reflection)

    def _clutter(self, room: AnyRoom, pose: Pose, *, places: Array) -> SoundPaths:
        """Return what scatterers in the room send back; arguments as those of `_walls`."""
        flaws = self._flaws
        toward = turned(flaws.scatterers, pose.heading)
        farthest = np.minimum(ways_out(room, pose.position, toward=toward), REACH)
        there = (farthest * flaws.ways)[:, None]
        back = np.linalg.norm(there[..., None] * toward[:, None] - places, axis=-1)
        arrivals = self._arrivals(
            there + back,
            highs=flaws.sent(flaws.scatterers)[:, None],
            clusters=np.ones((len(there), 1)),
        )
        # From 1 / (4 pi way) to 1 / (4 pi there back), times the sphere.
        wider = (there + back) / (there * back)
        return arrivals.scaled(flaws.drawn["scatterer_radius"] / 2.0 * wider)

    def _arrivals(self, distance: Array, *, highs: Array, clusters: Array) -> SoundPaths:
        """Return arrivals by their ways in m, shape (P, M), of gain 1 / (4 pi way)."""
        return SoundPaths(
            delay=distance * self._scale,
            gain=1.0 / (4.0 * np.pi * distance),
            highs=np.broadcast_to(highs, distance.shape),
            clusters=clusters,
        )

    def _rest(self, response: Array, room: AnyRoom) -> Array:
        """Return all that is reflected more than once, as microphones hear it, shape (M, K)."""
        from echolearn.simulation.fir_loops import filtered_signals

        flaws = self._flaws
        loss = np.log(flaws.dulling.mean()) / (self._scale * free_path(room))
        # Of many reflections nobody knows the direction any more: the mean over all of them.
        sent = 1.0 - flaws.drawn["directivity"] / 2.0
        # exp(a + b) = exp(a) exp(b): one for each sample would take as long as the filter.
        steps = np.exp(loss * STEP * np.arange(response.shape[1] // STEP + 1))
        within = sent * np.exp(loss * np.arange(STEP))
        share = np.multiply.outer(steps, within).ravel()
        heard = [np.convolve(flaws.clusters[-1], microphone) for microphone in flaws.microphones]
        low = low_pass(self.probe.sample_rate)
        return filtered_signals(response, np.array(heard), low=low, share=share)

    def _recorded(self, response: Array, *, length: int) -> Array:
        """Return the burst as it is played, after a response (M, K), shape (M, length)."""
        return signals.convolve(self._emitted, response, length=length, skip=AHEAD)

    @cached_property
    def _emitted(self) -> Array:
        """The burst as the loudspeaker plays it, `AHEAD` samples late."""
        loudspeaker = self._flaws.loudspeaker
        # Calibration takes the loudspeaker's largest peak for its time 0, but for the latency.
        late = AHEAD + self._flaws.drawn["latency_samples"] - np.argmax(np.abs(loudspeaker))
        length = len(self.probe.samples) + len(loudspeaker) + 2 * AHEAD
        size = fft.next_fast_len(length, real=True)
        delay = np.exp(-2j * np.pi * fft.rfftfreq(size) * late)
        spectrum = signals.burst_spectrum(self.probe.samples, size) * fft.rfft(loudspeaker, size)
        return fft.irfft(spectrum * delay, size)[:length]


def realistic(
    scene: Scene,
    realism: Realism,
    *,
    rng: np.random.Generator,
    robot: np.random.Generator | None = None,
) -> tuple[Scene, dict[str, float]]:
    """Return a scene with the imperfections of one recording, and what was drawn by name.

    The same scene and nothing where everything is clean.

    Args:
        scene: the ideal one.
        realism: ranges from which the imperfections are drawn.
        rng, robot: as those of `Realism.draw`.
    """
    if realism.clean:
        return scene, {}
    flaws = realism.draw(scene, rng, robot=robot)
    own = {field.name: getattr(scene, field.name) for field in fields(scene)}
    if flaws.drawn["coloured"] > 0:
        own["noise"] = Coloured(flaws.drawn["coloured"], flaws.drawn["colour_hz"])
    return ImperfectScene(**own, imperfections=flaws), dict(flaws.drawn)
