"""What the robot hears, against single images, measured noise and the paper's SNR."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp

import reference
from echolearn.acoustics import signals
from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import add_noise, noise_alone, observe
from echolearn.simulation.scene import Scene

POSE = Pose(np.array([1.3, 2.2, 1.4]), 0.7)


def relative_error(found, expected):
    """Return the energy of the difference over the energy of what was expected."""
    return float(np.sum((found - expected) ** 2) / np.sum(expected**2))


def test_the_direct_path_is_one_over_four_pi_r_and_r_over_c_late(brief):
    """The engine's filter is not flat up to the Nyquist frequency: 3 % of a white burst's energy."""
    probe, places = brief.probe, brief.array.positions
    expected = [
        reference.echo(
            probe.samples, np.zeros(3), p, strength=1.0, rate=22050.0, length=probe.length
        )
        for p in places
    ]
    assert relative_error(brief.direct, np.array(expected)) < 0.03
    peak = signals.matched_filter(brief.direct, probe, first=0, last=40).argmax(axis=-1)
    assert np.array_equal(peak, [13] * 6)  # 0.2 m / c = 12.86 samples


@pytest.mark.parametrize("wall", range(6))
def test_one_wall_makes_one_echo(brief, chamber, wall):
    factor = 0.8
    alone = replace(chamber, walls=tuple(factor * float(index == wall) for index in range(6)))
    reflected = brief.received(alone, POSE) - brief.direct
    image = reference.images(chamber.size, POSE.position)[wall]
    strength = factor * np.sqrt(1 - chamber.sabine_absorption())
    places = reference.microphones(brief.array.positions, POSE.position, POSE.heading)
    expected = [
        reference.echo(
            brief.probe.samples,
            image,
            p,
            strength=strength,
            rate=22050.0,
            length=brief.probe.length,
        )
        for p in places
    ]
    assert relative_error(reflected, np.array(expected)) < 0.03


def test_an_anechoic_room_leaves_nothing(brief, chamber):
    received = brief.received(replace(chamber, walls=(0.0,) * 6), POSE)
    rest = add_noise(received, brief, levels=NoiseLevels(100.0), rng=np.random.default_rng(0))
    assert signals.power(rest).max() < 1e-8 * signals.power(received).min()


def test_no_trace_of_the_direct_path_is_left(brief, chamber):
    """The nearest wall answers after 154 samples: what comes before is the direct path, 60 dB down
    at least."""
    received = brief.received(chamber, POSE)
    rest = add_noise(received, brief, levels=NoiseLevels(100.0), rng=np.random.default_rng(0))
    assert np.abs(rest[:, :120]).max() < 2e-3 * np.abs(received[:, :120]).max()
    assert np.abs(rest[:, 200:2000]).max() > 0.05 * np.abs(received).max()


@pytest.mark.parametrize("snr_db", [-20.0, 0.0, 17.5])
def test_measured_snr_is_asked_snr_at_every_microphone(brief, chamber, snr_db):
    """The ratio counts the direct path, though it is then removed; 0.2 dB is 5 sigma of a variance
    of 8 000 samples."""
    received = brief.received(chamber, POSE)
    samples = add_noise(received, brief, levels=NoiseLevels(snr_db), rng=np.random.default_rng(1))
    noise = samples - (received - brief.direct)
    measured = 10 * np.log10(np.mean(received**2, axis=1) / np.mean(noise**2, axis=1))
    assert measured.shape == (6,)
    assert np.allclose(measured, snr_db, atol=0.35)


def test_the_ratio_is_each_microphones_own(brief):
    """Microphones that hear the probe 1, 2 ... 6 times as loud get noise 1, 2 ... 6 times as loud."""
    received = np.arange(1, 7)[:, None] * brief.direct[:1]
    noise = (
        add_noise(received, brief, levels=NoiseLevels(-10.0), rng=np.random.default_rng(4))
        + brief.direct
        - received
    )
    assert np.allclose(noise.std(axis=1) / noise[0].std(), np.arange(1, 7), rtol=0.05)


def test_noise_is_independent_between_microphones(brief):
    rng = np.random.default_rng(2)
    noise = brief.noise(brief.array, length=8000, sample_rate=22050.0, rng=rng)
    assert np.abs(np.corrcoef(noise) - np.eye(6)).max() < 5 / np.sqrt(8000)
    assert np.allclose(noise.var(axis=1), 1.0, atol=0.1)


FIELD = Diffuse(Rotor())


@pytest.mark.parametrize("sdnr_db", [-20.0, 10.0])
def test_measured_sdnr_is_asked_sdnr_at_microphone_1(brief, chamber, sdnr_db):
    """Exactly there; elsewhere the field has its own proportions, which a level per microphone
    would destroy."""
    scene, received = replace(brief, diffuse=FIELD), brief.received(chamber, POSE)
    levels = NoiseLevels(None, sdnr_db)
    samples = add_noise(received, scene, levels=levels, rng=np.random.default_rng(1))
    noise = samples - (received - brief.direct)
    measured = 10 * np.log10(np.mean(received**2, axis=1) / np.mean(noise**2, axis=1))
    assert measured[0] == pytest.approx(sdnr_db, abs=1e-9)
    assert np.abs(measured[1:] - sdnr_db).max() > 0.01
    alone = FIELD(brief.array, length=8000, sample_rate=22050.0, rng=np.random.default_rng(1))
    assert np.allclose(noise / noise[0].std(), alone / alone[0].std(), atol=1e-9)


def test_both_noises_add_up_and_each_is_what_it_is_alone(brief, chamber):
    """y = x + f1 + f2; f2 is drawn first, so sets without f1 have the bytes they always had."""
    scene, received = replace(brief, diffuse=FIELD), brief.received(chamber, POSE)
    both = add_noise(received, scene, levels=NoiseLevels(3.0, -5.0), rng=np.random.default_rng(6))
    rng = np.random.default_rng(6)
    f2 = add_noise(received, brief, levels=NoiseLevels(3.0), rng=rng)
    f1 = add_noise(received, scene, levels=NoiseLevels(None, -5.0), rng=rng)
    assert np.allclose(both, f1 + f2 - (received - brief.direct))


@pytest.mark.parametrize(
    ("field", "levels", "message"),
    [
        (
            None,
            {"snr_db": 0.0, "sdnr_db": -10.0},
            "sdnr_db=-10.0 dB: must be null in a scene without diffuse noise; choose diffuse=rotor",
        ),
        (
            FIELD,
            {"snr_db": 0.0},
            "sdnr_db=None: must be a level in dB, as the scene has diffuse noise",
        ),
        (None, {"snr_db": None}, "snr_db=None: must be a level in dB"),
    ],
)
def test_levels_without_noise_and_noise_without_level_are_refused(brief, field, levels, message):
    with pytest.raises(BadValue) as refused:
        add_noise(
            brief.direct,
            replace(brief, diffuse=field),
            levels=NoiseLevels(**levels),
            rng=np.random.default_rng(0),
        )
    assert str(refused.value).startswith(message)


def test_noise_alone_is_as_loud_and_as_coloured_as_in_an_observation(brief, chamber):
    scene, levels = replace(brief, diffuse=FIELD), NoiseLevels(20.0, -5.0)
    alone = noise_alone(
        chamber, POSE, scene=scene, seconds=2.0, rng=np.random.default_rng(1), levels=levels
    )
    received = brief.received(chamber, POSE)
    assert alone.shape == (6, 44100)
    expected = signals.power(received[0]) * (10**0.5 + 10**-2.0)
    assert signals.power(alone[0]) == pytest.approx(expected, rel=0.03)
    samples = add_noise(received, scene, rng=np.random.default_rng(2), levels=levels)
    heard = samples - (received - brief.direct)
    bands = [
        [np.mean(np.abs(np.fft.rfft(x))[int(low * len(x) / 22050) : int(2 * low * len(x) / 22050)] ** 2) / len(x)
         for low in (250, 1000, 4000)]
        for x in (alone[0], heard[0])
    ]  # fmt: skip
    assert np.allclose(10 * np.log10(np.array(bands[0]) / bands[1]), 0.0, atol=2.5)


@pytest.mark.parametrize("seconds", [0.0, "long", 1e6])
def test_noise_of_no_length_is_refused(brief, chamber, seconds):
    with pytest.raises(BadValue, match=r"^noise_seconds="):
        noise_alone(
            chamber,
            POSE,
            scene=brief,
            seconds=seconds,
            levels=NoiseLevels(0.0),
            rng=np.random.default_rng(0),
        )


def test_gain_scales_signal_and_noise_alike(brief, chamber):
    received = brief.received(chamber, POSE)
    loud, plain = (
        add_noise(received, brief, levels=NoiseLevels(0.0), gain_db=g, rng=np.random.default_rng(3))
        for g in (6.0, 0.0)
    )
    assert np.allclose(loud, 10 ** (6 / 20) * plain)


def test_observing_again_hears_the_same(brief, chamber):
    first, again, other = (
        observe(chamber, POSE, scene=brief, levels=NoiseLevels(0.0), rng=np.random.default_rng(s))[
            0
        ]
        for s in (5, 5, 6)
    )
    assert first.samples.shape == (6, 8000)
    assert np.array_equal(first.samples, again.samples)
    assert not np.array_equal(first.samples, other.samples)


def test_the_truth_is_where_the_echo_is(brief, chamber):
    """Noise-free, one wall: the matched filter of every microphone peaks within half a sample of
    the image."""
    alone = replace(chamber, walls=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    observation, truth = observe(
        alone, POSE, scene=brief, levels=NoiseLevels(80.0), rng=np.random.default_rng(0)
    )
    peak = (
        signals.matched_filter(observation.samples[0], brief.probe, first=60, last=300).argmax()
        + 60
    )
    assert truth.toa.shape == (1,)
    assert abs(peak - truth.toa[0] * 22050.0) <= 0.51


def test_turning_the_robot_by_one_microphone_renames_the_microphones(brief, chamber):
    turned = replace(POSE, heading=POSE.heading + np.pi / 3)
    before, after = (brief.received(chamber, pose) for pose in (POSE, turned))
    assert np.allclose(after, np.roll(before, -1, axis=0), atol=1e-3 * np.abs(before).max())


def test_sound_is_faster_where_it_is_said_to_be(brief, chamber):
    """Twice the speed, half the delay: 0.2 m are 6.4 samples at 686 m/s."""
    quick = replace(brief, speed_of_sound=686.0)
    assert signals.matched_filter(quick.direct[0], brief.probe, first=0, last=40).argmax() == 6


def test_an_array_through_the_wall_is_refused(brief, chamber):
    with pytest.raises(
        BadValue, match=r"^pose.position=\(0.1, 2, 1\) m: the array of radius 0.2 m must"
    ):
        observe(
            chamber,
            Pose(np.array([0.1, 2.0, 1.0])),
            scene=brief,
            levels=NoiseLevels(0.0),
            rng=np.random.default_rng(0),
        )


def test_a_speed_in_another_unit_is_refused(brief):
    with pytest.raises(BadValue, match=r"^scene.speed_of_sound=0.343 m/s"):
        Scene(circular_array(), brief.probe, brief.rir, brief.noise, speed_of_sound=0.343)


# ---------------------------------------------------------------- several pings


class Hiss:
    """White noise under another name, of which as many draws are made as there are pings."""

    def __call__(self, array, **draw):
        return White()(array, **draw)


def test_one_quieter_draw_of_white_noise_is_the_mean_of_many_in_distribution(brief):
    """Same power, a K-th of one ping's; same distribution of samples; neither remembers anything."""
    left = []
    for noise, seed in ((White(), 1), (Hiss(), 2)):
        scene = replace(brief, noise=noise)
        draw = {"levels": NoiseLevels(0.0, pings=9), "rng": np.random.default_rng(seed)}
        left.append(
            add_noise(brief.direct, scene, **draw) / np.sqrt(signals.power(brief.direct))[:, None]
        )
    for noise in left:
        assert np.allclose(signals.power(noise), 1 / 9, rtol=5 * np.sqrt(2 / 8000))
        assert np.abs(np.corrcoef(noise) - np.eye(6)).max() < 5 / np.sqrt(8000)
        assert np.abs(np.mean(noise[:, 1:] * noise[:, :-1], axis=1)).max() < 5 / 9 / np.sqrt(8000)
    assert ks_2samp(*(noise.ravel() for noise in left)).pvalue > 0.01
    assert ks_2samp(left[0].ravel() * 1.1, left[1].ravel()).pvalue < 1e-4


