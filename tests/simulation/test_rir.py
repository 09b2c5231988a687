"""Both engines against closed forms, against each other, and against the laws of a shoebox."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyroomacoustics
import pytest

from echolearn.acoustics.types import Room
from echolearn.simulation import image_loops, torch_device
from echolearn.simulation.image_loops import fractional_delay
from echolearn.simulation.rir import torch_images
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom, complete_order
from echolearn.simulation.rir.torch_images import TorchImages
from interpreted import LANES, add_row, interpret, place_row
from reference import RATE, SPEED
from refusals import refused

SIZE = (4.2, 3.1, 2.6)
SOURCE = np.array([1.13, 0.94, 1.27])
MICROPHONES = np.array([[2.91, 2.02, 0.81], [3.07, 1.18, 1.69]])
LIVE = (1.0,) * 6
ANECHOIC = (0.0,) * 6
BAND = np.linspace(0.05, 0.9, 180) / 2
ENGINES = {"images": Images(), "pyroom": Pyroom(), "torch": TorchImages("cpu")}
engines = pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)


def small(*walls):
    return Room(SIZE, 0.16, walls)


def respond(engine, room, source=SOURCE, microphones=MICROPHONES, **given):
    call = {"sample_rate": RATE, "speed_of_sound": SPEED} | given
    return engine(room, source, microphones=microphones, **call)


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
    square = np.square(np.meshgrid(*offsets)).sum(axis=0)
    gain = np.prod(np.meshgrid(*gains), axis=0)
    within = (square <= reach**2) & (gain > 0)
    return np.sqrt(square[within]), gain[within]


def closed_form(room, source, microphone, *, frequencies):
    """Sum H(f) = sum g / (4 pi d) exp(-j 2 pi f d / c) over the images heard within T60; f in
    cycles per sample."""
    distance, gain = images_of(room, source, microphone, reach=room.t60 * SPEED)
    phase = np.exp(-2j * np.pi * frequencies[:, None] * distance * RATE / SPEED)
    return phase @ (gain / (4 * np.pi * distance))


def spectrum(response, frequencies):
    return np.exp(-2j * np.pi * frequencies[:, None] * np.arange(response.shape[-1])) @ response


def assert_close(found, expected, level_db):
    """Fail unless the error's energy is `level_db` below that of the whole."""
    error = np.sum(np.abs(found - expected) ** 2) / np.sum(np.abs(expected) ** 2)
    assert 10 * np.log10(error + 1e-30) < level_db


@engines
@pytest.mark.parametrize(
    "walls",
    [
        (1.0, 0.0, 0.0, 1.0, 0.7, 0.0),
        ANECHOIC,
        (0.0, 0.9, 0.8, 0.0, 0.0, 1.0),
        (1.0, 1.0, 1.0, 1.0, 0.0, 0.0),
        LIVE,
    ],
)
def test_responses_have_the_spectrum_of_the_closed_form(engine, walls):
    allowed = -50.0 if isinstance(engine, Pyroom) else -75.0 if sum(walls) > 3 else -90.0
    room = small(*walls)
    for microphone, response in zip(MICROPHONES, respond(engine, room), strict=True):
        expected = closed_form(room, SOURCE, microphone, frequencies=BAND)
        assert_close(spectrum(response, BAND), expected, allowed)


