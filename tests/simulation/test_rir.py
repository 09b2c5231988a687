"""Both engines against closed forms, against each other, and against the laws of a shoebox."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import BadValue
from echolearn.simulation import image_loops
from echolearn.simulation.image_loops import fractional_delay
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom, complete_order

RATE, SPEED = 22_050.0, 343.0
SMALL = Room((4.2, 3.1, 2.6), 0.16)
SOURCE = np.array([1.13, 0.94, 1.27])
MICROPHONES = np.array([[2.91, 2.02, 0.81], [3.07, 1.18, 1.69]])
CORNER = (1.0, 0.0, 0.0, 1.0, 0.7, 0.0)
ANECHOIC = (0.0,) * 6
engines = pytest.mark.parametrize("engine", [Images(), Pyroom()], ids=["images", "pyroom"])


def respond(engine, room, source=SOURCE, microphones=MICROPHONES):
    return engine(room, source, microphones, sample_rate=RATE, speed_of_sound=SPEED)


def images_of(room, source, microphone, *, reach):
    """List distances and reflection products in the form of Allen and Berkley: parity u, period l
    per axis."""
    offsets, gains = [], []
    for axis, length in enumerate(room.size):
        low, high = room.reflection(SPEED)[2 * axis : 2 * axis + 2]
        most = int(reach / (2 * length)) + 2
        u, period = (grid.ravel() for grid in np.meshgrid((0, 1), np.arange(-most, most + 1)))
        offsets.append((1 - 2 * u) * source[axis] + 2 * period * length - microphone[axis])
        gains.append(low ** abs(period - u) * high ** abs(period))
    square = sum(offset**2 for offset in np.meshgrid(*offsets))
    gain = np.prod(np.meshgrid(*gains), axis=0)
    heard = (square <= reach**2) & (gain > 0)
    return np.sqrt(square[heard]), gain[heard]


def closed_form(room, source, microphone, *, frequencies):
    """Sum H(f) = sum g / (4 pi d) exp(-j 2 pi f d / c) over the images heard within T60; f in
    cycles per sample."""
    distance, gain = images_of(room, source, microphone, reach=room.t60 * SPEED)
    phase = np.exp(-2j * np.pi * frequencies[:, None] * distance * RATE / SPEED)
    return phase @ (gain / (4 * np.pi * distance))


def spectrum(response, frequencies):
    return np.exp(-2j * np.pi * frequencies[:, None] * np.arange(response.shape[-1])) @ response


def level_db(error, reference):
    return float(10 * np.log10((np.abs(error) ** 2).sum() / (np.abs(reference) ** 2).sum() + 1e-30))


BAND = np.linspace(0.05, 0.9, 180) / 2


@engines
@pytest.mark.parametrize("walls", [CORNER, ANECHOIC, (0.0, 0.9, 0.8, 0.0, 0.0, 1.0)])
def test_few_images_have_the_spectrum_of_the_closed_form(engine, walls):
    room = Room(SMALL.size, SMALL.t60, walls)
    for microphone, response in zip(MICROPHONES, respond(engine, room), strict=True):
        expected = closed_form(room, SOURCE, microphone, frequencies=BAND)
        allowed = -90.0 if isinstance(engine, Images) else -50.0
        assert level_db(spectrum(response, BAND) - expected, expected) < allowed


@engines
def test_full_room_has_the_spectrum_of_the_closed_form(engine):
    for microphone, response in zip(MICROPHONES, respond(engine, SMALL), strict=True):
        expected = closed_form(SMALL, SOURCE, microphone, frequencies=BAND)
        allowed = -75.0 if isinstance(engine, Images) else -50.0
        assert level_db(spectrum(response, BAND) - expected, expected) < allowed


@pytest.mark.parametrize("walls", [(1.0,) * 6, (1.0, 0.3, 0.9, 0.5, 0.0, 1.0)])
def test_spreading_equals_the_plain_sum_of_delays(walls):
    room = Room(SMALL.size, SMALL.t60, walls)
    response = respond(Images(), room)[0]
    distance, gain = images_of(
        room, SOURCE, MICROPHONES[0], reach=(len(response) + 41) * SPEED / RATE
    )
    delay = distance * RATE / SPEED
    at = np.floor(delay).astype(int)[:, None] + np.arange(-41, 43)
    taps = (gain / (4 * np.pi * distance))[:, None] * fractional_delay(at - delay[:, None])
    plain = np.bincount((at + 100).ravel(), taps.ravel(), minlength=len(response) + 300)[
        100 : 100 + len(response)
    ]
    assert level_db(response - plain, plain) < -95.0
    late = slice(3 * len(plain) // 4, None)
    assert level_db((response - plain)[late], plain[late]) < -80.0, (
        "the quiet end must be as good as the loud start"
    )


def test_engines_agree():
    room = Room((5.0, 4.0, 3.0), 0.3, (1.0, 0.6, 0.8, 1.0, 0.5, 0.9))
    pose = Pose(np.array([2.1, 1.7, 1.4]), 0.4)
    microphones = microphone_positions(circular_array(), pose)
    fast, slow = (
        respond(engine, room, pose.position, microphones) for engine in (Images(), Pyroom())
    )
    assert fast.shape == slow.shape == (6, 6615)
    assert fast.dtype == slow.dtype == np.float64
    quiet = Room(room.size, room.t60, ANECHOIC)
    direct = [respond(engine, quiet, pose.position, microphones) for engine in (Images(), Pyroom())]
    pairs = [(fast, slow), (fast - direct[0], slow - direct[1]), (fast[:, 5000:], slow[:, 5000:])]
    for one, other in pairs:
        error, whole = (np.fft.rfft(x, 8192)[:, : int(0.45 * 8192)] for x in (one - other, other))
        assert level_db(error, whole) < -45.0


@engines
@pytest.mark.parametrize("wall", range(6))
def test_each_wall_has_its_place_and_its_echo_arrives_on_time(engine, wall):
    walls = tuple(0.8 if other == wall else 0.0 for other in range(6))
    room = Room((5.3, 4.6, 3.9), 0.2, walls)
    source, microphone = np.array([2.0, 1.6, 1.5]), np.array([2.6, 2.3, 1.8])
    quiet = Room(room.size, room.t60, ANECHOIC)
    echo = (
        respond(engine, room, source, microphone[None])
        - respond(engine, quiet, source, microphone[None])
    )[0]
    image = source.copy()
    image[wall // 2] = 2 * (wall % 2) * room.size[wall // 2] - source[wall // 2]
    distance = np.linalg.norm(image - microphone)
    frequencies = np.linspace(0.02, 0.4, 400)
    response = spectrum(echo, frequencies)
    delay = -np.polyfit(frequencies, np.unwrap(np.angle(response)), 1)[0] / (2 * np.pi)
    assert delay == pytest.approx(distance * RATE / SPEED, abs=0.01)
    expected = 0.8 * np.sqrt(1 - room.sabine_absorption()) / (4 * np.pi * distance)
    assert np.abs(response).mean() == pytest.approx(expected, rel=2e-3)


@engines
def test_whole_sample_delay_is_one_sample_high(engine):
    step = SPEED / RATE
    room = Room((6.0, 5.0, 4.0), 0.2, ANECHOIC)
    source = np.array([1.0, 2.0, 2.0])
    delays = np.array([13, 60, 250])
    responses = respond(engine, room, source, source + np.outer(delays * step, [1.0, 0.0, 0.0]))
    for delay, response in zip(delays, responses, strict=True):
        expected = np.zeros(len(response))
        expected[delay] = 1 / (4 * np.pi * delay * step)
        assert (
            np.abs(response - expected).max()
            < (1e-4 if isinstance(engine, Images) else 1e-2) * expected.max()
        )


def test_moving_a_microphone_by_whole_samples_shifts_the_response():
    room = Room((30.0, 5.0, 4.0), 0.3, ANECHOIC)
    source = np.array([1.0, 2.0, 2.0])
    distance = np.array([1.2345, 1.2345 + 700 * SPEED / RATE])
    near, far = (
        respond(Images(), room, source, source + np.outer(distance, [1.0, 0.0, 0.0]))
        * distance[:, None]
    )
    assert np.abs(np.roll(near, 700) - far)[700:].max() < 1e-5 * np.abs(near).max()


@engines
def test_swapping_source_and_microphone_changes_nothing(engine):
    room = Room(SMALL.size, SMALL.t60, (1.0, 0.6, 0.8, 1.0, 0.5, 0.9))
    forward, back = respond(engine, room)[0], respond(engine, room, MICROPHONES[0], SOURCE[None])[0]
    assert level_db(forward - back, forward) < (-100.0 if isinstance(engine, Images) else -50.0)


@pytest.mark.parametrize("axis", range(3))
def test_mirroring_the_room_changes_nothing(axis):
    walls = (1.0, 0.6, 0.8, 1.0, 0.5, 0.9)
    flipped = list(walls)
    flipped[2 * axis : 2 * axis + 2] = walls[2 * axis + 1], walls[2 * axis]
    source, microphones = SOURCE.copy(), MICROPHONES.copy()
    source[axis] = SMALL.size[axis] - source[axis]
    microphones[:, axis] = SMALL.size[axis] - microphones[:, axis]
    plain = respond(Images(), Room(SMALL.size, SMALL.t60, walls))
    mirrored = respond(Images(), Room(SMALL.size, SMALL.t60, tuple(flipped)), source, microphones)
    assert level_db(plain - mirrored, plain) < -100.0


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_renaming_the_axes_changes_nothing(order):
    walls = np.array([1.0, 0.6, 0.8, 1.0, 0.5, 0.9])
    turned = Room(
        tuple(np.array(SMALL.size)[list(order)]),
        SMALL.t60,
        tuple(walls.reshape(3, 2)[list(order)].ravel()),
    )
    plain = respond(Images(), Room(SMALL.size, SMALL.t60, tuple(walls)))
    assert (
        level_db(
            plain - respond(Images(), turned, SOURCE[list(order)], MICROPHONES[:, order]), plain
        )
        < -100.0
    )


@engines
def test_without_floor_and_ceiling_the_height_does_not_matter(engine):
    room = Room((10.0, 8.0, 7.0), 0.35, (1.0, 1.0, 1.0, 1.0, 0.0, 0.0))
    source, microphone = np.array([4.0, 3.0, 3.5]), np.array([[4.2, 3.1, 3.5]])
    low, high = (
        respond(engine, room, source + [0, 0, z], microphone + [0, 0, z]) for z in (0.0, 1.7)
    )
    assert level_db(low - high, low) < -50.0


def test_every_image_within_t60_lies_inside_the_complete_order():
    for size, t60 in (((10.0, 8.0, 6.0), 0.4), ((13.0, 11.0, 5.0), 0.4), ((2.0, 9.0, 3.0), 0.3)):
        room = Room(size, t60)
        cells = [np.arange(-n, n + 1) for n in (int(t60 * SPEED / length) + 2 for length in size)]
        nearest = [
            np.maximum(np.abs(cell) - 1, 0) * length
            for cell, length in zip(cells, size, strict=True)
        ]
        heard = sum(d**2 for d in np.meshgrid(*nearest, indexing="ij")) <= (t60 * SPEED) ** 2
        order = sum(np.abs(cell) for cell in np.meshgrid(*cells, indexing="ij"))
        assert order[heard].max() <= complete_order(room, SPEED)
    assert Pyroom(complete=False).order(Room((10.0, 8.0, 6.0), 0.6), SPEED) == 42


@engines
def test_speed_of_sound_and_sample_rate_scale_the_delays(engine):
    room = Room((6.0, 5.0, 4.0), 0.2, ANECHOIC)
    source, microphone = np.array([1.0, 2.0, 2.0]), np.array([[4.43, 2.0, 2.0]])
    for rate, speed in ((22_050.0, 343.0), (16_000.0, 343.0), (22_050.0, 320.0)):
        response = engine(room, source, microphone, sample_rate=rate, speed_of_sound=speed)
        assert response.shape == (1, round(0.2 * rate))
        assert abs(int(response.argmax()) - 3.43 * rate / speed) <= 0.5


@engines
def test_same_input_gives_the_same_bytes(engine):
    first, second = respond(engine, SMALL), respond(engine, SMALL)
    assert first.tobytes() == second.tobytes()
    assert first[1].tobytes() == respond(engine, SMALL, microphones=MICROPHONES[1:])[0].tobytes()


def test_pyroomacoustics_keeps_its_own_settings():
    import pyroomacoustics

    names = ("rir_hpf_enable", "num_threads", "frac_delay_length", "c")
    before = [pyroomacoustics.constants.get(name) for name in names]
    Pyroom()(SMALL, SOURCE, MICROPHONES, sample_rate=RATE, speed_of_sound=350.0)
    assert [pyroomacoustics.constants.get(name) for name in names] == before


@engines
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"source": np.array([5.0, 1.0, 1.0])},
            "source=[5.0, 1.0, 1.0] m: must be inside the 4.2 x 3.1 x 2.6 m room",
        ),
        (
            {"microphones": np.array([[1.0, 1.0, -0.1]])},
            "microphones=[1.0, 1.0, -0.1] m: must be inside",
        ),
        ({"microphones": SOURCE[None]}, "microphones=0 m from the source"),
        ({"microphones": SOURCE}, "microphones=(3,): must have shape (M, 3)"),
        ({"source": SOURCE[:2]}, "source=(2,): must have shape (3,)"),
        ({"sample_rate": 10.0}, "sample_rate=10.0 Hz"),
        ({"speed_of_sound": -1.0}, "speed_of_sound=-1.0 m/s"),
        (
            {
                "room": Room((0.6, 0.6, 0.6), 2.0),
                "source": np.full(3, 0.2),
                "microphones": np.full((1, 3), 0.4),
            },
            "room.t60=2 s",
        ),
    ],
)
def test_bad_calls_name_the_value(engine, change, message):
    call = {
        "room": SMALL,
        "source": SOURCE,
        "microphones": MICROPHONES,
        "sample_rate": RATE,
        "speed_of_sound": SPEED,
    }
    call |= change
    with pytest.raises(BadValue) as error:
        engine(call.pop("room"), call.pop("source"), call.pop("microphones"), **call)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_pyroom_needs_a_whole_sample_rate_and_a_bool():
    with pytest.raises(BadValue, match="whole number"):
        Pyroom()(SMALL, SOURCE, MICROPHONES, sample_rate=22050.5, speed_of_sound=SPEED)
    with pytest.raises(BadValue, match=r"rir\.complete=perhaps"):
        Pyroom(complete="perhaps")


def test_loops_compile_anew_where_no_folder_can_keep_them(tmp_path):
    """As in a container whose disk is read-only and whose user has no home."""
    copy = tmp_path / "loops.py"
    copy.write_bytes(Path(image_loops.__file__).read_bytes())
    (tmp_path / "__pycache__").write_text("not a folder")
    homeless = {**os.environ, "HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import loops"
    subprocess.run([sys.executable, "-c", code], env=homeless, check=True)
