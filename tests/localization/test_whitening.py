"""Pre-whitening: densities in their units, lags that stay, weights, echoes under rotors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from echolearn.acoustics import signals
from echolearn.acoustics.rooms import true_echoes
from echolearn.localization import silence, whitening
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.mclam import Mclam
from echolearn.localization.methods.peaks import Peaks
from echolearn.localization.methods.snls import Snls
from reference import RATE, observed, turn
from refusals import refused

PROBE = signals.noise_probe(burst=400, length=3000)


def rotor(length, *, seed):
    """Return noise of unit power at 6 microphones, harmonics of 70 Hz and a rumble."""
    rng = np.random.default_rng(seed)
    rumble = sosfilt(butter(1, 150.0, fs=RATE, output="sos"), rng.standard_normal((6, length)))
    turns = 2 * np.pi * 70.0 * np.arange(length) / RATE
    lines = sum(np.sin(h * turns + rng.uniform(0, 2 * np.pi, (6, 1))) / h for h in range(1, 5))
    mixed = np.sqrt(0.6) * rumble / rumble.std() + np.sqrt(0.4) * lines / lines.std()
    return mixed + 0.01 * rng.standard_normal((6, length))


# ---------------------------------------------------------------- densities and filters


def test_densities_are_in_units_of_power():
    """White noise of variance v has the density v; the mean density is the power."""
    psd = signals.noise_psd(3.0 * np.random.default_rng(0).standard_normal((6, 80_000)))
    assert psd.shape == (6, 442)
    assert np.allclose(psd.mean(axis=0), 9.0, rtol=0.25)
    assert psd.mean() == pytest.approx(9.0, rel=0.01)
    noise = rotor(60_000, seed=1)
    assert np.allclose(signals.noise_psd(noise).mean(axis=-1), signals.power(noise), rtol=0.05)
    loud = np.rint(1000 * noise).astype(np.int16)
    assert signals.noise_psd(loud).mean() == pytest.approx(1e6, rel=0.05)


def test_a_flat_density_only_scales_and_delays():
    samples = np.random.default_rng(1).standard_normal((2, 300))
    found = signals.whiten(samples, np.full(17, 4.0))
    assert found.shape == (2, 332)
    assert np.allclose(found[:, 16:316], samples / 2)
    assert np.allclose(np.delete(found, np.s_[16:316], axis=-1), 0, atol=1e-12)


def test_whitened_noise_is_white():
    noise, other = rotor(80_000, seed=2)[0], rotor(80_000, seed=3)[0]
    before = signals.noise_psd(other)
    after = signals.noise_psd(signals.whiten(other, signals.noise_psd(noise)))
    assert before.max() / before.min() > 1000
    assert np.median(after) == pytest.approx(1.0, rel=0.1)
    assert np.mean((after > 0.5) & (after < 2)) > 0.98


def test_the_correlation_of_two_whitened_signals_is_divided_by_the_density():
    """ifft(Y conj(S) / P) for a density that the filter can follow, and the lag is still that of
    the delay."""
    burst = np.random.default_rng(4).standard_normal(500)
    recording = np.pad(burst, (137, 387))
    psd = 1.5 + np.cos(np.linspace(0, np.pi, 65))
    y, s = signals.whiten(recording, psd), signals.whiten(burst, psd)
    found = np.correlate(y, s, "full")[len(s) - 1 :][:300]
    density = 1.5 + np.cos(np.linspace(0, np.pi, 2049))
    spectrum = np.fft.rfft(recording, 4096) * np.fft.rfft(burst, 4096).conj()
    exact = np.fft.irfft(spectrum / density, 4096)
    assert found.argmax() == 137
    assert np.abs(found - exact[:300]).max() < 0.01 * exact.max()


def test_what_is_no_noise_is_refused():
    for psd in (np.zeros(9), -np.ones(9), np.full(9, np.nan)):
        with refused("observation.noise_psd=shape (9,)"):
            signals.whiten(np.zeros(100), psd)
    with refused("noise.recording=1000 samples: must be"):
        signals.noise_psd(np.zeros((6, 1000)))
    with refused("noise.recording=NaN"):
        signals.noise_psd(np.full(4000, np.nan))


# ---------------------------------------------------------------- observations


def test_density_of_all_or_of_each_microphone():
    samples = np.random.default_rng(5).standard_normal((2, 6, 3000))
    batch = observed(PROBE, *samples)
    shape = np.linspace(1.0, 3.0, 33)
    level = np.array([1.0, 4.0, 1.0, 0.0, 1.0, 2.0])
    one, each = (
        whitening.whitened(replace(batch, noise_psd=psd)) for psd in (shape, np.outer(level, shape))
    )
    assert np.allclose(one.samples, each.samples)
    assert np.allclose(each.noise_psd.mean(axis=-1) / each.noise_psd[0].mean(), level)


@pytest.mark.parametrize(
    ("psd", "message"),
    [
        (np.ones((5, 9)), "shape (5, 9): must be (F,) or (6, F)"),
        (np.full(9, np.nan), "NaN"),
        (-np.ones((6, 9)), "NaN, infinity or below 0: densities must be 0 or more"),
    ],
)
def test_what_is_no_density_is_refused_even_if_only_for_weights(psd, message):
    batch = observed(PROBE, np.random.default_rng(5).standard_normal((6, 3000)), noise_psd=psd)
    for work in (Em(), Mclam(), Snls(whiten=True)):
        with refused(f"observation.noise_psd={message}"):
            work(batch)


def test_weights_are_one_over_the_noise_but_not_for_the_faintest():
    levels = np.array([1.0, 1.0, 1.0, 3.0, 0.1, 0.0])[:, None]
    noise = levels * np.random.default_rng(3).standard_normal((6, 20_000))
    batch = observed(signals.noise_probe(), noise)
    silent = silence.silent_microphones(batch.samples)
    expected = [1, 1, 1, 1 / 9, whitening.LARGEST_WEIGHT, 0]
    assert silent.tolist() == [[False] * 5 + [True]]
    assert np.allclose(whitening.noise_weights(batch, silent)[0], expected, rtol=0.1)
    told = replace(batch, noise_psd=levels**2 * np.ones(9))
    assert np.allclose(whitening.noise_weights(told, silent)[0], expected)


# ---------------------------------------------------------------- rotors


def under_rotors(hear, place, *, sdnr_db, trials):
    """Return recordings with rotor noise, and its density from another recording."""
    quiet, louder = (hear(place, snr_db=snr_db, trials=trials) for snr_db in (40.0, 0.0))
    # The same noise at two levels tells what 0 dB is.
    received = np.var(louder.samples - quiet.samples) / 0.99**2
    scale = np.sqrt(received * 10 ** (-sdnr_db / 10))
    noise = scale * np.stack([rotor(20_000, seed=100 + trial) for trial in range(trials)])
    psd = signals.noise_psd(scale * rotor(60_000, seed=7))
    return replace(quiet, samples=quiet.samples + noise, noise_psd=psd)


def test_every_estimator_but_plain_division_is_better_whitened(hear, beside):
    """Within 8 degrees: what is left is above some kHz, where 1 m is near and a wave no longer
    plane. Plain division cancels it, (Y / sqrt P) / (S / sqrt P) = Y / S, but for the filter's
    ends."""
    batch = under_rotors(hear, beside, sdnr_db=-20.0, trials=12)
    truth = true_echoes(*beside, array=batch.array)
    for kind in (Joint, Em, Gated, Mclam, Snls):
        plain, white = (
            np.mean(
                (np.abs(echoes.toa - truth.toa[0]) * RATE < 5)
                & (np.abs(turn(echoes.azimuth - truth.azimuth[0])) < np.radians(8))
            )
            for echoes in (kind(whiten=whiten)(batch) for whiten in (False, True))
        )
        assert white >= plain + 0.3, kind
        assert white >= 0.9, kind
    quieter = under_rotors(hear, beside, sdnr_db=10.0, trials=4)
    plain, white = (Peaks(azimuths=8, whiten=whiten)(quieter).toa for whiten in (False, True))
    assert np.array_equal(plain, white)
