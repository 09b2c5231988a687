"""What is not ideal: each departure alone against its closed form, none of them against clean."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import signal

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.signals import noise_probe, power
from echolearn.acoustics.types import Pose, Room
from echolearn.dataset.plans import ScatteredPlan
from echolearn.dataset.records import records
from echolearn.localization.methods.gated import Gated
from echolearn.simulation import fir_loops
from echolearn.simulation.arrivals import SoundPaths
from echolearn.simulation.fir_loops import filtered_signals
from echolearn.simulation.image_loops import fractional_delay
from echolearn.simulation.imperfect_scene import ImperfectScene, realistic
from echolearn.simulation.kernels import clusters, low_band, low_pass, minimum_phase
from echolearn.simulation.noise.coloured import Coloured
from echolearn.simulation.noise.white import White
from echolearn.simulation.realism import BOUNDS, Realism
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.simulation.ways import free_path, ways_out
from echolearn.storage.identity import plain
from interpreted import LANES, interpret
from refusals import refused

RATE = 22050.0
SPEED = 343.0
SCENE = Scene(circular_array(), noise_probe(length=8000), Images(), White())
CLICK = replace(SCENE, probe=replace(SCENE.probe, samples=np.eye(1, 16)[0]))
"""A robot whose burst is a single sample, so that what it records is a response."""

ROOM = Room((6.0, 5.0, 4.0), 0.2)
ONE_WALL = replace(ROOM, walls=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
POSE = Pose(np.array([1.3, 2.2, 1.4]), 0.7)


def drawn(realism, scene=SCENE, seed=0, **changes):
    """Return a scene with one draw of some ranges; `changes` are put in its place."""
    flaws = realism.draw(scene, np.random.default_rng(seed))
    flaws = replace(flaws, **changes)
    own = {field.name: getattr(scene, field.name) for field in fields(scene)}
    return ImperfectScene(**own, imperfections=flaws)


def echo(scene, room=ONE_WALL):
    """Return what is recorded without its direct path, shape (M, N)."""
    return scene.received(room, POSE) - scene.direct


def fixed(**values):
    """Return ranges of one value each."""
    return Realism(**{name: (value, value) for name, value in values.items()})


def test_no_departure_is_clean():
    ideal = SCENE.received(ROOM, POSE)
    made = drawn(Realism())
    assert np.abs(made.received(ROOM, POSE) - ideal).max() < 1e-12 * np.abs(ideal).max()
    # The engine sums in float32; what is subtracted is exact.
    assert np.abs(made.direct - SCENE.direct).max() < 2e-5 * np.abs(ideal).max()
    assert realistic(SCENE, Realism(), rng=np.random.default_rng(0)) == (SCENE, {})


@pytest.mark.parametrize("scattering", [0.0, 0.3, 1.0])
def test_a_rough_wall_keeps_the_energy_and_spreads_its_share(scattering):
    taps = clusters(50, spread=22.0, scattering=scattering, rng=np.random.default_rng(1))
    assert taps.shape == (50, 23)
    assert np.allclose(np.sum(taps**2, axis=1), 1.0)
    assert np.allclose(taps[:, 0] ** 2, 1.0 - scattering)


def test_an_echo_is_spread_after_its_time_and_no_longer_than_asked():
    sharp = echo(CLICK)
    rough = echo(drawn(fixed(spread=0.001, scattering=0.6), CLICK))
    start = np.argmax(np.abs(sharp[0]))
    assert np.argmax(np.abs(rough[0])) >= start
    # All energy is where the plain echo is, or within the spread after it.
    outside = np.r_[rough[0, : start - 41], rough[0, start + 41 + 23 :]]
    assert np.abs(outside).max() < 1e-3 * np.abs(rough[0]).max()
    flat = power(echo(drawn(fixed(spread=0.001, scattering=0.6)))) / power(echo(SCENE))
    assert np.allclose(10 * np.log10(flat), 0.0, atol=3.0)


def test_a_reflection_takes_as_much_of_the_highs_as_asked():
    made = drawn(fixed(absorption_db=6.0), CLICK, dulling=np.full(6, 10 ** (-6.0 / 20)))
    ratio = np.abs(np.fft.rfft(echo(made)[0]) / np.fft.rfft(echo(CLICK)[0]))
    frequencies = np.fft.rfftfreq(8000, 1 / RATE)
    level = 20 * np.log10(ratio[[np.argmin(np.abs(frequencies - f)) for f in (200.0, 8000.0)]])
    assert level == pytest.approx([0.0, -6.0], abs=0.15)


def test_highs_of_the_tail_decay_faster():
    room = Room((6.0, 5.0, 4.0), 0.4)
    made = drawn(fixed(absorption_db=2.0), CLICK, dulling=np.full(6, 10 ** (-2.0 / 20)))
    highpass = signal.butter(8, 7000.0, "high", fs=RATE, output="sos")
    before, after = (signal.sosfilt(highpass, echo(s, room)[0]) for s in (CLICK, made))
    free_path = 4 * 120.0 / (2 * 74.0)
    for middle in (1000, 2000, 3000):
        part = slice(middle - 200, middle + 200)
        lost = 10 * np.log10(power(before[part]) / power(after[part]))
        assert lost == pytest.approx(2.0 * middle / RATE * SPEED / free_path, rel=0.1)


def test_a_sphere_scatters_what_its_closed_form_says():
    silent = replace(ROOM, walls=(0.0,) * 6)
    toward = np.array([[0.0, 0.6, 0.8]])
    made = drawn(
        fixed(scatterers=1.0, scatterer_radius=0.1),
        CLICK,
        scatterers=toward,
        ways=np.array([0.5]),
    )
    found = echo(made, silent)
    # Its place in the room: the heading turns the direction, half of the way to a wall.
    turned = np.array([-0.6 * np.sin(0.7), 0.6 * np.cos(0.7), 0.8])
    walls = np.where(turned > 0, np.array(ROOM.size) - POSE.position, -POSE.position)
    place = 0.5 * np.min(walls / turned) * turned
    for m, microphone in enumerate(SCENE.array.positions):
        cos, sin = np.cos(0.7), np.sin(0.7)
        there = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ microphone
        first, second = np.linalg.norm(place), np.linalg.norm(place - there)
        late = (first + second) / SPEED * RATE
        assert np.argmax(found[m]) == pytest.approx(late, abs=0.51)
        # A band-limited pulse of height g has the sum g.
        assert found[m].sum() == pytest.approx(0.05 / (4 * np.pi * first * second), rel=0.01)


def test_microphones_are_as_unequal_as_asked():
    wide = Scene(circular_array(microphones=200), SCENE.probe, Images(), White())
    flaws = fixed(microphone_db=1.5, microphone_offset=0.003).draw(wide, np.random.default_rng(3))
    levels = 20 * np.log10(np.linalg.norm(flaws.microphones, axis=1))
    assert np.std(levels) == pytest.approx(1.5, rel=0.2)
    assert np.std(flaws.offsets) == pytest.approx(0.003, rel=0.1)
    gains = 10.0 ** (np.arange(6) / 20.0)
    made = drawn(Realism(), microphones=gains[:, None])
    ratio = power(made.received(ROOM, POSE)) / power(SCENE.received(ROOM, POSE))
    assert 10 * np.log10(ratio) == pytest.approx(np.arange(6.0), abs=1e-6)


def test_a_microphone_that_is_elsewhere_hears_the_echo_there():
    offsets = np.zeros((6, 3))
    offsets[2] = [0.015, 0.0, 0.0]
    made = echo(drawn(Realism(), CLICK, offsets=offsets))
    assert np.allclose(np.delete(made, 2, axis=0), np.delete(echo(CLICK), 2, axis=0), atol=1e-5)
    assert np.abs(made[2] - echo(CLICK)[2]).max() > 1e-4


def test_a_response_has_the_level_that_is_asked_for_and_the_least_delay():
    flaws = fixed(loudspeaker_low=300.0, loudspeaker_high=5000.0).draw(
        SCENE, np.random.default_rng(0)
    )
    frequencies = np.array([300.0, 1200.0, 5000.0])
    _, response = signal.freqz(flaws.loudspeaker, worN=frequencies, fs=RATE)
    level = 20 * np.log10(np.abs(response))
    assert level - level[1] == pytest.approx([-3.0, 0.0, -3.0], abs=0.2)
    # A filter whose zeros lie within the unit circle has the least delay of all of its magnitude.
    zeros = [0.9, -0.5, 0.6 + 0.6j, 0.6 - 0.6j]
    least = np.poly(zeros).real
    found = minimum_phase(20 * np.log10(np.abs(np.fft.rfft(least, 512))))
    assert np.allclose(found, np.pad(least, (0, 251)), atol=1e-6)


def test_the_loudspeakers_delay_is_taken_off_and_latency_is_not():
    realism = fixed(loudspeaker_low=200.0, loudspeaker_high=5000.0, loudspeaker_ripple_db=3.0)
    plain = np.argmax(np.abs(echo(CLICK)[0]))
    for seed in range(4):
        assert abs(np.argmax(np.abs(echo(drawn(realism, CLICK, seed))[0])) - plain) <= 1
    late = drawn(fixed(latency_samples=7.0)).received(ROOM, POSE)
    assert np.allclose(late[:, 7:], SCENE.received(ROOM, POSE)[:, :-7], atol=1e-12)
    early = drawn(fixed(latency_samples=-7.0)).received(ROOM, POSE)
    assert np.allclose(early[:, :-7], SCENE.received(ROOM, POSE)[:, 7:], atol=1e-12)


def test_a_measured_loudspeaker_is_taken_as_it_is_but_for_its_delay():
    response = np.zeros(300)
    response[200:203] = [0.5, 1.0, -0.4]
    realism = Realism(loudspeaker=replace(SCENE.probe, samples=response))
    assert not realism.clean
    heard = echo(drawn(realism, CLICK))
    taps = np.array([0.5, 1.0, -0.4]) / np.linalg.norm([0.5, 1.0, -0.4])
    plain = echo(CLICK)
    expected = sum(tap * np.roll(plain, k - 1, axis=1) for k, tap in enumerate(taps))
    assert np.abs(heard - expected).max() < 1e-5
    with refused("realism.loudspeaker=16000 Hz: must have the probe's rate, 22050 Hz"):
        other = replace(SCENE.probe, samples=response, sample_rate=16000.0)
        replace(PLAN, realism=Realism(loudspeaker=other))


def test_a_loudspeaker_sends_fewer_highs_behind_itself():
    toward_wall = np.array([-np.cos(0.7), np.sin(0.7), 0.0])
    for facing, share in ((toward_wall, 1.0), (-toward_wall, 0.2)):
        made = drawn(fixed(directivity=0.8), CLICK, facing=facing)
        ratio = np.abs(np.fft.rfft(echo(made)[0]) / np.fft.rfft(echo(CLICK)[0]))
        frequencies = np.fft.rfftfreq(8000, 1 / RATE)
        assert ratio[np.argmin(np.abs(frequencies - 150.0))] == pytest.approx(1.0, abs=0.02)
        assert ratio[np.argmin(np.abs(frequencies - 8500.0))] == pytest.approx(share, abs=0.03)


def test_the_direct_path_is_left_at_the_level_that_is_asked_for():
    silent = replace(ROOM, walls=(0.0,) * 6)
    made = drawn(fixed(residual=0.03))
    left = echo(made, silent)
    assert 10 * np.log10(power(left) / power(SCENE.direct)) == pytest.approx(
        20 * np.log10(0.03), abs=0.01
    )


@pytest.mark.parametrize(("share", "corner"), [(0.0, 200.0), (0.5, 200.0), (0.9, 1000.0), (1, 50)])
def test_coloured_noise_has_the_power_and_the_density_that_is_asked_for(share, corner):
    array = circular_array(microphones=40)
    noise = Coloured(share, corner)(
        array, length=20000, sample_rate=RATE, rng=np.random.default_rng(0)
    )
    assert power(noise).mean() == pytest.approx(1.0, rel=0.05)
    assert np.mean(noise[:, :20] ** 2) == pytest.approx(1.0, abs=0.7)
    frequencies, density = signal.welch(noise, fs=RATE, nperseg=4096)
    a = np.exp(-2 * np.pi * corner / RATE)
    falling = (1 - a**2) / np.abs(1 - a * np.exp(-2j * np.pi * frequencies / RATE)) ** 2
    asked = (1 - share) + share * falling
    found = density.mean(axis=0) * RATE / 2
    assert np.median(np.abs(10 * np.log10(found / asked))) < 0.2


def test_coloured_noise_without_colour_is_white():
    draw = {"length": 300, "sample_rate": RATE}
    white = White()(SCENE.array, **draw, rng=np.random.default_rng(5))
    assert np.allclose(Coloured(0.0)(SCENE.array, **draw, rng=np.random.default_rng(5)), white)


def test_the_low_pass_is_half_way_down_at_the_crossover():
    for rate in (16000.0, 22050.0, 48000.0):
        _, response = signal.freqz(low_pass(rate), worN=[0.0, 3000.0], fs=rate)
        assert np.abs(response) == pytest.approx([1.0, 0.5], abs=0.01)


@pytest.mark.parametrize("walls", [(), (1.0, 0.5, 1.0, 0.0, 1.0, 1.0, 0.7)])
def test_rooms_of_any_outline_are_taken_apart_and_put_together_again(walls):
    """With clusters of one tap each and no other departure, what is put back is what was there."""
    corners = ((0.0, 0.0), (6.0, 0.0), (6.5, 4.0), (2.0, 5.0), (0.0, 4.0))
    room = PolygonRoom(corners, 3.0, 0.2, walls=walls, doors=((0, 3.0, 4.0),))
    pose = Pose(np.array([2.0, 1.6, 1.3]), 0.3)
    ideal = SCENE.received(room, pose)
    assert np.abs(drawn(Realism()).received(room, pose) - ideal).max() < 1e-12 * ideal.max()
    # Without their walls' first echoes, what is left of a response is what is reflected twice.
    single = drawn(Realism(), CLICK, clusters=np.repeat([[1.0], [0.0]], [6, 1], axis=0))
    early = int((2 * 1.3 + 0.4) / SPEED * RATE)
    both = single.received(room, pose)[:, :early], CLICK.received(room, pose)[:, :early]
    assert np.abs(both[0] - both[1]).max() < 2e-4 * np.abs(both[1]).max()


def test_arrivals_are_what_a_loop_over_them_makes():
    rng = np.random.default_rng(7)
    shape = (4, 3)
    delay = rng.uniform(60.0, 240.0, shape)
    # Of the first the beginning is before the response's, of the last the end is beyond its end.
    delay[0], delay[3] = 12.3, 290.7
    gain, highs = rng.uniform(0.1, 1.0, (2, *shape))
    shapes, microphones = rng.standard_normal((4, 9)), rng.standard_normal((3, 16))
    paths = SoundPaths(delay=delay, gain=gain, highs=highs, clusters=shapes)

    size, margin, steps = 160, 24, 512
    low = low_band(np.fft.rfftfreq(size, 1.0 / RATE))
    plain, changed = np.zeros((2, 3, 2000))
    for p, m in np.ndindex(shape):
        whole, part = divmod(delay[p, m], 1.0)
        row, rest = divmod(part * steps, 1.0)
        before, after = (fractional_delay(np.arange(-39, 41) - (row + k) / steps) for k in (0, 1))
        taps = gain[p, m] * ((1.0 - rest) * before + rest * after)
        first = int(whole) - 39 + 500
        plain[m, first : first + 80] += taps
        spectrum = np.fft.rfft(taps, size) * (low + highs[p, m] * (1.0 - low))
        for own in (shapes[p], microphones[m]):
            spectrum *= np.fft.rfft(own, size)
        late = np.roll(np.fft.irfft(spectrum, size), margin)
        changed[m, first - margin : first - margin + size] += late
    plain, changed = plain[:, 500:800], changed[:, 500:800]

    found, taken = np.zeros((2, 3, 300))
    paths.add(found, microphones=microphones, sample_rate=RATE)
    paths.subtract(taken)
    assert np.abs(found - changed).max() < 1e-12
    assert np.abs(taken + plain).max() < 1e-12


def assert_filters_are_convolutions(taps, *, length, low):
    rng = np.random.default_rng(taps)
    sounds, own = rng.standard_normal((2, length)), rng.standard_normal((2, taps))
    share = rng.uniform(size=length)
    found = filtered_signals(sounds, own, low=low, share=share)
    for m in range(2):
        slow = np.convolve(sounds[m], low, mode="same")
        kept = slow + share * (sounds[m] - slow)
        assert np.abs(found[m] - np.convolve(kept, own[m])[:length]).max() < 1e-12


@pytest.mark.parametrize("taps", [1, 8, 39])
def test_compiled_filters_are_convolutions(taps):
    assert_filters_are_convolutions(taps, length=700, low=low_pass(RATE))


def test_as_python_the_loops_filter_add_and_take_away(monkeypatch):
    interpret(fir_loops, monkeypatch, BLOCK=8, wide=LANES["wide"])
    assert_filters_are_convolutions(11, length=21, low=np.array([0.25, 0.5, 0.25]))

    # Two arrivals, of which the first begins before the response and the second ends after it.
    first, taps = np.array([[-1], [3]]), np.array([[[1.0, 2.0, 3.0]], [[4.0, 5.0, 6.0]]])
    response = np.zeros((1, 5))
    fir_loops.add(response, first, taps=taps)
    assert response.tolist() == [[2.0, 3.0, 0.0, 4.0, 5.0]]
    fir_loops.add(response, first, taps=taps, ahead=1)
    assert response.tolist() == [[4.0, 3.0, 6.0, 8.0, 10.0]]

    table = np.array([[1.0, 0.0], [0.0, 1.0], [5.0, 5.0]])
    row, gain = np.array([[0.25], [1.0]]), np.array([[4.0], [2.0]])
    response = np.zeros((1, 5))
    fir_loops.subtract_pulses(response, first, table=table, place=row, gain=gain)
    assert response.tolist() == [[-1.0, 0.0, 0.0, 0.0, -2.0]]
    found = fir_loops.changed_spectra(
        table,
        row,
        gain=gain,
        low=np.array([0.5, 1.0]),
        highs=np.array([[0.5], [0.0]]),
        clusters=np.array([[1.0, 2.0], [3.0, 1.0]]),
        microphones=np.array([[2.0, 1.0]]),
    )
    # For instance gain 4, pulse 0.75, share 0.5 + 0.5 * 0.5, cluster 1, microphone 2.
    assert found.tolist() == [[[4.5, 2.0]], [[0.0, 2.0]]]


def test_ways_out_of_a_box_and_of_its_outline_are_the_same():
    toward = np.random.default_rng(2).standard_normal((40, 3))
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    place = np.array([1.0, 2.0, 1.5])
    walls = np.where(toward > 0, np.array([6.0, 5.0, 3.0]) - place, -place)
    expected = np.min(walls / toward, axis=1)
    corners = ((0.0, 0.0), (6.0, 0.0), (6.0, 5.0), (0.0, 5.0))
    for room in (Room((6.0, 5.0, 3.0), 0.3), PolygonRoom(corners, 3.0, 0.3)):
        assert np.allclose(ways_out(room, place, toward=toward), expected)
        assert free_path(room) == pytest.approx(4 * 90.0 / (2 * (30.0 + 33.0)))


# ---------------------------------------------------------------- one draw for each row

EVERYTHING = Realism(**{name: (0.0, min(high, 3.0)) for name, (_, high, *_) in BOUNDS.items()})
WINDOW = SearchWindow()
PLAN = ScatteredPlan(
    name="small",
    seed=4,
    rows=6,
    size_low=(5.0, 5.0, 3.0),
    size_high=(7.0, 6.0, 4.0),
    t60=(0.2, 0.3),
    margin=1.0,
    window=WINDOW,
    scene=SCENE,
    localizer=Gated(WINDOW),
    gain_db=(-1.0, 1.0),
)
REAL = replace(PLAN, realism=EVERYTHING)


def test_a_row_depends_on_its_number_and_the_seed_alone():
    together = records(REAL, range(4))
    alone = [records(REAL, range(row, row + 1)) for row in (3, 0)]
    # How many rows are localized at a time changes the rounding, so shards are made whole.
    for name in together.dtype.names or ():
        assert np.allclose(together[name][[3, 0]], [found[name][0] for found in alone]), name
    other = records(replace(REAL, seed=5), range(1))
    assert other["spread"] != together["spread"][0]


def test_what_was_drawn_stands_beside_the_old_columns_and_is_within_its_range():
    clean = records(PLAN, range(4))
    real = records(REAL, range(4))
    names = set(real.dtype.names or ()) - set(clean.dtype.names or ())
    assert names == BOUNDS.keys() - {"gain_db"}
    for name in names:
        low, high = getattr(EVERYTHING, name)
        assert ((real[name] >= low) & (real[name] <= high)).all(), name
    # Where the robot stands, and how loud the noise is, is what it was.
    for name in ("room", "position", "heading", "snr_db", "t60", "truth_toa"):
        assert np.array_equal(clean[name], real[name]), name
    assert (np.abs(real["gain_db"] - clean["gain_db"]) <= 3.0).all()


def test_a_clean_plan_keeps_its_identity():
    assert "realism" not in plain(PLAN)
    assert plain(replace(PLAN, realism=Realism(spread=[0.0, 0.0]))) == plain(PLAN)
    assert plain(REAL)["realism"]["spread"] == [0.0, 0.01]


def test_no_draw_depends_on_the_range_of_another():
    def draw(**ranges):
        return replace(EVERYTHING, **ranges).draw(SCENE, np.random.default_rng(1))

    few, many = draw(scatterers=(0.0, 0.0)), draw(scatterers=(9.0, 9.0), spread=(0.0, 0.0))
    assert np.array_equal(few.facing, many.facing)
    assert np.array_equal(few.microphones, many.microphones)
    assert np.array_equal(few.loudspeaker, many.loudspeaker)
    assert np.array_equal(few.dulling, many.dulling)
    assert few.drawn["directivity"] == many.drawn["directivity"]


def test_a_robot_stays_the_same_from_pose_to_pose():
    def pose(index):
        here = np.random.default_rng([7, index])
        return EVERYTHING.draw(SCENE, here, robot=np.random.default_rng(7))

    first, second = pose(1), pose(2)
    assert np.array_equal(first.microphones, second.microphones)
    assert np.array_equal(first.loudspeaker, second.loudspeaker)
    assert first.drawn == second.drawn
    assert not np.array_equal(first.clusters, second.clusters)


def test_the_level_of_the_noise_is_the_one_that_is_asked_for():
    quiet = records(replace(REAL, snr_db=(40.0, 40.0), realism=fixed(coloured=0.9)), range(3))
    assert (quiet["snr_db"] == 40.0).all()


@pytest.mark.parametrize(
    ("said", "ranges"),
    [
        ("realism.spread=0.5 s: must be a number from 0 to 0.01 s", {"spread": (0.0, 0.5)}),
        ("realism.scattering=[0.7, 0.1]", {"scattering": (0.7, 0.1)}),
        ("realism.directivity=0.5: must be two numbers", {"directivity": 0.5}),
        ("realism.suffix=3: must be the end of a name", {"suffix": 3}),
    ],
)
def test_bad_ranges_are_refused_in_one_line(said, ranges):
    with refused(said):
        Realism(**ranges)


def test_only_white_noise_is_coloured():
    with refused("realism.coloured=[0.1, 0.5]: must be [0, 0] where the sensor noise is not"):
        replace(
            PLAN,
            realism=Realism(coloured=(0.1, 0.5)),
            scene=replace(SCENE, noise=Coloured()),
        )
