"""The noise-weighted matched filter against its sums written out, in fields whose answer is known,
and under rotors."""

from dataclasses import fields, replace
from itertools import product

import numpy as np
import pytest

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.types import Array, Echoes, Observation, Room
from echolearn.bench.equations import padded, relative, shift
from echolearn.checks import BadValue
from echolearn.localization.beamforming import azimuth_grid
from echolearn.localization.faults import SilentMicrophone
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.localization.spatial import LOADING, Spatial, spatial
from echolearn.localization.whitening import whitened
from echolearn.simulation.noise.diffuse import Diffuse, coherence
from echolearn.simulation.noise.fixed import Fixed
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.studies.accuracy import METRICS
from echolearn.studies.run import estimate
from echolearn.studies.study import Study

RING = circular_array()
RATE = 22050.0
PROBE = signals.noise_probe(burst=300, length=700)
FIRST, LAST = SearchWindow().lags(RING, RATE)
IDENTITY = np.broadcast_to(np.eye(6), (65, 6, 6)).astype(complex)
ARMS = Fixed(
    Rotor(rotors=1),
    [[0.25, 0.25, 0.1], [-0.25, 0.25, 0.1], [-0.25, -0.25, 0.1], [0.25, -0.25, 0.1]],
)


WAVES = [(0.5, 150.3), (-2.0, 200.0), (3.0, 170.0), (1.0, 220.0)]


def echo(azimuth: float, lag: float, *, gain: float = 1.0, length: int = 700) -> Array:
    """Return what the ring hears of one plane wave."""
    late = relative(RING.positions, azimuth, rate=RATE)
    return gain * np.stack([shift(padded(PROBE.samples, length), lag + eta) for eta in late])


def shared(level: float, *, seed: int, length: int = 700) -> Array:
    """Return noise of which a half is the same at all microphones, and a half of each its own."""
    rng = np.random.default_rng(seed)
    return level * (rng.standard_normal(length) + rng.standard_normal((6, length)))


def observation(*samples: Array, covariance: Array = IDENTITY) -> Observation:
    return Observation(
        np.stack(samples), PROBE, RING, noise_psd=np.ones(65), noise_covariance=covariance
    )


def test_covariances_of_noise_are_those_it_was_made_with_and_densities_their_diagonal() -> None:
    noise = shared(3.0, seed=1, length=400_000)
    found = signals.noise_covariance(noise, frame=128)
    assert found.shape == (65, 6, 6)
    assert np.allclose(found, 9.0 * (1 + np.eye(6)), atol=9 * 2 * 0.1)
    assert np.allclose(np.diagonal(found, axis1=1, axis2=2).T, signals.noise_psd(noise, frame=128))
    late = signals.noise_covariance(
        np.stack([noise[0, 3:], noise[0, :-3]]), frame=128
    )  # hears it 3 samples later
    turned = np.exp(-2j * np.pi * 3 * np.arange(65) / 128)
    assert np.allclose(late[:, 1, 0] / late[:, 0, 0], turned, atol=0.15)


@pytest.mark.parametrize("gain", [1.0, 0.1])
def test_in_independent_white_noise_it_is_joint(gain: float) -> None:
    noise = np.random.default_rng(0).standard_normal((4, 6, 700))
    heard = observation(
        *(echo(azimuth, lag, gain=gain) + n for (azimuth, lag), n in zip(WAVES, noise, strict=True))
    )
    plain, weighted = Joint(whiten=True)(heard), Joint(whiten="spatial")(heard)
    for f in fields(Echoes):
        assert np.allclose(
            getattr(plain, f.name), getattr(weighted, f.name), rtol=1e-3, atol=1e-5
        ), f.name


