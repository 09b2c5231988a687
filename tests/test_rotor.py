"""The rotor model against what is known of the paper's recordings, and against its own formula."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import signal

from echolearn.geometry import SearchWindow, circular_array, microphone_positions, true_echoes
from echolearn.localize.matched import Matched
from echolearn.noise.diffuse import Diffuse
from echolearn.noise.rotor import Rotor
from echolearn.signals import convolve, noise_probe
from echolearn.simulate import Scene
from echolearn.types import Array, BadValue, MicArray, Observation, Pose, Room

RATE = 22050.0
RING = circular_array()


def sound(rotor: Rotor, *, seconds: float = 10.0, seed: int = 0) -> Array:
    """Return what is heard."""
    return rotor(length=int(seconds * RATE), sample_rate=RATE, rng=np.random.default_rng(seed))


def density(rotor: Rotor, *, draws: int = 10) -> tuple[Array, Array]:
    """Return frequencies and the power in each hertz."""
    found = [signal.welch(sound(rotor, seed=seed), RATE, nperseg=int(RATE)) for seed in range(draws)]
    return found[0][0], np.mean([power for _, power in found], axis=0)


def test_90_percent_of_the_power_lies_below_463_hz_and_the_strongest_line_at_70() -> None:
    frequencies, power = density(Rotor())
    assert power[frequencies < 463].sum() / power.sum() == pytest.approx(0.90, abs=0.01)
    assert frequencies[power.argmax()] == pytest.approx(70.0, abs=1.0)


def test_lines_stand_at_the_harmonics_of_the_rotor_and_the_blades_stand_out() -> None:
    frequencies, power = density(replace(Rotor(), jitter=0.001, tonal=0.99))
    lines = np.array([power[np.abs(frequencies - 70 * k) < 5].sum() for k in range(1, 11)])
    between = np.array([power[np.abs(frequencies - 70 * k - 35) < 5].sum() for k in range(1, 11)])
    assert (lines > 10 * between).all()
    orders = np.arange(1, 11)
    expected = np.where(orders % 2 == 0, 10**0.3, 1.0) / orders**2
    assert np.allclose(10 * np.log10(lines / lines[0]), 10 * np.log10(expected), atol=0.7)
    three = replace(Rotor(), blades=3).powers(RATE)
    assert three[2] / three[0] == pytest.approx(10**0.3 / 9)


def test_the_air_falls_by_6_db_per_octave_above_its_corner_and_begins_at_20_hz() -> None:
    frequencies, power = density(replace(Rotor(), tonal=0.0))
    octaves = [power[(frequencies >= f) & (frequencies < 2 * f)].mean() for f in (500, 1000, 2000, 4000)]
    assert np.allclose(np.diff(10 * np.log10(octaves)), -6.0, atol=0.4)
    assert power[frequencies < 18].max() < 1e-2 * power[(frequencies > 22) & (frequencies < 40)].mean()


def test_it_has_unit_power() -> None:
    power = [np.mean(sound(Rotor(), seed=seed) ** 2) for seed in range(20)]
    assert np.mean(power) == pytest.approx(1.0, abs=0.05)


def test_speed_wanders_as_much_as_it_is_told() -> None:
    """One rotor, one line: its instantaneous frequency has the deviation and the time constant that were asked for."""
    one = Rotor(rotors=1, harmonics=1, tonal=1.0, jitter=0.02, wander=0.5)
    phase = np.unwrap(np.angle(signal.hilbert(sound(one, seconds=200.0))))
    speed = np.diff(phase[::441]) * RATE / 441 / (2 * np.pi)  # 50 a second
    assert speed.mean() == pytest.approx(70.0, abs=0.4)
    assert speed[50:-50].std() == pytest.approx(1.4, rel=0.2)
    centred = speed[50:-50] - speed[50:-50].mean()
    assert np.mean(centred[25:] * centred[:-25]) / centred.var() == pytest.approx(np.exp(-1), abs=0.15)


def test_waves_are_continuous_and_exact() -> None:
    """Without jitter a single line is a sine of amplitude sqrt(2), from beginning to end."""
    one = sound(Rotor(rotors=1, harmonics=1, tonal=1.0, jitter=0.0), seconds=1.0)
    angle = 2 * np.pi * 70.0 * np.arange(len(one)) / RATE
    basis = np.stack([np.cos(angle), np.sin(angle)])
    weights = np.linalg.lstsq(basis.T, one, rcond=None)[0]
    assert np.hypot(*weights) == pytest.approx(np.sqrt(2), rel=1e-5)
    assert np.abs(one - weights @ basis).max() < 1e-5


def test_harmonics_stop_at_the_nyquist_frequency() -> None:
    assert len(Rotor(jitter=0.0).powers(1000.0)) == 7
    low = Rotor(jitter=0.0, tonal=1.0)(length=20000, sample_rate=1000.0, rng=np.random.default_rng(0))
    frequencies, power = signal.welch(low, 1000.0, nperseg=1000)
    folded = power[(frequencies % 70 > 5) & (frequencies % 70 < 65)].sum()
    assert folded < 1e-3 * power.sum()


def test_seeds_tell_sounds_apart() -> None:
    first, again, other = (sound(Rotor(), seconds=0.5, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0}, "diffuse.source.rate=0 Hz"),
        ({"rate": "fast"}, "diffuse.source.rate=fast Hz"),
        ({"blades": 2.5}, "diffuse.source.blades=2.5"),
        ({"rotors": 0}, "diffuse.source.rotors=0"),
        ({"jitter": -0.1}, "diffuse.source.jitter=-0.1"),
        ({"wander": 0.0}, "diffuse.source.wander=0.0 s"),
        ({"harmonics": 0}, "diffuse.source.harmonics=0"),
        ({"tonal": 1.5}, "diffuse.source.tonal=1.5"),
        ({"corner": 5.0}, "diffuse.source.corner=5.0 Hz"),
        ({"blade_gain_db": float("nan")}, "diffuse.source.blade_gain_db=nan dB"),
    ],
)
def test_bad_rotors_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BadValue) as refused:
        Rotor(**change)
    assert str(refused.value).startswith(message)


def test_s_nls_under_rotors_alone_is_as_good_as_planned(scene: Scene, study: tuple[Room, Pose]) -> None:
    """20 probes x 3 draws. Planning measured 93, 73 and 20 % in few trials at SDNR -10, -20 and -30 dB.

    In the middle the figure hangs on the spectrum, of which only two numbers are known: from 35 % (power of harmonics
    falling as 1 / k) over 50 % (this model) and 60 % (much of it below 70 Hz) to 73 % (nothing but the line at 70 Hz).
    """
    truth, place = true_echoes(*study, RING).toa, microphone_positions(RING, study[1])[:1]
    response = scene.rir(study[0], study[1].position, place, sample_rate=22050.0, speed_of_sound=343.0)
    field = [Diffuse(Rotor())(RING, length=20000, sample_rate=22050.0, rng=np.random.default_rng(s)) for s in range(3)]
    found = []
    for seed in range(20):
        robot = replace(scene, probe=noise_probe(seed=seed), array=MicArray(RING.positions[:1]))
        received = convolve(robot.probe.samples, response, 20000)
        for heard, sdnr_db in product(field, (-10.0, -20.0, -30.0)):
            noise = heard[:1] * np.sqrt(np.mean(received**2) / np.mean(heard[0] ** 2) * 10 ** (-sdnr_db / 10))
            heard_by_one = Observation((received - robot.direct + noise)[None], robot.probe, robot.array)
            matched = Matched(heard_by_one, SearchWindow(rule="authors"))
            found.append(matched.toa(matched.strongest)[0])
    right = (np.abs(np.array(found)[:, None] - truth).min(axis=1) * 22050.0 < 5).reshape(-1, 3)
    for share, expected in zip(right.mean(axis=0), (0.93, 0.50, 0.20), strict=True):
        assert abs(share - expected) < 3 * np.sqrt(2 * expected * (1 - expected) / 60)
