"""Every localizer with every array of `conf/scene`, and with arrays drawn at random."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

from echolearn.acoustics import arrays, bistatic, signals
from echolearn.acoustics.geometry import SearchWindow, circular_array, direction
from echolearn.acoustics.types import MicArray, Observation
from echolearn.localization.columns import COLUMNS
from echolearn.localization.localize import localize
from reference import padded, shift
from refusals import refused

CONF = Path(__file__).parents[2] / "conf"
BLANK = "array"
"""The scene that is filled in on the command line."""

RATE = 22050.0
PROBE = signals.noise_probe(burst=400, length=6000)
NAMES = sorted(path.stem for path in (CONF / "localizer").glob("*.yaml"))
SCENES = sorted({path.stem for path in (CONF / "scene").glob("*.yaml")} - {BLANK, "survey"})
LEVEL = np.pi / 2


def called(content, **changed):
    """Call what a configuration names, with its other keys."""
    arguments = {key: value for key, value in content.items() if key != "_target_"}
    module, _, name = content["_target_"].rpartition(".")
    return getattr(import_module(module), name)(**arguments | changed)


def localizer(name, **changed):
    content = yaml.safe_load((CONF / "localizer" / f"{name}.yaml").read_text())
    return called(content, **{"window": SearchWindow()} | changed)


def array_of(scene):
    return called(yaml.safe_load((CONF / "scene" / f"{scene}.yaml").read_text())["array"])


def recorded(array, normals, distance):
    """Return exact echoes of single walls, spherical waves of their mirror sources, in noise."""
    rng = np.random.default_rng(0)
    burst = padded(PROBE.samples, PROBE.length)
    samples = []
    for normal in normals:
        ways = np.linalg.norm(2 * distance * normal - array.positions, axis=1)
        samples.append([0.1 * shift(burst, way * RATE / 343.0) for way in ways])
    noise = 0.005 * rng.standard_normal(np.shape(samples))
    return Observation(np.array(samples) + noise, PROBE, array)


def missed(echoes, array, normals, distance):
    """Return by how much directions are missed, but for what the array cannot tell, in degrees."""
    found = direction(echoes.azimuth[:, 0], echoes.elevation[:, 0])
    truth = bistatic.echo_direction(np.full(len(normals), distance), normals, array=array)
    alike = (arrays.representative(array, found) * arrays.representative(array, truth)).sum(axis=-1)
    return np.degrees(np.arccos(np.clip(alike, -1.0, 1.0)))


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", NAMES)
def test_every_localizer_finds_time_and_direction_with_every_array(name, scene):
    array = array_of(scene)
    normals = direction(np.array([-3.0, -1.2, 0.4, 1.9]), LEVEL)
    echoes = localizer(name)(recorded(array, normals, 1.4))
    path = bistatic.echo_path(np.full(4, 1.4), normals, array=array)
    assert np.allclose(echoes.toa[:, 0] * RATE, path * RATE / 343.0, atol=1.0)
    assert missed(echoes, array, normals, 1.4).max() < 5.0


@pytest.mark.parametrize("microphones", [2, 3, 5, 12])
def test_so_it_does_with_microphones_anywhere(microphones):
    """And the map point is the wall's, where the array can tell the side."""
    rng = np.random.default_rng(microphones)
    middle = rng.uniform(-0.4, 0.4, 3)
    array = MicArray(middle + rng.uniform(-0.12, 0.12, (microphones, 3)))
    normals = direction(rng.uniform(-np.pi, np.pi, 3), LEVEL)
    for name in ("joint", "snls"):
        batch = recorded(array, normals, 1.6)
        echoes, columns = localize(batch, localizer(name), names=[*COLUMNS, "covariance_gated"])
        assert missed(echoes, array, normals, 1.6).max() < 5.0
        assert all(np.isfinite(column).all() for column in columns.values())
        if len(arrays.axes(array)) == 3:
            points = bistatic.wall_points(
                *(getattr(echoes, field)[:, 0] for field in ("toa", "azimuth", "elevation")),
                position=np.zeros(2),
                heading=0.0,
                array=array,
            )
            assert np.linalg.norm(points - 1.6 * normals[:, :2], axis=1).max() < 0.15


@pytest.mark.parametrize("scene", ["respeaker", "octahedron"])
def test_a_small_array_is_climbed_from_the_cell_beside(scene):
    """Between two samples the best of the grid is several cells off: 8 degrees with these."""
    array = array_of(scene)
    normals = direction(np.linspace(-3.0, 3.0, 24), LEVEL)
    echoes = localizer("joint")(recorded(array, normals, 1.4))
    assert missed(echoes, array, normals, 1.4).max() < 0.5


def test_an_array_that_tells_up_from_down_finds_floor_and_ceiling():
    array = array_of("octahedron")
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    for name in ("gated", "joint", "em"):
        echoes = localizer(name)(recorded(array, normals, 1.3))
        assert np.allclose(echoes.elevation[:, 0], [0.0, np.pi])
    ring = localizer("joint")(recorded(circular_array(), normals, 1.3))
    assert np.array_equal(ring.elevation, np.zeros((2, 1)))


