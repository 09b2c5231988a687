"""Pre-whitening: densities in their units, lags that stay, and echoes found under rotors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow, circular_array, true_echoes
from echolearn.acoustics.types import Observation, Pose, Room
from echolearn.checks import BadValue
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.mclam import Mclam
from echolearn.localization.methods.peaks import Peaks
from echolearn.localization.methods.snls import Snls
from echolearn.localization.whitening import whitened

Hear = Callable[..., Observation]
KINDS = [Snls, Gated, Joint, Em, Mclam, Peaks]


def rotor(length: int, *, seed: int) -> np.ndarray:
    """Return noise of unit power at 6 microphones, nine tenths of it below 463 Hz: harmonics of 70
    Hz and a rumble."""
    rng = np.random.default_rng(seed)
    rumble = sosfilt(butter(1, 150.0, fs=22050.0, output="sos"), rng.standard_normal((6, length)))
    turns = 2 * np.pi * 70.0 * np.arange(length) / 22050.0
    lines = sum(np.sin(h * turns + rng.uniform(0, 2 * np.pi, (6, 1))) / h for h in range(1, 5))
    mixed = np.sqrt(0.6) * rumble / rumble.std() + np.sqrt(0.4) * lines / lines.std()
    return mixed + 0.01 * rng.standard_normal((6, length))


# ---------------------------------------------------------------- densities and filters


def test_white_noise_of_variance_v_has_the_density_v() -> None:
    psd = signals.noise_psd(3.0 * np.random.default_rng(0).standard_normal((6, 80_000)))
    assert psd.shape == (6, 442)
    assert np.allclose(psd.mean(axis=0), 9.0, rtol=0.25)
    assert psd.mean() == pytest.approx(9.0, rel=0.01)


def test_the_mean_density_is_the_power() -> None:
    noise = rotor(60_000, seed=1)
    assert np.allclose(signals.noise_psd(noise).mean(axis=-1), signals.power(noise), rtol=0.05)


def test_a_flat_density_only_scales_and_delays() -> None:
    samples = np.random.default_rng(1).standard_normal((2, 300))
    found = signals.whiten(samples, np.full(17, 4.0))
    assert found.shape == (2, 332)
    assert np.allclose(found[:, 16:316], samples / 2)
    assert np.allclose(np.delete(found, np.s_[16:316], axis=-1), 0, atol=1e-12)


def test_whitened_noise_is_white() -> None:
    noise, other = rotor(80_000, seed=2)[0], rotor(80_000, seed=3)[0]
    before = signals.noise_psd(other)
    after = signals.noise_psd(signals.whiten(other, signals.noise_psd(noise)))
    assert before.max() / before.min() > 1000
    assert np.median(after) == pytest.approx(1.0, rel=0.1)
    assert np.mean((after > 0.5) & (after < 2)) > 0.98


def test_the_correlation_of_two_whitened_signals_is_divided_by_the_density() -> None:
    """ifft(Y conj(S) / P) for a density that the filter can follow, and the lag is still that of
    the delay."""
    rng = np.random.default_rng(4)
    burst = rng.standard_normal(500)
    recording = np.concatenate([np.zeros(137), burst, np.zeros(387)])
    psd = 1.5 + np.cos(np.linspace(0, np.pi, 65))
    y, s = signals.whiten(recording, psd), signals.whiten(burst, psd)
    found = np.correlate(y, s, "full")[len(s) - 1 :]
    size = 4096
    density = 1.5 + np.cos(np.linspace(0, np.pi, size // 2 + 1))
    exact = np.fft.irfft(
        np.fft.rfft(recording, size) * np.fft.rfft(burst, size).conj() / density, size
    )
    assert found.argmax() == 137
    assert np.abs(found[:300] - exact[:300]).max() < 0.01 * exact.max()


@pytest.mark.parametrize("psd", [np.zeros(9), -np.ones(9), np.full(9, np.nan)])
def test_what_is_no_density_is_refused(psd: np.ndarray) -> None:
    with pytest.raises(BadValue, match=r"^observation.noise_psd="):
        signals.whiten(np.zeros(100), psd)


def test_a_noise_recording_too_short_or_broken_is_refused() -> None:
    with pytest.raises(
        BadValue, match=r"^noise.recording=1000 samples: .*record the noise for some seconds"
    ):
        signals.noise_psd(np.zeros((6, 1000)))
    with pytest.raises(BadValue, match=r"^noise.recording=NaN"):
        signals.noise_psd(np.full(4000, np.nan))


# ---------------------------------------------------------------- localizers that whiten


@pytest.mark.parametrize("kind", KINDS)
def test_whitening_without_a_density_is_refused(
    kind: type, hear: Hear, beside: tuple[Room, Pose]
) -> None:
    with pytest.raises(BadValue, match=r"^localizer.whiten=True: .*record the noise alone"):
        kind(whiten=True)(hear(beside, snr_db=10.0, trials=1))


@pytest.mark.parametrize("kind", KINDS)
def test_a_flat_density_changes_no_estimate(
    kind: type, hear: Hear, beside: tuple[Room, Pose]
) -> None:
    """But that whitened times lie between samples, where the crests of ringing echoes are, and
    gains with them."""
    heard = hear(beside, snr_db=10.0, trials=3)
    level = float(np.var(heard.samples[..., -3000:]))
    plain = kind()(heard)
    white = kind(whiten=True)(replace(heard, noise_psd=np.full(442, level)))
    assert np.allclose(white.toa, plain.toa, atol=0.51 / 22050.0)
    assert np.allclose(white.azimuth, plain.azimuth, atol=np.radians(2.01))
    assert (white.gain >= 0.98 * plain.gain).all()
    assert (white.gain <= plain.gain / np.sinc(0.5)).all()


def test_density_of_all_or_of_each_microphone() -> None:
    rng = np.random.default_rng(5)
    probe = signals.noise_probe(burst=400, length=3000)
    heard = Observation(rng.standard_normal((2, 6, 3000)), probe, circular_array())
    shape = np.linspace(1.0, 3.0, 33)
    one = whitened(replace(heard, noise_psd=shape))
    each = whitened(replace(heard, noise_psd=np.outer([1.0, 4.0, 1.0, 0.0, 1.0, 2.0], shape)))
    assert np.allclose(one.samples, each.samples)
    assert np.allclose(each.noise_psd.mean(axis=-1) / each.noise_psd[0].mean(), [1, 4, 1, 0, 1, 2])
    with pytest.raises(
        BadValue, match=r"^observation.noise_psd=\(5, 33\): shape \(F,\) or \(6, F\)"
    ):
        whitened(replace(heard, noise_psd=np.ones((5, 33))))


def under_rotors(
    hear: Hear, place: tuple[Room, Pose], *, sdnr_db: float, trials: int
) -> Observation:
    """Return recordings with rotor noise, and the density of another recording of the same rotors."""
    heard, louder = (hear(place, snr_db=snr_db, trials=trials) for snr_db in (40.0, 0.0))
    received = (
        np.var(louder.samples - heard.samples) / 0.99**2
    )  # the same noise at two levels tells what 0 dB is
    scale = np.sqrt(received * 10 ** (-sdnr_db / 10))
    noise = scale * np.stack([rotor(20_000, seed=100 + trial) for trial in range(trials)])
    return replace(
        heard,
        samples=heard.samples + noise,
        noise_psd=signals.noise_psd(scale * rotor(60_000, seed=7)),
    )


def test_the_rotors_are_as_deep_as_those_of_the_recordings() -> None:
    psd, frequencies = (
        signals.noise_psd(rotor(60_000, seed=0)),
        np.fft.rfftfreq(signals.STFT_FRAME, 1 / 22050.0),
    )
    assert psd[:, frequencies < 463].sum() / psd.sum() == pytest.approx(0.9, abs=0.02)


def test_whitening_finds_echoes_under_rotors_that_are_lost_without_it(
    hear: Hear, study: tuple[Room, Pose]
) -> None:
    """S-NLS within 5 samples at SDNR -20 dB; planning measured 73 % plain and 100 % whitened under
    recorded rotors."""
    heard = under_rotors(hear, study, sdnr_db=-20.0, trials=16)
    truth, window = true_echoes(*study, heard.array).toa, SearchWindow(rule="authors")
    plain, white = (
        np.mean(np.abs(Snls(window, 8, whiten=whiten)(heard).toa - truth).min(axis=1) * 22050.0 < 5)
        for whiten in (False, True)
    )
    assert plain <= 0.8
    assert white == 1.0


def test_every_estimator_but_plain_division_hears_better_whitened(
    hear: Hear, beside: tuple[Room, Pose]
) -> None:
    """Within 8 degrees: what is left to hear is above some kHz, where 1 m is near and a wave no
    longer plane."""
    heard = under_rotors(hear, beside, sdnr_db=-20.0, trials=12)
    truth = true_echoes(*beside, heard.array)
    for kind in (Joint, Em, Gated, Mclam, Snls):
        plain, white = (
            np.mean(
                (np.abs(echoes.toa - truth.toa[0]) * 22050.0 < 5)
                & (
                    np.abs(np.angle(np.exp(1j * (echoes.azimuth - truth.azimuth[0]))))
                    < np.radians(8)
                )
            )
            for echoes in (kind(whiten=whiten)(heard) for whiten in (False, True))
        )
        assert white >= plain + 0.3, kind
        assert white >= 0.9, kind


def test_plain_division_cancels_the_whitening(hear: Hear, beside: tuple[Room, Pose]) -> None:
    """(Y / sqrt P) / (S / sqrt P) = Y / S: RIR-PP hears the same at every lag, but for the filter's
    ends."""
    heard = under_rotors(hear, beside, sdnr_db=10.0, trials=4)
    plain, white = (Peaks(azimuths=8, whiten=whiten)(heard) for whiten in (False, True))
    assert np.array_equal(plain.toa, white.toa)
