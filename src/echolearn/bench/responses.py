"""Room impulse responses: `Images` beside pyroomacoustics and the generator of Habets.

All three sum every image within T60: pyroomacoustics up to the order that holds that ball
(`Pyroom.complete`), the generator of Habets (the one that the paper used) with order -1, its
high-pass off. The latter's time is proportional to the number of microphones, so it computes one
response, and is charged for as many as the others. Where there is CUDA, `TorchImages` is timed,
too. Rooms of other outlines, with as much floor and height, are timed beside a box, and rows of the
growing set with what is not ideal beside clean ones: all until the probe is received and the direct
path known.
"""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from echolearn.acoustics.geometry import microphone_positions
from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.bench.measurement import Measurement, Setting
from echolearn.dataset.plans import Plan
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.realism import Realism
from echolearn.simulation.responses import response_length
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.rir.torch_images import TorchImages
from echolearn.simulation.scene import Responder, Scene
from echolearn.simulation.torch_device import cuda_is_there

HALL = Room((10.0, 8.0, 6.0), 0.6)
"""The paper's training room."""

OUTLINES: dict[str, AnyRoom] = {
    "images, a box": HALL,
    "images, an L": PolygonRoom(
        ((0.0, 0.0), (11.0, 0.0), (11.0, 5.0), (5.0, 5.0), (5.0, 10.0), (0.0, 10.0)), 6.0, 0.6
    ),
    "images, five corners": PolygonRoom(
        ((0.0, 0.0), (9.49, 0.79), (11.07, 6.32), (4.74, 9.49), (-0.79, 5.53)), 6.0, 0.6
    ),
    "images, a pillar": PolygonRoom(
        ((0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0)),
        6.0,
        0.6,
        pillars=(((6.0, 5.0), (6.5, 5.0), (6.5, 5.5), (6.0, 5.5)),),
    ),
}
"""Rooms with 80 m^2 of floor, 6 m high."""

ROWS = 4
"""Rows that are received in a lap, of as many rooms."""

PLACE = Pose(np.array([3.1, 4.2, 2.9]), 0.4)


def time_responses(setting: Setting) -> Iterator[Measurement]:
    """Time the responses from one position to all microphones, over T60 and over microphones."""
    scene = setting.plan.scene
    for t60 in track(sorted({*setting.t60, *setting.peer_t60}), "bench rir", unit="T60"):
        room = replace(HALL, t60=t60)
        contestants = {"images": Contestant(responding(Images(), room, scene=scene))}
        if t60 in setting.peer_t60:
            contestants |= peers(room, scene)
        if cuda_is_there():
            contestants["torch, cuda"] = Contestant(responding(TorchImages(), room, scene=scene))
        yield from setting.compare("rir", contestants, parameter="t60", value=t60)
        # Images of one microphone within T60: the ball's volume over the room's.
        ball = 4 / 3 * math.pi * (t60 * scene.speed_of_sound) ** 3
        count = ball / math.prod(room.size)
        yield Measurement("rir", "images", "t60", t60, "images", "1", [count])
    others = {
        name: Contestant(responding(Images(), room, scene=scene)) for name, room in OUTLINES.items()
    }
    yield from setting.compare("rir", others, parameter="outline", value=HALL.t60)
    yield from setting.compare("rir", receivers(setting), parameter="realism", value=ROWS)
    rings = {
        count: Contestant(responding(Images(), HALL, scene=ring))
        for count, ring in setting.rings.items()
    }
    yield from setting.grow("rir", "images", parameter="microphones", contestants=rings)


def receivers(setting: Setting) -> dict[str, Contestant]:
    """Return what receives the first rows of the growing set, clean and realistic."""
    kinds = {"received, clean": Realism(), "received, realistic": setting.realistic}
    plans = {name: replace(setting.growing, realism=kind) for name, kind in kinds.items()}
    return {name: Contestant(partial(receive, plan), units=ROWS) for name, plan in plans.items()}


def receive(plan: Plan) -> None:
    """Receive the probe at `ROWS` rows of a plan; the direct path too where each has its own."""
    for row in range(ROWS):
        spot = plan.spot(row, stream(plan.seed, "observation", row))
        rng = stream(plan.seed, "realism", row)
        scene, drawn = realistic(plan.scene, plan.realism, rng=rng)
        scene.received(spot.room, spot.pose)
        if drawn:
            _ = scene.beginning


def responding(
    engine: Responder, room: AnyRoom, *, scene: Scene, pose: Pose = PLACE
) -> Callable[[], Array]:
    """Return a call of an engine for all microphones of a scene.

    Args:
        engine: computes the responses.
        room: where.
        scene: array, sample rate and speed of sound.
        pose: of the robot.
    """
    return partial(
        engine,
        room,
        pose.position,
        microphones=microphone_positions(scene.array, pose),
        sample_rate=scene.probe.sample_rate,
        speed_of_sound=scene.speed_of_sound,
    )


def peers(room: Room, scene: Scene) -> dict[str, Contestant]:
    """Return the peers; one that is not installed is left out, with a line about it."""
    found = {"pyroomacoustics": Contestant(responding(Pyroom(), room, scene=scene), warm=False)}
    try:
        single = habets(room, scene)
    except ModuleNotFoundError:
        left_out = "rir-generator is not installed, so it is left out"
        print(f"bench rir: {left_out}; pip install 'echolearn[peers]'", file=sys.stderr)
        return found
    return found | {"rir-generator": Contestant(single, units=1 / len(scene.array), warm=False)}


def habets(room: Room, scene: Scene) -> Callable[[], Array]:
    """Return a call of the generator of Habets for the first microphone, shape (N, 1).

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    import rir_generator

    rate = scene.probe.sample_rate
    return lambda: rir_generator.generate(
        c=scene.speed_of_sound,
        fs=int(rate),
        r=microphone_positions(scene.array, PLACE)[:1],
        s=PLACE.position,
        L=list(room.size),
        beta=room.reflection(scene.speed_of_sound),
        nsample=response_length(room, rate),
        order=-1,
        hp_filter=False,
    )