def literal(samples: Array, covariance: Array) -> tuple[float, float, float]:
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
    phi = phi / (1 + LOADING)
    heard = np.fft.rfft(samples, size)
    burst = np.fft.rfft(PROBE.samples, size)
    inverse = [np.linalg.inv(one) for one in phi]
    weighted = np.array([inverse[k] @ heard[:, k] for k in range(len(omega))])
    best = (-np.inf, 0.0, 0.0, 0.0)
    for azimuth in azimuth_grid(24):
        eta = relative(RING.positions, azimuth, rate=RATE)
        d = np.exp(-1j * omega[:, None] * eta)
        energy = sum(
            abs(burst[k]) ** 2 * (d[k].conj() @ inverse[k] @ d[k]).real for k in range(len(omega))
        )
        along = burst.conj() * np.sum(d.conj() * weighted, axis=1)
        for lag in np.arange(FIRST, LAST + 0.5, 0.5):
            j = float(np.sum(along * np.exp(1j * omega * lag)).real)
            best = max(best, (j / np.sqrt(energy), lag, azimuth, j / energy))
    return best[1:]


@pytest.mark.parametrize("gain", [0.3, 3.0])
def test_it_is_its_sums_written_out(gain: float) -> None:
    covariance = signals.noise_covariance(shared(3.0, seed=5, length=40_000), frame=128)
    covariance /= np.trace(covariance.mean(axis=0)).real / 6
    flat = (
        covariance / np.mean(np.diagonal(covariance, axis1=1, axis2=2).real, axis=1)[:, None, None]
    )
    heard = echo(2.0, 190, gain=gain) + shared(3.0, seed=6)
    found = Joint(azimuths=24, refine=False, whiten="spatial")(observation(heard, covariance=flat))
    lag, azimuth, height = literal(heard, flat)
    assert found.toa[0, 0] * RATE == pytest.approx(lag, abs=1e-6)
    assert found.azimuth[0, 0] == pytest.approx(azimuth)
    assert found.gain[0, 0] == pytest.approx(height, rel=0.02)


def weighting(covariance: Array, *, heard: Array | None = None) -> Spatial:
    raw = observation(np.zeros((6, 700)), covariance=covariance)
    return spatial(whitened(raw), raw, heard=np.ones(6, dtype=bool) if heard is None else heard)


def test_in_a_diffuse_field_an_echo_is_as_strong_as_in_independent_noise() -> None:
    """Gamma = E d d^H over directions, so the mean of d^H Gamma^-1 d is M, whatever the frequency."""
    frequencies = np.linspace(0, RATE / 2, 442)
    field = coherence(RING.positions, frequencies, speed_of_sound=343.0).astype(complex)
    azimuth = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    plane = np.full(90, np.pi / 2)
    alone, shared_by_all = (
        weighting(one).strength(azimuth, plane) for one in (np.ones((442, 1, 1)) * np.eye(6), field)
    )
    energy = np.sum(PROBE.samples**2)
    assert np.allclose(alone, 6 * energy, rtol=1e-6)
    assert shared_by_all.mean() == pytest.approx(6 * energy, rel=0.05)


def test_noise_that_all_microphones_share_is_removed() -> None:
    """At one moment everywhere: no wave in the plane comes like that, and the others tell what to
    subtract."""
    rng = np.random.default_rng(3)
    covariance = np.broadcast_to(np.ones((6, 6)) + 1e-3 * np.eye(6), (65, 6, 6)).astype(complex)
    heard = observation(
        *(echo(-1.0, 180, gain=0.2) + 3 * rng.standard_normal(700) for _ in range(6)),
        covariance=covariance,
    )
    plain, weighted = (
        np.abs(Joint(whiten=w)(heard).toa[:, 0] * RATE - 180) < 1 for w in (True, "spatial")
    )
    assert plain.mean() < 0.5
    assert weighted.all()
    assert np.allclose(Joint(whiten="spatial")(heard).azimuth[:, 0], -1.0, atol=np.radians(2))


def test_two_echoes_are_told_apart_in_shared_noise() -> None:
    covariance = signals.noise_covariance(shared(0.05, seed=8, length=40_000), frame=128)
    heard = echo(0.5, 150.3) + echo(2.5, 171.6, gain=0.7) + shared(0.05, seed=9)
    found = Joint(echoes=2, whiten="spatial")(observation(heard, covariance=covariance))
    assert np.allclose(found.toa[0] * RATE, [150.3, 171.6], atol=0.3)
    assert np.allclose(found.azimuth[0], [0.5, 2.5], atol=np.radians(2))
    assert np.allclose(found.gain[0], [1.0, 0.7], rtol=0.1)
    assert (found.score[0] < 1.0).all()


