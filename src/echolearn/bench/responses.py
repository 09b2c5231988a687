"""Room impulse responses: `Images` beside pyroomacoustics and the generator of Habets, and how its
time grows.

All three sum every image within T60: pyroomacoustics up to the order that holds that ball
    (`Pyroom.complete`), the
generator of Habets (the one that the paper used) with order -1, its high-pass off. The latter's
time is proportional to the number of microphones, so it computes one response, and is charged for
as many as the others.
"""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant
from echolearn.simulation.responses import response_length
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.scene import Scene

HALL = Room((10.0, 8.0, 6.0), 0.6)
"""The paper's training room."""

PLACE = Pose(np.array([3.1, 4.2, 2.9]), 0.4)
STAGE = "rir"


def responses(setting: Setting) -> Iterator[Measurement]:
    """Time the responses from one position to all microphones, over T60 and over microphones."""
    scene = setting.plan.scene
    for t60 in track(
        sorted({*setting.t60, *setting.peer_t60}), "bench rir", unit="reverberation times"
    ):
        room = replace(HALL, t60=t60)
        peers = rivals(room, scene) if t60 in setting.peer_t60 else {}
        laps = setting.race({"images": Contestant(engine(Images(), room, scene))} | peers)
        yield from times(STAGE, laps, reference="images", parameter="t60", value=t60)
        yield Measurement(
            STAGE, "images", "t60", t60, "images", "1", [images(room, scene.speed_of_sound)]
        )
    rings = {
        str(count): Contestant(
            engine(Images(), HALL, replace(scene, array=circular_array(microphones=count)))
        )
        for count in setting.microphones
    }
    for count, taken in setting.race(rings).items():
        yield from times(STAGE, {"images": taken}, parameter="microphones", value=int(count))


def images(room: Room, speed_of_sound: float) -> float:
    """Return the number of images within T60 of one microphone: the ball's volume over the room's."""
    return 4 / 3 * math.pi * (room.t60 * speed_of_sound) ** 3 / math.prod(room.size)


def engine(compute: Images | Pyroom, room: Room, scene: Scene) -> Callable[[], Array]:
    """Return a call of an engine for all microphones of a scene."""
    at, rate = microphone_positions(scene.array, PLACE), scene.probe.sample_rate
    return lambda: compute(
        room, PLACE.position, at, sample_rate=rate, speed_of_sound=scene.speed_of_sound
    )


def rivals(room: Room, scene: Scene) -> dict[str, Contestant]:
    """Return the peers; the optional one is left out, with a word about it, where it is not
    installed.
    """
    found = {"pyroomacoustics": Contestant(engine(Pyroom(), room, scene), warm=False)}
    try:
        one = habets(room, scene)
    except ModuleNotFoundError:
        hint = "pip install 'echolearn[peers]'"
        print(
            f"bench rir: rir-generator is not installed, so it is left out; {hint}",
            file=sys.stderr,
            flush=True,
        )
        return found
    return found | {"rir-generator": Contestant(one, units=1 / len(scene.array), warm=False)}


def habets(room: Room, scene: Scene) -> Callable[[], Array]:
    """Return a call of the generator of Habets for the first microphone, shape (N, 1).

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    import rir_generator

    length, rate = response_length(room, scene.probe.sample_rate), int(scene.probe.sample_rate)
    about = {"L": list(room.size), "beta": room.reflection(scene.speed_of_sound), "nsample": length}
    first = microphone_positions(scene.array, PLACE)[:1]
    where = {"c": scene.speed_of_sound, "fs": rate, "r": first, "s": PLACE.position}
    return lambda: rir_generator.generate(**where, **about, order=-1, hp_filter=False)
