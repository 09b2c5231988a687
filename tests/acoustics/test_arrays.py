"""What arrays tell apart, against the delays that their microphones have."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.acoustics import arrays, bistatic, geometry
from echolearn.acoustics.geometry import circular_array, direction
from echolearn.acoustics.types import MicArray

RING = circular_array()
TURNED = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
FLAT = np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [-0.1, -0.1, 0.0]])
SHAPES = {
    "ring": RING,
    "pair": MicArray(np.array([[0.1, 0.0, 0.2], [0.0, 0.1, 0.2]])),
    "line": MicArray(np.outer([0.0, 0.1, 0.15], [0.6, -0.8, 0.0])),
    "tilted line": MicArray(np.outer([0.0, 0.1, 0.15], TURNED[0])),
    "upright plane": MicArray(FLAT[:, [0, 2, 1]]),
    "tilted plane": MicArray(FLAT @ TURNED),
    "space": MicArray(np.vstack([FLAT, [0.0, 0.0, 0.1]])),
    "one": MicArray(np.array([[0.1, 0.0, 0.0]])),
    "mast": MicArray(np.outer([0.1, 0.2], [0.0, 0.0, 1.0])),
}
TOWARD = st.tuples(st.floats(-math.pi, math.pi), st.floats(0.0, math.pi)).map(
    lambda angles: direction(*angles)
)


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if shape != "one"])
@given(TOWARD, TOWARD)
def test_two_directions_become_one_just_where_no_delay_tells_them_apart(shape, first, second):
    """The nearest of those that sound as one does is as far from another as what they become."""
    array = SHAPES[shape]
    one, other = arrays.representative(array, np.array([first, second]))
    assert np.linalg.norm(one) == pytest.approx(1.0)
    for toward, become in ((first, one), (second, other)):
        before, after = geometry.relative_delays(array, np.array([toward, become]), scale=1.0)
        assert np.allclose(before, after, atol=1e-9)
    alike = sounding_alike(array, first) @ second
    assert alike.max() == pytest.approx(float(one @ other), abs=2e-4)


def sounding_alike(array, toward):
    """Return the directions that an array hears as one: turned around its line, mirrored in its
    plane, shape (A, 3)."""
    found = arrays.axes(array)
    if len(found) == 1:
        [line] = found
        angle = np.linspace(0.0, 2 * math.pi, 721)[:, None]
        upright = np.cross(line, toward)
        return (
            toward * np.cos(angle)
            + upright * np.sin(angle)
            + line * (line @ toward) * (1 - np.cos(angle))
        )
    if len(found) == 2:
        normal = np.cross(*found)
        return np.stack([toward, toward - 2 * (toward @ normal) * normal])
    return toward[None]


@given(TOWARD)
def test_of_a_ring_only_the_sign_of_z_is_lost_bit_by_bit(toward):
    expected = np.array([toward[0], toward[1], abs(toward[2])])
    assert np.array_equal(arrays.representative(RING, toward), expected)


@pytest.mark.parametrize(
    ("shape", "azimuth", "up", "words"),
    [
        ("ring", True, False, "a level plane: cannot tell up from down"),
        ("pair", True, False, "two microphones: cannot tell one side of it from the other"),
        ("line", True, False, "a line: cannot tell one side of it from the other"),
        ("tilted line", True, True, "a line: cannot tell"),
        ("upright plane", True, True, "an upright plane: cannot tell front from back"),
        ("tilted plane", True, True, "a tilted plane: cannot tell a direction from its mirror"),
        ("space", True, True, "tells all directions apart"),
        ("one", False, False, "one microphone: tells no directions"),
        ("mast", False, True, "an upright line: cannot tell azimuths"),
    ],
)
def test_what_an_array_tells_is_said(shape, azimuth, up, words):
    array = SHAPES[shape]
    assert arrays.tells_azimuth(array) is azimuth
    assert arrays.tells_up(array) is up
    assert arrays.limits(array).startswith(words)


def test_a_millimetre_out_of_its_plane_an_array_is_still_flat():
    rough = RING.positions + [[0.0, 0.0, 0.001 * (-1) ** m] for m in range(6)]
    assert len(arrays.axes(MicArray(rough))) == 2
    bent = RING.positions + [[0.0, 0.0, 0.02 * (-1) ** m] for m in range(6)]
    assert len(arrays.axes(MicArray(bent))) == 3


def test_waves_are_curved_by_half_the_square_of_the_width_over_the_distance():
    """A microphone y aside of the way to a source 2 D off hears it y^2 / (4 D) later."""
    pair = MicArray(np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0]]))
    error = bistatic.plane_wave_error(pair, distance=1.0)
    assert error == pytest.approx(0.1**2 / 4.0, rel=0.05)
    assert bistatic.plane_wave_error(pair, distance=10.0) == pytest.approx(error / 10, rel=0.05)


@pytest.mark.parametrize("shape", SHAPES)
def test_upright_walls_have_a_mirror_image_just_where_no_delay_tells_it(shape):
    array = SHAPES[shape]
    axis = arrays.mirror_azimuth(array)
    mirrored = {"pair", "line", "tilted line", "upright plane"}
    assert (axis is not None) == (shape in mirrored)
    if axis is not None:
        azimuth = np.linspace(-3.0, 3.0, 7)
        both = direction(np.array([azimuth, 2.0 * axis - azimuth]), np.pi / 2)
        one, other = geometry.relative_delays(array, both, scale=1.0)
        assert np.allclose(one, other, atol=1e-9)