@pytest.mark.parametrize("walls", [LIVE, (1.0, 0.3, 0.9, 0.5, 0.0, 1.0)])
def test_spreading_equals_the_plain_sum_of_delays(walls):
    """The quiet end is as good as the loud start; whatever axis or wall is which."""
    room = small(*walls)
    response = respond(Images(), room)[0]
    reach = (len(response) + 41) * SPEED / RATE
    distance, gain = images_of(room, SOURCE, MICROPHONES[0], reach=reach)
    delay = distance * RATE / SPEED
    at = np.floor(delay).astype(int)[:, None] + np.arange(-41, 43)
    taps = (gain / (4 * np.pi * distance))[:, None] * fractional_delay(at - delay[:, None])
    plain = np.bincount((at + 100).ravel(), taps.ravel())[100 : 100 + len(response)]
    assert_close(response, plain, -95.0)
    late = slice(3 * len(plain) // 4, None)
    assert_close(response[late], plain[late], -80.0)


@pytest.mark.parametrize(
    ("size", "t60"), [((10.0, 8.0, 6.0), 0.4), ((13.0, 11.0, 5.0), 0.4), ((2.0, 9.0, 3.0), 0.3)]
)
def test_every_image_within_t60_lies_inside_the_complete_order(size, t60):
    cells = [np.arange(-n, n + 1) for n in (int(t60 * SPEED / length) + 2 for length in size)]
    order = [np.abs(cell) for cell in np.meshgrid(*cells, indexing="ij")]
    square = sum(
        (np.maximum(n - 1, 0) * length) ** 2 for n, length in zip(order, size, strict=True)
    )
    within = square <= (t60 * SPEED) ** 2
    assert sum(order)[within].max() <= complete_order(Room(size, t60), SPEED)


def test_as_python_the_loops_sum_the_images_within_reach(monkeypatch):
    """Two images along each of two axes and three along the last, in 70 samples."""
    written = {"_add_row": add_row, "_place_row": place_row, "wide": LANES["wide"]}
    interpret(image_loops, monkeypatch, **written)
    lengths = ((20.3, 61.7), (3.1, 44.9), (5.2, 30.6, 99.0))
    gains = ((1.0, 0.8), (0.9, 0.7), (1.0, 0.5, 0.6))
    axes = tuple(
        np.array([[np.square(each), gain]]) for each, gain in zip(lengths, gains, strict=True)
    )
    [response] = image_loops.responses(axes, 70, reach=85.0)
    expected = np.zeros(70)
    counted = 0
    for i, j, k in np.ndindex(2, 2, 3):
        distance = np.sqrt(lengths[0][i] ** 2 + lengths[1][j] ** 2 + lengths[2][k] ** 2)
        if distance <= 85.0:
            gain = gains[0][i] * gains[1][j] * gains[2][k]
            expected += gain / distance * fractional_delay(np.arange(70) - distance / 2)
            counted += 1
    assert counted == 8
    assert_close(response, expected, -95.0)


def test_the_incomplete_order_is_that_of_the_longest_side():
    assert Pyroom(complete=False).order(Room((10.0, 8.0, 6.0), 0.6), SPEED) == 42


@engines
@pytest.mark.parametrize(("rate", "speed"), [(RATE, SPEED), (16_000.0, SPEED), (RATE, 320.0)])
def test_speed_of_sound_and_sample_rate_scale_the_delays(engine, rate, speed):
    room = Room((6.0, 5.0, 4.0), 0.2, ANECHOIC)
    places = np.array([[1.0, 2.0, 2.0], [4.43, 2.0, 2.0]])
    given = {"sample_rate": rate, "speed_of_sound": speed}
    response = respond(engine, room, places[0], places[1:], **given)
    assert response.shape == (1, round(0.2 * rate))
    assert abs(int(response.argmax()) - 3.43 * rate / speed) <= 0.5


@engines
def test_same_input_gives_the_same_bytes(engine):
    """Whatever other microphones there are."""
    first, second = respond(engine, small(*LIVE)), respond(engine, small(*LIVE))
    assert first.tobytes() == second.tobytes()
    [alone] = respond(engine, small(*LIVE), microphones=MICROPHONES[1:])
    assert first[1].tobytes() == alone.tobytes()


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_torch_sums_the_same_images_to_the_same_bytes_each_time(device, monkeypatch):
    if device == "cuda" and not torch_device.cuda_is_there():
        pytest.skip("not on this machine")
    room = Room((5.0, 4.0, 3.0), 0.4)
    whole = respond(TorchImages(device), room)
    assert_close(whole, respond(Images(), room), -130.0)
    # However many are computed at a time, and in whatever order a device adds them.
    monkeypatch.setattr(torch_images, "BLOCK", 3000)
    assert respond(TorchImages(device), room).tobytes() == whole.tobytes()
    assert_close(respond(TorchImages("cpu"), room), whole, -200.0)


def test_a_device_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setattr(torch_device, "cuda_is_there", lambda: False)
    with refused("rir.device=cuda: must be on this machine"):
        respond(TorchImages(), small(*LIVE))


def test_pyroomacoustics_keeps_its_own_settings():
    names = ("rir_hpf_enable", "num_threads", "frac_delay_length", "c")
    before = [pyroomacoustics.constants.get(name) for name in names]
    respond(Pyroom(), small(*LIVE), speed_of_sound=350.0)
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
    with refused(message):
        respond(engine, **{"room": small(*LIVE)} | change)


def test_pyroom_needs_a_whole_sample_rate_and_a_bool():
    with refused("sample_rate=22050.5 Hz: must be a whole number"):
        respond(Pyroom(), small(*LIVE), sample_rate=22050.5)
    with refused("rir.complete=perhaps"):
        Pyroom(complete="perhaps")


def test_loops_compile_anew_where_no_folder_can_keep_them(tmp_path):
    """As in a container whose disk is read-only and whose user has no home."""
    copy = tmp_path / "loops.py"
    copy.write_bytes(Path(image_loops.__file__).read_bytes())
    (tmp_path / "__pycache__").write_text("not a folder")
    homeless = {**os.environ, "HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import loops"
    subprocess.run([sys.executable, "-c", code], env=homeless, check=True)
