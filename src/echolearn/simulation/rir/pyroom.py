"""Image sources by pyroomacoustics (Scheibler, Bezzam and Dokmanic 2018), the reference engine.

What pyroomacoustics 0.10 does differently from the project's convention, and is undone here:

- its fractional delay, a sinc in a Hann window of 81 taps, starts 40 samples late: these are cut
  off;
- its amplitudes are g / d: divided by 4 pi;
- it passes every response through a high-pass of 10 Hz, forwards and backwards: switched off;
- `inverse_sabine` gives a reflection order whose octahedron of images does not hold the ball of
  radius c T60: it measures the edges of the octahedron, not its faces. Semi-axes of n L_i hold a
  ball of radius n / sqrt(sum 1 / L_i^2), and an image of order n along an axis is at least (n - 1)
  L_i away: `complete_order`.

What remains is its filter: tabulated in single precision, the window centred on a whole sample. Its
responses are within -50 dB of the closed form below 0.9 of Nyquist.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pyroomacoustics

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.types import Array, Room
from echolearn.checks import BadValue, check
from echolearn.simulation.responses import check_placement, response_length

WALLS = ("west", "east", "south", "north", "floor", "ceiling")
"""pyroomacoustics' names in the project's wall order."""

CONSTANTS = {"rir_hpf_enable": False, "num_threads": 1, "frac_delay_length": 81}
"""Settings of pyroomacoustics that hold during a call."""


def complete_order(room: Room, speed_of_sound: float) -> int:
    """Return a reflection order that holds every image within T60."""
    if not any(room.walls):
        return 0
    reach = room.t60 * speed_of_sound
    return 3 + math.ceil(reach * math.sqrt(sum(length**-2 for length in room.size)))


@contextmanager
def constants(values: dict[str, object]) -> Iterator[None]:
    """Set global constants of pyroomacoustics and put the old ones back."""
    before = {name: pyroomacoustics.constants.get(name) for name in values}
    try:
        for name, value in values.items():
            pyroomacoustics.constants.set(name, value)
        yield
    finally:
        for name, value in before.items():
            pyroomacoustics.constants.set(name, value)


@dataclass(frozen=True)
class Pyroom:
    """Compute responses with pyroomacoustics: slow, and known to everybody.

    Attributes:
        complete: whether every image within T60 is held; otherwise the order is the one that
            pyroomacoustics' `inverse_sabine` recommends, which is faster and loses late images.
    """

    complete: bool = True

    def __post_init__(self) -> None:
        known = isinstance(self.complete, bool)
        check(known, "rir.complete", self.complete, allowed="must be true or false")

    def order(self, room: Room, speed_of_sound: float) -> int:
        """Return the reflection order to use in `room`."""
        if self.complete or not any(room.walls):
            return complete_order(room, speed_of_sound)
        return int(pyroomacoustics.inverse_sabine(room.t60, room.size, c=speed_of_sound)[1])

    def __call__(
        self,
        room: AnyRoom,
        source: Array,
        *,
        microphones: Array,
        sample_rate: float,
        speed_of_sound: float,
    ) -> Array:
        """Return responses, shape (M, K); arguments as those of `simulation.scene.Responder`."""
        if not isinstance(room, Room):
            raise BadValue("rir=pyroom: must be images or torch where the room is no box")
        check_placement(
            room,
            source,
            microphones=microphones,
            sample_rate=sample_rate,
            speed_of_sound=speed_of_sound,
        )
        whole = float(sample_rate).is_integer()
        allowed = "must be a whole number for pyroomacoustics"
        check(whole, "sample_rate", f"{sample_rate} Hz", allowed=allowed)
        absorption = 1.0 - room.reflection(speed_of_sound) ** 2
        materials = dict(zip(WALLS, map(pyroomacoustics.Material, absorption), strict=True))
        with constants({**CONSTANTS, "c": speed_of_sound}):
            order = self.order(room, speed_of_sound)
            about = {"fs": int(sample_rate), "materials": materials, "max_order": order}
            shoebox = pyroomacoustics.ShoeBox(room.size, **about)
            shoebox.set_sound_speed(speed_of_sound)
            shoebox.add_source(np.array(source, dtype=float))
            shoebox.add_microphone_array(np.array(microphones, dtype=float).T)
            shoebox.compute_rir()

        # The filter's delay is cut off, what is missing at the end is silent.
        response = np.zeros((len(microphones), response_length(room, sample_rate)))
        late = CONSTANTS["frac_delay_length"] // 2
        for row, found in zip(response, shoebox.rir, strict=True):
            part = found[0][late:][: len(row)]
            row[: len(part)] = part
        return response / (4 * np.pi)
