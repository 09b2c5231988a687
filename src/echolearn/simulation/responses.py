"""Room impulse responses: engines of one interface, `echolearn.simulation.scene.Responder`.

Every engine sums the mirror images of the source whose sound arrives within the response (Allen and
Berkley 1979),

    h_m(n) = sum over images of g / (4 pi d_m) phi(n - d_m fs / c),

with g the product of the walls' reflection coefficients on the way, d_m the image's distance from
microphone m and phi the engine's band-limited fractional delay, centred on 0: no engine adds a
delay of its own. Samples before the emission are cut off, so a direct path shorter than half of phi
loses the beginning of its ripple.
"""

import math

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import inside
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array
from echolearn.checks import check, check_rate, check_speed

MOST_IMAGES = 1e8
"""Images per microphone that an engine agrees to sum: seconds for `Images`, minutes for `Pyroom`.
"""


def response_length(room: AnyRoom, sample_rate: float) -> int:
    """Return the number of samples of a response: round(t60 * sample_rate)."""
    return round(room.t60 * sample_rate)


def check_placement(
    room: AnyRoom, source: Array, *, microphones: Array, sample_rate: float, speed_of_sound: float
) -> None:
    """Check what every engine is called with.

    Args:
        room: with its walls.
        source: shape (3,), in m.
        microphones: shape (M, 3), in m.
        sample_rate: in Hz.
        speed_of_sound: in m/s.

    Raises:
        BadValue: a wrong shape, a point outside the room, a microphone on the source, a source on
            a wall where the room is no box, a rate or speed out of range, or a T60 so long that the
            images cannot be counted out in reasonable time.
    """
    check_rate("sample_rate", sample_rate)
    check_speed("speed_of_sound", speed_of_sound)
    allowed = "must have shape (3,), in m"
    check(np.shape(source) == (3,), "source", np.shape(source), allowed=allowed)
    shape = np.shape(microphones)
    fits = len(shape) == 2 and shape[1] == 3 and shape[0] > 0
    check(fits, "microphones", shape, allowed="must have shape (M, 3), in m")
    _check_inside("source", np.atleast_2d(source), room=room)
    _check_inside("microphones", np.asarray(microphones), room=room)

    if isinstance(room, PolygonRoom):
        away = float(distance_to_outline(np.asarray(source)[:2], room.faces[0]))
        allowed = "must be more than 0.001 m away from it"
        check(away > 1e-3, "source", f"{away:g} m from a wall", allowed=allowed)
    nearest = float(np.linalg.norm(np.asarray(microphones) - np.asarray(source), axis=1).min())
    allowed = "must be more than 0.001 m away from it"
    check(nearest > 1e-3, "microphones", f"{nearest:g} m from the source", allowed=allowed)

    images = 4 / 3 * math.pi * (room.t60 * speed_of_sound) ** 3 / room.volume
    allowed = f"must give at most {MOST_IMAGES:.0e} images within T60, here {images:.1e}"
    hint = "is the room that small?"
    check(images < MOST_IMAGES, "room.t60", f"{room.t60:g} s", allowed=allowed, hint=hint)


def _check_inside(name: str, points: Array, *, room: AnyRoom) -> None:
    """Raise `BadValue` unless all points (P, 3) lie in the room."""
    within = inside(room, points)
    if within.all():
        return
    place = np.round(points[np.argmin(within)], 3).tolist()
    check(False, name, f"{place} m", allowed=f"must be inside the {room.dimensions} room")
