"""The noise-weighted matched filter against its sums written out, in fields whose answer is known,
and under rotors."""

from dataclasses import fields, replace

import numpy as np
import pytest

from echolearn.acoustics import signals
from echolearn.acoustics.types import Echoes, Room
from echolearn.bench.equations import relative
from echolearn.localization.beamforming import azimuth_grid
from echolearn.localization.methods.joint import Joint
from echolearn.localization.silence import SilentMicrophone
from echolearn.localization.spatial import LOADING, spatial
from echolearn.localization.whitening import shared_noise, whitened
from echolearn.simulation.noise.diffuse import coherence
from echolearn.simulation.noise.fixed import Fixed
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.studies.accuracy import METRICS
from echolearn.studies.estimates import estimate
from echolearn.studies.study import Study
from reference import FIRST, LAST, RATE, RING, observed, wave, white
from refusals import refused

PROBE = signals.noise_probe(burst=300, length=700)
IDENTITY = np.broadcast_to(np.eye(6), (65, 6, 6)).astype(complex)
PLANE = np.pi / 2
WEIGHTED = Joint(whiten="spatial")


def shared(level, *, seed, length=700):
    """Return noise of which a half is the same at all microphones, and a half of each its own."""
    rng = np.random.default_rng(seed)
    return level * (rng.standard_normal(length) + rng.standard_normal((6, length)))


def covariance_of(level, seed):
    return signals.noise_covariance(shared(level, seed=seed, length=40_000), frame=128)


def batch(*samples, covariance=IDENTITY):
    return observed(PROBE, *samples, noise_psd=np.ones(65), noise_covariance=covariance)


def weighting(covariance, *silent):
    raw = batch(np.zeros((6, 700)), covariance=covariance)
    return spatial(whitened(raw), shared_noise(raw)[1], silent=np.isin(np.arange(6), silent))


def strength(weights):
    """Return E over the energy of the burst, for directions in the array's plane."""
    azimuth = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    return weights.strength(azimuth, np.full(90, PLANE)) / PROBE.energy


def test_covariances_of_noise_are_those_it_was_made_with_and_densities_their_diagonal():
    noise = shared(3.0, seed=1, length=400_000)
    found = signals.noise_covariance(noise, frame=128)
    assert found.shape == (65, 6, 6)
    assert np.allclose(found, 9.0 * (1 + np.eye(6)), atol=9 * 2 * 0.1)
    assert np.allclose(np.diagonal(found, axis1=1, axis2=2).T, signals.noise_psd(noise, frame=128))
    # The second microphone is 3 samples later than the first.
    late = signals.noise_covariance(np.stack([noise[0, 3:], noise[0, :-3]]), frame=128)
    turned = np.exp(-2j * np.pi * 3 * np.arange(65) / 128)
    assert np.allclose(late[:, 1, 0] / late[:, 0, 0], turned, atol=0.15)


@pytest.mark.parametrize("gain", [1.0, 0.1])
def test_in_independent_white_noise_it_is_joint(gain):
    waves = [(0.5, 150.3), (-2.0, 200.0), (3.0, 170.0), (1.0, 220.0)]
    recordings = batch(
        *(wave(PROBE, *one, gain) + white(PROBE, 1.0, seed) for seed, one in enumerate(waves))
    )
    plain, weighted = Joint(whiten=True)(recordings), WEIGHTED(recordings)
    for f in fields(Echoes):
        both = getattr(plain, f.name), getattr(weighted, f.name)
        assert np.allclose(*both, rtol=1e-3, atol=1e-5), f.name