def test_an_array_above_its_loudspeaker_places_walls_where_they_are():
    """0.3 m higher it sees the mirror source 7 degrees below it; level, points were 1 cm off."""
    array = MicArray(circular_array(radius=0.1).positions + [0.0, 0.0, 0.3])
    normals = direction(np.array([-2.0, 0.3, 1.0]), LEVEL)
    echoes = localizer("joint")(recorded(array, normals, 1.2))
    truth = bistatic.echo_direction(np.full(3, 1.2), normals, array=array)
    assert np.allclose(np.cos(echoes.elevation[:, 0]), truth[:, 2], atol=1e-3)
    toward = direction(echoes.azimuth, echoes.elevation)
    assert np.allclose(bistatic.wall_distance(echoes.toa, toward, array=array), 1.2, atol=0.003)


@pytest.mark.parametrize("name", NAMES)
def test_microphones_one_above_another_hear_no_azimuth(name):
    mast = MicArray(np.array([[0.1, 0.0, height] for height in (0.0, 0.1, 0.2)]))
    silence = Observation(np.ones((1, 3, 6000)), PROBE, mast)
    with refused("array.positions=an upright line: cannot tell azimuths: must not stand one above"):
        localizer(name)(silence)


@pytest.mark.parametrize("name", ["gated", "joint", "em"])
def test_under_a_low_ceiling_the_strongest_echo_of_a_wall_is_sought(name):
    """Floor and ceiling 1.1 m away and louder; where they are not, it is the strongest of all."""
    array = circular_array()
    wall = direction(0.7, LEVEL)
    up = np.array([0.0, 0.0, 1.0])
    alone = recorded(array, np.array([wall, wall]), 1.5)
    loud = recorded(array, np.array([up, -up]), 1.1).samples
    samples = alone.samples.copy()
    samples[0] += 2 * loud[0] + 1.5 * np.roll(loud[1], 9, axis=-1)
    batch = Observation(samples, PROBE, array)
    plain, auto = localizer(name), localizer(name, echoes="auto")
    assert plain(batch).elevation[0, 0] == 0.0
    found = auto(batch)
    assert found.toa.shape == (2, 1)
    path = bistatic.echo_path(1.5, wall, array=array)
    assert found.toa[0, 0] * RATE == pytest.approx(path * RATE / 343.0, abs=1.0)
    assert np.degrees(found.azimuth[0, 0] - 0.7) == pytest.approx(0.0, abs=3.0)
    # The second needs no more than it.
    for field, values in vars(plain(batch)).items():
        assert np.array_equal(getattr(found, field)[1], values[1])
    # Two are stronger than the first wall, of which the nearer comes before it.
    several, described = localize(batch, localizer(name, echoes=5))
    number = int(np.abs(several.toa[0] - found.toa[0]).argmin())
    _, columns = localize(batch, auto)
    assert columns["toa"].shape == (2,) and columns["rank"].tolist() == [number, 0.0]
    others = np.delete(several.toa[0], number)
    nearest = np.abs(others - several.toa[0, number]).argmin()
    apart = np.abs(others - several.toa[0, number]).min() * RATE
    assert columns["neighbour_lag"][0] == pytest.approx(apart)
    loudest = np.delete(several.gain[0], number)[nearest]
    assert columns["neighbour_gain"][0] == pytest.approx(loudest / several.gain[0, number])
    assert number >= 2 and columns["neighbour_gain"][1] == 0.0


@pytest.mark.parametrize("name", sorted({*NAMES} - {"gated", "joint", "em", "mclam"}))
def test_what_takes_directions_from_the_whole_recording_cannot_tell_the_ceiling(name):
    with refused("localizer.echoes=auto: must be a whole number; gated, joint and em tell floor"):
        localizer(name, echoes="auto")


def anywhere(count):
    """Return directions of the whole sphere, at least 10 degrees off the level plane."""
    rng = np.random.default_rng(1)
    height = rng.uniform(np.sin(np.radians(10.0)), 1.0, count) * rng.choice([-1.0, 1.0], count)
    return direction(rng.uniform(-np.pi, np.pi, count), np.arccos(height))


@pytest.mark.parametrize("scene", ["octahedron", "tetrahedron", "ring"])
def test_elevations_are_found_as_far_as_the_array_tells_them(scene):
    """Within 5 degrees on the whole sphere, of a ring but for the sign, and never below it."""
    array = array_of(scene)
    normals = anywhere(5)
    for name in ("joint", "em"):
        echoes = localizer(name, azimuths=90, elevations=18)(recorded(array, normals, 1.4))
        assert missed(echoes, array, normals, 1.4).max() < 5.0
        below = (echoes.elevation > LEVEL).any()
        assert below == arrays.tells_up(array)
    for name in ("snls", "mclam"):
        found = localizer(name, azimuths=90, elevations=18)(recorded(array, normals, 1.4))
        assert np.median(missed(found, array, normals, 1.4)) < 8.0
        assert (found.elevation > LEVEL + 1e-9).any() == arrays.tells_up(array)


@pytest.mark.parametrize("name", ["gated", "peaks"])
def test_who_seeks_no_elevations_says_who_does(name):
    with refused("localizer.elevations=6: must be 1; joint, em, snls and mclam seek directions"):
        localizer(name, elevations=6)


def test_too_fine_a_grid_of_elevations_is_refused():
    with refused("localizer.azimuths=180: azimuths * elevations must be at most 7200"):
        localizer("joint", elevations=41)
