"""Rooms of any outline: images against pyroomacoustics' polyhedra, a box, and mirrors by hand."""

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pyroomacoustics
import pytest

from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.acoustics.polygon_room import DOOR, PolygonRoom
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.sides import twice_area
from echolearn.acoustics.types import Pose, Room
from echolearn.simulation import beam_loops
from echolearn.simulation.beams import plan_images
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.rir.torch_images import TorchImages
from interpreted import interpret
from reference import RATE, SPEED
from refusals import refused

L = ((0.0, 0.0), (7.0, 0.0), (7.0, 3.0), (4.0, 3.0), (4.0, 6.5), (0.0, 6.5))
FIVE = ((0.0, 0.0), (6.0, 0.5), (7.0, 4.0), (3.0, 6.0), (-0.5, 3.5))
PILLAR = ((2.6, 2.2), (2.6, 2.6), (3.0, 2.6), (3.0, 2.2))
FACTORS = (1.0, 0.9, 0.0, 0.8, 1.0, 0.7, 0.9, 0.6)
ROOMS = {
    "an L": PolygonRoom(L, 2.6, 0.6, walls=FACTORS),
    "five corners": PolygonRoom(FIVE, 3.0, 0.5),
    "a pillar and a door": PolygonRoom(
        L[::-1], 2.6, 0.6, pillars=(PILLAR,), doors=((4, 0.5, 1.4), (4, 2.0, 7.0))
    ),
}
SOURCE = np.array([1.43, 1.81, 1.2])
MICROPHONES = np.array([[1.61, 1.72, 1.3], [3.4, 2.9, 1.1], [2.1, 2.95, 2.0], [3.7, 0.8, 0.4]])
HIGHEST = 3


def images_of(room, microphone, *, highest):
    """List squared distances and gains of the images up to an order, shape (any, 2)."""
    gains = room.reflection(SPEED)
    sides = len(room.corners)
    orders = plan_images(
        room,
        SOURCE[:2],
        microphones=microphone[None, :2],
        reflection=gains,
        reach=200.0,
        faint=1e-9,
    )
    found = []
    for order, heard in enumerate(islice(orders, highest + 1)):
        for cell in range(order - highest, highest - order + 1):
            height = cell * room.height + (SOURCE[2] if cell % 2 == 0 else room.height - SOURCE[2])
            lower, upper = (abs(cell) + (cell < 0)) // 2, (abs(cell) + (cell > 0)) // 2
            gain = gains[sides] ** lower * gains[sides + 1] ** upper
            square = heard[:, 1] + (height - microphone[2]) ** 2
            found.append(np.stack([square, heard[:, 2] * gain], axis=1))
    every = np.concatenate(found)
    return every[every[:, 1] > 0]


def polyhedron(room, *, highest):
    """Build the room of pyroomacoustics, wall by wall."""
    sides, numbers = room.faces
    gains = np.append(room.reflection(SPEED), 0.0)
    up = room.height * np.array([[0.0, 0.0, 1.0]])
    walls = []

    def add(corners, number):
        absorbed = np.array([1.0 - gains[number] ** 2])
        name = str(len(walls))
        walls.append(pyroomacoustics.wall_factory(corners.T, absorbed, np.zeros(1), name))

    for (start, end), number in zip(sides, numbers, strict=True):
        ground = np.pad(np.stack([start, end]), ((0, 0), (0, 1)))
        add(np.concatenate([ground, ground[::-1] + up]), number)
    # All normals point out of the room. Under a pillar there is floor: nobody stands there.
    outline = np.pad(np.array(room.corners), ((0, 0), (0, 1)))
    outline = outline[:: 1 if twice_area(outline[:, :2]) > 0 else -1]
    add(outline[::-1], len(room.corners))
    add(outline + up, len(room.corners) + 1)
    return pyroomacoustics.Room(walls, fs=int(RATE), max_order=highest)


def their_images(room, *, highest):
    """List squared distances and gains for each microphone, as pyroomacoustics has them."""
    built = polyhedron(room, highest=highest)
    built.add_source(SOURCE)
    built.add_microphone_array(MICROPHONES.T)
    built.image_source_model()
    [source] = built.sources
    found = []
    for microphone, seen in zip(MICROPHONES, built.visibility[0], strict=True):
        square = ((source.images.T - microphone) ** 2).sum(axis=1)
        both = np.stack([square, source.damping[0]], axis=1)[seen.astype(bool)]
        found.append(both[both[:, 1] > 1e-6])
    return found


def in_order(images):
    return images[np.lexsort(np.round(images, 3).T)]


@pytest.mark.parametrize("name", ROOMS)
def test_images_are_those_of_pyroomacoustics_polyhedra(name):
    room = ROOMS[name]
    for microphone, theirs in zip(MICROPHONES, their_images(room, highest=HIGHEST), strict=True):
        ours = images_of(room, microphone, highest=HIGHEST)
        assert len(ours) == len(theirs) > 20
        assert np.allclose(in_order(ours), in_order(theirs), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["an L", "a pillar and a door"])