def literal(samples, covariance):
    """Return lag, azimuth and gain of the largest J / sqrt(E) over half lags and 24 azimuths, sum
    by sum.

    Phi of each bin is the sum of its lags, tapered as the estimator has it, with its loading; by
    `numpy.linalg.inv`.
    """
    size, steps, full = 2048, 52, 2 * (len(covariance) - 1)
    lags = np.fft.irfft(covariance, full, axis=0)
    omega = 2 * np.pi * np.arange(size // 2 + 1) / size
    phi = LOADING * np.broadcast_to(np.eye(6), (len(omega), 6, 6)).astype(complex)
    for lag in range(-steps, steps + 1):
        taper = 0.5 + 0.5 * np.cos(np.pi * lag / (steps + 1))
        phi = phi + taper * np.exp(-1j * omega * lag)[:, None, None] * lags[lag]
    inverse = [np.linalg.inv(one / (1 + LOADING)) for one in phi]
    recorded = np.fft.rfft(samples, size)
    burst = np.fft.rfft(PROBE.samples, size)
    weighted = np.array([inverse[k] @ recorded[:, k] for k in range(len(omega))])
    best = (-np.inf, 0.0, 0.0, 0.0)
    for azimuth in azimuth_grid(24):
        d = np.exp(-1j * omega[:, None] * relative(RING.positions, azimuth, rate=RATE))
        powers = [(d[k].conj() @ inverse[k] @ d[k]).real for k in range(len(omega))]
        energy = np.sum(np.abs(burst) ** 2 * powers)
        along = burst.conj() * np.sum(d.conj() * weighted, axis=1)
        for lag in np.arange(FIRST, LAST + 0.5, 0.5):
            j = float(np.sum(along * np.exp(1j * omega * lag)).real)
            best = max(best, (j / np.sqrt(energy), lag, azimuth, j / energy))
    return best[1:]


@pytest.mark.parametrize("gain", [0.3, 3.0])
def test_it_is_its_sums_written_out(gain):
    covariance = covariance_of(3.0, 5)
    level = np.mean(np.diagonal(covariance, axis1=1, axis2=2).real, axis=1)
    flat = covariance / level[:, None, None]
    samples = wave(PROBE, 2.0, 190, gain) + shared(3.0, seed=6)
    coarse = Joint(azimuths=24, refine=False, whiten="spatial")
    found = coarse(batch(samples, covariance=flat))
    lag, azimuth, height = literal(samples, flat)
    assert found.toa[0, 0] * RATE == pytest.approx(lag, abs=1e-6)
    assert found.azimuth[0, 0] == pytest.approx(azimuth)
    assert found.gain[0, 0] == pytest.approx(height, rel=0.02)


def test_in_a_diffuse_field_an_echo_is_as_strong_as_in_independent_noise():
    """Gamma = E d d^H over directions, so the mean of d^H Gamma^-1 d is M, whatever the frequency;
    one microphone less is one less."""
    frequencies = np.linspace(0, RATE / 2, 442)
    field = coherence(RING.positions, frequencies, speed_of_sound=343.0).astype(complex)
    assert np.allclose(strength(weighting(IDENTITY)), 6, rtol=1e-6)
    assert np.allclose(strength(weighting(IDENTITY, 0)), 5, rtol=1e-6)
    assert strength(weighting(field)).mean() == pytest.approx(6, rel=0.05)


def test_noise_that_all_microphones_share_is_removed():
    """At one moment everywhere: no wave in the plane comes like that, and the others tell what to
    subtract."""
    rng = np.random.default_rng(3)
    covariance = np.broadcast_to(1 + 1e-3 * np.eye(6), (65, 6, 6)).astype(complex)
    rows = [wave(PROBE, -1.0, 180, 0.2) + 3 * rng.standard_normal(700) for _ in range(6)]
    recordings = batch(*rows, covariance=covariance)
    plain = Joint(whiten=True)(recordings)
    weighted = WEIGHTED(recordings)
    assert np.mean(np.abs(plain.toa * RATE - 180) < 1) < 0.5
    assert np.allclose(weighted.toa * RATE, 180, atol=1)
    assert np.allclose(weighted.azimuth, -1.0, atol=np.radians(2))


def test_two_echoes_are_resolved_in_shared_noise():
    two = wave(PROBE, 0.5, 150.3, 1.0) + wave(PROBE, 2.5, 171.6, 0.7)
    recordings = batch(two + shared(0.05, seed=9), covariance=covariance_of(0.05, 8))
    found = replace(WEIGHTED, echoes=2)(recordings)
    assert np.allclose(found.toa[0] * RATE, [150.3, 171.6], atol=0.3)
    assert np.allclose(found.azimuth[0], [0.5, 2.5], atol=np.radians(2))
    assert np.allclose(found.gain[0], [1.0, 0.7], rtol=0.1)
    assert (found.score[0] < 1.0).all()


def test_silent_microphones_are_left_out_of_their_recordings_only():
    covariance = covariance_of(0.1, 8)
    whole = wave(PROBE, 0.5, 180, 1.0) + shared(0.1, seed=9)
    lacking = whole * (np.arange(6) > 0)[:, None]
    with pytest.warns(SilentMicrophone, match="microphone 1 is silent in 1 of 2"):
        both = WEIGHTED(batch(lacking, whole, covariance=covariance))
    alone = WEIGHTED(batch(whole, covariance=covariance))
    assert np.allclose(both.toa * RATE, 180, atol=0.1)
    assert both.gain[1, 0] == pytest.approx(alone.gain[0, 0])
    silence = WEIGHTED(batch(np.zeros((6, 700))))
    assert all(np.isfinite(values).all() for values in vars(silence).values())


def test_densities_may_come_from_the_covariance_alone():
    recordings = batch(wave(PROBE, 0.5, 180, 1.0) + shared(0.5, seed=1))
    assert WEIGHTED(replace(recordings, noise_psd=None)).toa == WEIGHTED(recordings).toa


def test_under_a_robots_own_rotors_it_holds_the_map_that_plain_whitening_loses():
    """Four rotors beside the array."""
    arms = [[x, y, 0.1] for x in (0.25, -0.25) for y in (0.25, -0.25)]
    noise = Fixed(Rotor(rotors=1), arms)
    scene = Scene(RING, signals.noise_probe(), Images(), White(), diffuse=noise)
    both = {way: Joint(azimuths=60, whiten=way) for way in (True, "spatial")}
    room = Room((6.0, 5.0, 6.0), 0.25)
    study = Study("sdnr_db", [-36.0], room, scene, both, positions=5, trials=5)
    hits = estimate(study, -36.0)["hit"][:, :2, METRICS.index("on_map")]
    plain, weighted = hits.mean(axis=0)
    assert weighted >= plain + 0.5


NAME = "observation.noise_covariance"


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (None, f"localizer.whiten=spatial: needs {NAME}; record"),
        (np.ones((65, 5, 5)), f"{NAME}=shape (65, 5, 5): must be (F, 6, 6)"),
        (IDENTITY * np.nan, f"{NAME}=NaN or infinity"),
        (IDENTITY * 1j, f"{NAME}=not Hermitian"),
        (-IDENTITY, f"{NAME}=not Hermitian, or a density below 0"),
        (0 * IDENTITY, "observation.noise_psd=0"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance, message):
    with refused(message):
        WEIGHTED(batch(white(PROBE, 1.0), covariance=covariance))
