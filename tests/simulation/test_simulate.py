"""What the robot records, against single images, measured noise and the paper's SNR."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp

import reference
from echolearn.acoustics import signals
from echolearn.acoustics.types import Pose
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import add_noise, noise_alone, observe
from reference import RATE
from refusals import refused
from sounds import draw

POSE = Pose(np.array([1.3, 2.2, 1.4]), 0.7)
FIELD = Diffuse(Rotor())


def noisy(received, scene, *levels, seed=0, pings=1, **changes):
    """Return the probe as received, with noise and without its direct path; `seed` may be a
    generator."""
    rng = np.random.default_rng(seed)
    return add_noise(received, scene, levels=NoiseLevels(*levels, pings=pings), rng=rng, **changes)


def looked(room, scene, snr_db, *, pose=POSE, seed=0):
    """Return an observation and its truth."""
    rng = np.random.default_rng(seed)
    return observe(room, pose, scene=scene, levels=NoiseLevels(snr_db), rng=rng)


def ratio_db(received, noise):
    """Return the ratio of power at each microphone, shape (M,)."""
    return 10 * np.log10(signals.power(received) / signals.power(noise))


def echoes(scene, image, strength, places):
    """Return what microphones at `places` (M, 3) record of one image, shape (M, N)."""
    probe = scene.probe
    given = {"strength": strength, "rate": RATE, "length": probe.length}
    return np.array([reference.echo(probe.samples, image, place, **given) for place in places])


@pytest.fixture(scope="module")
def received(brief, chamber):
    """Return the probe as received in the chamber; not to be changed."""
    return brief.received(chamber, POSE)


@pytest.fixture(scope="module")
def hovering(brief):
    """Return the robot with rotors around it."""
    return replace(brief, diffuse=FIELD)


def test_the_direct_path_is_one_over_four_pi_r_and_r_over_c_late(brief):
    """The engine's filter is not flat up to the Nyquist frequency: 3 % of a white burst's energy.

    At twice the speed of sound the delay is half of 12.86 samples.
    """
    expected = echoes(brief, np.zeros(3), 1.0, brief.array.positions)
    assert np.sum((brief.direct - expected) ** 2) < 0.03 * np.sum(expected**2)
    for speed, delay in ((343.0, 13), (686.0, 6)):
        direct = replace(brief, speed_of_sound=speed).direct
        peak = signals.matched_filter(direct, brief.probe, first=0, last=40).argmax(axis=-1)
        assert peak.tolist() == [delay] * 6


@pytest.mark.parametrize("wall", range(6))
def test_one_wall_makes_one_echo(brief, chamber, wall):
    alone = replace(chamber, walls=tuple(0.8 * (index == wall) for index in range(6)))
    image = reference.images(chamber.size, POSE.position)[wall]
    places = reference.microphones(brief.array.positions, POSE.position, POSE.heading)
    expected = echoes(brief, image, 0.8 * np.sqrt(1 - chamber.sabine_absorption()), places)
    error = brief.received(alone, POSE) - brief.direct - expected
    assert np.sum(error**2) < 0.03 * np.sum(expected**2)


@pytest.mark.parametrize("snr_db", [-20.0, 0.0, 17.5])
def test_measured_snr_is_asked_snr_at_every_microphone(brief, received, snr_db):
    """The ratio counts the direct path, though it is then removed; 0.2 dB is 5 sigma of a variance
    of 8 000 samples. Each is the microphone's own: received 1, 2 ... 6 times as loud, the noise is
    as much louder."""
    for probe in (received, np.arange(1, 7)[:, None] * brief.direct[:1]):
        noise = noisy(probe, brief, snr_db, seed=1) - (probe - brief.direct)
        assert np.allclose(ratio_db(probe, noise), snr_db, atol=0.35)


@pytest.mark.parametrize("sdnr_db", [-20.0, 10.0])
def test_measured_sdnr_is_asked_sdnr_at_microphone_1(hovering, received, sdnr_db):
    """Exactly there; elsewhere the field has its own proportions, which a level per microphone
    would destroy."""
    noise = noisy(received, hovering, None, sdnr_db) - (received - hovering.direct)
    measured = ratio_db(received, noise)
    assert measured[0] == pytest.approx(sdnr_db, abs=1e-9)
    assert np.abs(measured[1:] - sdnr_db).max() > 0.01
    alone = draw(FIELD, 8000)
    assert np.allclose(noise / noise[0].std(), alone / alone[0].std(), atol=1e-9)


def test_both_noises_add_up_and_each_is_what_it_is_alone(brief, hovering, received):
    """y = x + f1 + f2; f2 is drawn first, so sets without f1 have the bytes they always had."""
    both = noisy(received, hovering, 3.0, -5.0, seed=6)
    rng = np.random.default_rng(6)
    f2 = noisy(received, brief, 3.0, seed=rng)
    f1 = noisy(received, hovering, None, -5.0, seed=rng)
    assert np.allclose(both, f1 + f2 - (received - brief.direct))


@pytest.mark.parametrize(
    ("diffuse", "levels", "message"),
    [
        (
            None,
            (0.0, -10.0),
            "sdnr_db=-10.0 dB: must be null in a scene without diffuse noise; choose diffuse=rotor",
        ),
        (FIELD, (0.0,), "sdnr_db=None: must be a level in dB, as the scene has diffuse noise"),
        (None, (None,), "snr_db=None: must be a level in dB"),
    ],
)
def test_levels_without_noise_and_noise_without_level_are_refused(brief, diffuse, levels, message):
    with refused(message):
        noisy(brief.direct, replace(brief, diffuse=diffuse), *levels)


def recorded_alone(scene, room, seconds, *levels, pings=1):
    """Return the noise alone, shape (M, K)."""
    draw = {"levels": NoiseLevels(*levels, pings=pings), "rng": np.random.default_rng(1)}
    return noise_alone(room, POSE, scene=scene, seconds=seconds, **draw)


def test_noise_alone_is_as_loud_and_as_coloured_as_in_an_observation(hovering, chamber, received):
    alone = recorded_alone(hovering, chamber, 2.0, 20.0, -5.0)
    assert alone.shape == (6, 44100)
    expected = signals.power(received[0]) * (10**0.5 + 10**-2.0)
    assert signals.power(alone[0]) == pytest.approx(expected, rel=0.03)

    noise = noisy(received, hovering, 20.0, -5.0, seed=2) - (received - hovering.direct)
    levels = []
    for samples in (alone[0], noise[0]):
        power = np.abs(np.fft.rfft(samples)) ** 2 / len(samples)
        edges = (np.array([250, 500, 1000, 2000, 4000, 8000]) * len(samples) / RATE).astype(int)
        levels.append(10 * np.log10(np.add.reduceat(power, edges)[:-1:2] / len(samples)))
    assert np.allclose(*levels, atol=2.5)


def test_noise_alone_has_the_density_of_what_is_left_in_the_mean(brief, chamber, received):
    alone = recorded_alone(brief, chamber, 2.0, 0.0, pings=16)
    assert np.allclose(signals.power(alone) / signals.power(received), 1 / 16, rtol=0.05)


@pytest.mark.parametrize("seconds", [0.0, "long", 1e6])
def test_noise_of_no_length_is_refused(brief, chamber, seconds):
    with refused("noise_seconds="):
        recorded_alone(brief, chamber, seconds, 0.0)


def test_gain_scales_signal_and_noise_alike(brief, received):
    loud, plain = (noisy(received, brief, 0.0, gain_db=gain_db) for gain_db in (6.0, 0.0))
    assert np.allclose(loud, 10 ** (6 / 20) * plain)


def test_the_truth_is_where_the_echo_is(brief, chamber):
    """Noise-free, one wall: the matched filter peaks within half a sample of the image."""
    alone = replace(chamber, walls=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    observation, truth = looked(alone, brief, 80.0)
    correlation = signals.matched_filter(observation.samples[0], brief.probe, first=60, last=300)
    assert truth.toa.shape == (1,)
    assert abs(correlation.argmax() + 60 - truth.toa[0] * RATE) <= 0.51


def test_an_array_through_the_wall_is_refused(brief, chamber):
    with refused("pose.position=(0.1, 2, 1) m: the array of radius 0.2 m must"):
        looked(chamber, brief, 0.0, pose=Pose(np.array([0.1, 2.0, 1.0])))


def test_a_speed_in_another_unit_is_refused(brief):
    with refused("scene.speed_of_sound=0.343 m/s"):
        replace(brief, speed_of_sound=0.343)


# ---------------------------------------------------------------- several pings


def test_one_quieter_draw_of_white_noise_is_the_mean_of_many_in_distribution(brief):
    """Same power, a K-th of one ping's; same distribution of samples; neither remembers anything.

    Under another name as many draws are made as there are pings.
    """
    strength = np.sqrt(signals.power(brief.direct))[:, None]
    left = []
    for noise, seed in ((White(), 1), (lambda *given, **draw: White()(*given, **draw), 2)):
        scene = replace(brief, noise=noise)
        left.append(noisy(brief.direct, scene, 0.0, seed=seed, pings=9) / strength)
    for noise in left:
        assert np.allclose(signals.power(noise), 1 / 9, rtol=5 * np.sqrt(2 / 8000))
        assert np.abs(np.corrcoef(noise) - np.eye(6)).max() < 5 / np.sqrt(8000)
        assert np.abs(np.mean(noise[:, 1:] * noise[:, :-1], axis=1)).max() < 5 / 9 / np.sqrt(8000)
    one, many = (noise.ravel() for noise in left)
    assert ks_2samp(one, many).pvalue > 0.01
    assert ks_2samp(one * 1.1, many).pvalue < 1e-4


def test_the_mean_of_other_noise_is_the_mean_of_its_draws(hovering, received):
    """Each ping at the SDNR, one after the other from the same generator; the echoes stay what they
    are."""
    rng = np.random.default_rng(3)
    single = [noisy(received, hovering, None, -5.0, seed=rng) for _ in range(4)]
    mean = noisy(received, hovering, None, -5.0, seed=3, pings=4)
    assert np.allclose(mean, np.mean(single, axis=0), atol=1e-12)
    noise = mean - (received - hovering.direct)
    quieter = signals.power(noise[0]) / (signals.power(received[0]) * 10**0.5)
    assert 0.1 < quieter < 0.5  # few lines: a quarter, about


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("pings", (0, 1.5, "many", True)),
        ("snr_db", ("loud", float("nan"))),
        ("sdnr_db", ("loud", -101.0)),
    ],
)
def test_bad_levels_are_refused(name, values):
    for value in values:
        with refused(f"{name}={value}"):
            NoiseLevels(**{"snr_db": 0.0} | {name: value})