def test_as_python_the_loops_find_the_same_images(name, monkeypatch):
    """Those of fewer orders than above, at one microphone."""
    interpret(beam_loops, monkeypatch)
    room = ROOMS[name]
    theirs = their_images(room, highest=2)[0]
    ours = images_of(room, MICROPHONES[0], highest=2)
    assert len(ours) == len(theirs) > 10
    assert np.allclose(in_order(ours), in_order(theirs), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    ("place", "heading"),
    [((2.1, 1.7, 2.2), 0.3), ((4.0, 3.0, 2.5), math.pi / 4), ((1.5, 1.5, 2.5), math.pi / 4)],
)
def test_a_box_drawn_as_a_polygon_sounds_like_a_box(place, heading):
    """In its middle, and where sound goes just through corners, too."""
    walls = (1.0, 0.5, 0.9, 1.0, 0.8, 1.0)
    box = Room((8.0, 6.0, 5.0), 0.3, walls)
    corners = ((-1.0, 2.0), (7.0, 2.0), (7.0, 8.0), (-1.0, 8.0))
    drawn = PolygonRoom(corners, 5.0, 0.3, tuple(walls[k] for k in (2, 1, 3, 0, 4, 5)))
    microphones = microphone_positions(circular_array(), Pose(np.array(place), heading))
    about = {"sample_rate": RATE, "speed_of_sound": SPEED}
    shift = np.array([-1.0, 2.0, 0.0])
    expected = Images()(box, np.array(place), microphones=microphones, **about)
    found = Images()(drawn, np.array(place) + shift, microphones=microphones + shift, **about)
    error = np.sum((found - expected) ** 2) / np.sum(expected**2)
    assert found.shape == expected.shape and 10 * np.log10(error) < -100.0


def test_what_an_engine_cannot_do_is_refused():
    about = {"sample_rate": RATE, "speed_of_sound": SPEED}
    with refused("rir=pyroom: must be images or torch where the room is no box"):
        Pyroom()(ROOMS["an L"], SOURCE, microphones=MICROPHONES, **about)
    with refused("microphones=[3.4, 5.9, 1.1] m: must be inside the 5-cornered 32 m^2 x 3 m room"):
        Images()(ROOMS["five corners"], SOURCE, microphones=MICROPHONES + [0.0, 3.0, 0.0], **about)
    with refused("source=0 m from a wall: must be more than 0.001 m away from it"):
        Images()(ROOMS["an L"], np.array([2.0, 0.0, 1.0]), microphones=MICROPHONES, **about)


def test_torch_sums_the_same_images():
    about = {"sample_rate": RATE, "speed_of_sound": SPEED}
    room = replace(ROOMS["a pillar and a door"], t60=0.15)
    expected = Images()(room, SOURCE, microphones=MICROPHONES, **about)
    found = TorchImages("cpu")(room, SOURCE, microphones=MICROPHONES, **about)
    error = np.sum((found - expected) ** 2) / np.sum(expected**2)
    assert found.shape == expected.shape and 10 * np.log10(error) < -100.0


@pytest.mark.parametrize("name", ROOMS)
def test_first_order_images_are_the_true_echoes(name):
    room = ROOMS[name]
    array = circular_array(microphones=4, radius=0.1)
    microphone = microphone_positions(array, Pose(SOURCE))[0]
    truth = np.sort(true_echoes(room, Pose(SOURCE), array=array).toa * SPEED)
    both = [images_of(room, microphone, highest=highest)[:, 0] for highest in (0, 1)]
    first = np.sort(np.sqrt(np.setdiff1d(both[1], both[0])))
    assert len(truth) > 3 and np.allclose(first, truth, atol=1e-6)


@pytest.mark.parametrize("name", ROOMS)
def test_whoever_hears_is_heard_as_well(name):
    """Loudspeaker and microphone change places: of images in the hundreds none is lost or new."""
    room = ROOMS[name]
    here, there = SOURCE[:2], MICROPHONES[1, :2]
    about = {"reflection": room.reflection(SPEED), "reach": 40.0, "faint": 1e-9}
    forth = np.concatenate(list(plan_images(room, here, microphones=there[None], **about)))[:, 1:]
    back = np.concatenate(list(plan_images(room, there, microphones=here[None], **about)))[:, 1:]
    # Of images out of reach some may be told.
    near = [in_order(images[images[:, 0] < 40.0**2]) for images in (forth, back)]
    assert len(near[0]) == len(near[1]) > 40
    assert np.allclose(*near, rtol=1e-5)


def test_doors_shorten_the_reverberation_and_nothing_else_does():
    """The late energy of a room with an open door, over that of the same room, at one place."""
    shut = PolygonRoom(L, 2.6, 0.3)
    late = slice(round(0.15 * RATE), None)
    about = {"sample_rate": RATE, "speed_of_sound": SPEED}
    energies = []
    for doors in ((), ((0, 2.0, 2.9),), ((0, 2.0, 5.0),)):
        room = PolygonRoom(L, 2.6, 0.3, doors=doors)
        [response] = Images()(room, SOURCE, microphones=MICROPHONES[:1], **about)
        energies.append(np.sum(response[late] ** 2))
    whole = Images()(shut, SOURCE, microphones=MICROPHONES[:1], **about)[0]
    assert energies[0] == np.sum(whole[late] ** 2)
    assert 1.0 > energies[1] / energies[0] > energies[2] / energies[1] > 0.0
    assert (shut.faces[1] != DOOR).all()