def test_deaf_microphones_are_left_out_of_their_recordings_only() -> None:
    covariance = signals.noise_covariance(shared(0.1, seed=8, length=40_000), frame=128)
    whole = echo(0.5, 180) + shared(0.1, seed=9)
    deaf = whole * np.array([0, 1, 1, 1, 1, 1])[:, None]
    with pytest.warns(SilentMicrophone, match="microphone 1 is silent in 1 of 2"):
        both = Joint(whiten="spatial")(observation(deaf, whole, covariance=covariance))
    alone = Joint(whiten="spatial")(observation(whole, covariance=covariance))
    assert np.allclose(both.toa * RATE, 180, atol=0.1)
    assert both.gain[1, 0] == pytest.approx(alone.gain[0, 0])
    mask = np.arange(6) > 0
    five, energy = weighting(IDENTITY, heard=mask), np.sum(PROBE.samples**2)
    assert five.strength(np.zeros(1), np.full(1, np.pi / 2)) == pytest.approx(5 * energy)


def test_silence_is_answered_with_finite_numbers() -> None:
    found = Joint(whiten="spatial")(observation(np.zeros((6, 700))))
    assert all(np.isfinite(getattr(found, f.name)).all() for f in fields(Echoes))


def test_densities_may_come_from_the_covariance_alone() -> None:
    heard = observation(echo(0.5, 180) + shared(0.5, seed=1))
    assert (
        Joint(whiten="spatial")(replace(heard, noise_psd=None)).toa
        == Joint(whiten="spatial")(heard).toa
    )


ROOM = Room((6.0, 5.0, 6.0), 0.25)


def test_under_a_robots_own_rotors_it_holds_the_map_that_plain_whitening_loses() -> None:
    """Four rotors beside the array; in a diffuse field, which no weights can remove, it loses
    nothing."""
    scene = Scene(RING, signals.noise_probe(), Images(), White(), diffuse=ARMS)
    both = {"plain": Joint(whiten=True), "spatial": Joint(whiten="spatial")}
    study = Study("sdnr_db", [-37.0], ROOM, scene, both, positions=24, trials=24)
    plain, weighted = estimate(study, -37.0)["hit"][:, :2, METRICS.index("on_map")].mean(axis=0)
    assert weighted >= 0.85
    assert weighted >= plain + 0.5
    spread = replace(study, scene=replace(scene, diffuse=Diffuse(Rotor())), positions=2, trials=6)
    assert (estimate(spread, -20.0)["hit"][:, 1, METRICS.index("on_map")] == 1.0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"noise_covariance": None},
            "localizer.whiten=spatial: only with observation.noise_covariance; record",
        ),
        (
            {"noise_covariance": np.ones((65, 5, 5))},
            "observation.noise_covariance=(65, 5, 5): shape (F, 6, 6)",
        ),
        ({"noise_covariance": IDENTITY * np.nan}, "observation.noise_covariance=NaN"),
        ({"noise_covariance": IDENTITY * 1j}, "observation.noise_covariance=not Hermitian"),
        (
            {"noise_covariance": -IDENTITY},
            "observation.noise_covariance=not Hermitian, or a density below 0",
        ),
        ({"noise_covariance": 0 * IDENTITY}, "observation.noise_psd=0"),
    ],
)
def test_what_is_no_covariance_is_refused(change: dict[str, Array | None], message: str) -> None:
    heard = replace(observation(np.random.default_rng(0).standard_normal((6, 700))), **change)  # type: ignore[arg-type]
    with pytest.raises(BadValue) as refused:
        Joint(whiten="spatial")(heard)
    assert str(refused.value).startswith(message)


def test_other_localizers_and_other_words_are_refused() -> None:
    with pytest.raises(
        BadValue, match=r"^localizer.whiten=spatial: true, false; spatial is for localizer=joint"
    ):
        Snls(whiten="spatial")  # type: ignore[arg-type]
    for word, kind in product(("loud", None, 1), (Joint, Snls)):
        with pytest.raises(BadValue, match=r"^localizer.whiten="):
            kind(whiten=word)