def test_the_mean_of_other_noise_is_the_mean_of_its_draws(brief, chamber):
    """Each ping at the SDNR, one after the other from the same generator; the echoes stay what they
    are."""
    scene, received = replace(brief, diffuse=FIELD), brief.received(chamber, POSE)
    levels = NoiseLevels(None, -5.0)
    rng = np.random.default_rng(3)
    single = [add_noise(received, scene, rng=rng, levels=levels) for _ in range(4)]
    mean = add_noise(received, scene, rng=np.random.default_rng(3), levels=replace(levels, pings=4))
    assert np.allclose(mean, np.mean(single, axis=0), atol=1e-12)
    noise = mean - (received - brief.direct)
    assert (
        0.1 < signals.power(noise[0]) / (signals.power(received[0]) * 10**0.5) < 0.5
    )  # few lines: a quarter, about


def test_noise_alone_has_the_density_of_what_is_left_in_the_mean(brief, chamber):
    draw = {"levels": NoiseLevels(0.0, pings=16), "rng": np.random.default_rng(1)}
    alone = noise_alone(chamber, POSE, scene=brief, seconds=2.0, **draw)
    assert np.allclose(
        signals.power(alone) / signals.power(brief.received(chamber, POSE)), 1 / 16, rtol=0.05
    )


@pytest.mark.parametrize("pings", [0, 1.5, "many", True])
def test_no_ping_at_all_is_refused(pings):
    with pytest.raises(BadValue, match=r"^pings="):
        NoiseLevels(0.0, pings=pings)
