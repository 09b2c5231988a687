"""Recordings with faults: refused by name, or survived with a warning."""

import warnings
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import reference
from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Observation
from echolearn.bench import equations
from echolearn.checks import BadValue
from echolearn.localization import faults
from echolearn.localization.localizer import Localizer
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.mclam import Mclam
from echolearn.localization.methods.peaks import Peaks
from echolearn.localization.methods.snls import Snls

RING = circular_array()
PROBE = noise_probe(burst=400, length=6000)
CONFIGS = sorted((Path(__file__).parents[2] / "conf" / "localizer").glob("*.yaml"))


def build(config: Path) -> Localizer:
    """Call what a localizer's YAML names with what it says, in the default window."""
    arguments = yaml.safe_load(config.read_text())
    module, _, name = arguments.pop("_target_").rpartition(".")
    return getattr(import_module(module), name)(**{**arguments, "window": SearchWindow()})


ALL = [build(config) for config in CONFIGS]
OURS = [Snls(), Gated(), Gated(beam="mpdr"), Joint(), Em(), Mclam(), Peaks()]
names = pytest.mark.parametrize("localizer", ALL, ids=lambda one: type(one).__name__)


def heard(azimuth: float = 0.5, *, noise: float = 0.02) -> np.ndarray:
    """Return recordings (1, M, N) of an echo that reaches microphone 1 at sample 180."""
    early = equations.delays(RING.positions, azimuth)[0] * 22050.0
    source = 0.1 * equations.shift(equations.padded(PROBE.samples, PROBE.length), 180 - early)
    waves = reference.plane_wave(source, RING.positions, azimuth, rate=22050.0)
    return (waves + noise * np.random.default_rng(0).standard_normal(waves.shape))[None]


def refused(localizer: Localizer, samples: np.ndarray, message: str, **changed: Any) -> None:
    with pytest.raises(BadValue, match=message):
        localizer(replace(Observation(samples, PROBE, RING), **changed))


# ---------------------------------------------------------------- refused


@names
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite(localizer: Localizer, value: float) -> None:
    samples = heard()
    samples[0, 4, 5999] = value
    refused(
        localizer,
        samples,
        r"^observation.samples=NaN or infinity: finite samples; is a microphone broken",
    )


@pytest.mark.parametrize(
    "samples", [np.ones((1, 6, 9), complex), np.full((1, 6, 9), "1"), None, [[1.0], [1.0, 2.0]]]
)
def test_samples_that_are_no_real_numbers(samples: Any) -> None:
    with pytest.raises(
        BadValue, match=r"^observation.samples=dtype .*: real numbers, shape \(..., M, N\); give"
    ):
        Observation(samples, PROBE, RING)


@pytest.mark.parametrize("speed", [0.0, np.nan, 3.43e5, "fast"])
def test_a_speed_of_sound_that_is_none(speed: Any) -> None:
    with pytest.raises(
        BadValue, match=r"^observation.speed_of_sound=.* m/s: must be a number from 100 to 2000 m/s; air is"
    ):
        Observation(heard(), PROBE, RING, speed)


@names
def test_channels_that_are_not_the_arrays(localizer: Localizer) -> None:
    refused(
        localizer,
        heard()[:, :5],
        r"^observation.samples=\(1, 5, 6000\): \(B, 6, N\), one channel for each",
    )
    refused(localizer, heard()[0], r"^observation.samples=\(6, 6000\): \(B, 6, N\)")


@names
def test_another_sample_rate(localizer: Localizer) -> None:
    message = r"^observation.sample_rate=44100.0 Hz: 22050 Hz, the probe's; resample the recording"
    refused(localizer, heard(), message, sample_rate=44100.0)
    localizer(Observation(heard(), PROBE, RING, sample_rate=22050.0))


@names
def test_a_clipped_channel(localizer: Localizer) -> None:
    samples = heard()
    samples[0, 2] = np.clip(samples[0, 2], -0.15, 0.15)
    refused(
        localizer,
        samples,
        r"^observation.samples=microphone 3 of observation 0 clipped at 0.15: .*less gain",
    )


@names
def test_a_window_outside_the_recording(localizer: Localizer) -> None:
    far = replace(localizer, window=SearchWindow(farthest=60.0))  # type: ignore[type-var]
    refused(far, heard(), r"^window.farthest=60.0 m: echoes within the recording of 6000 samples")


@pytest.mark.parametrize(
    "localizer", [Snls(), Gated(), Peaks()], ids=lambda one: type(one).__name__
)
def test_a_deaf_reference_where_it_is_all_there_is(localizer: Localizer) -> None:
    samples = heard()
    samples[0, 0] = 0.0
    refused(
        localizer,
        samples,
        r"^observation.samples=silence at microphone 1: .*localizer=joint and localizer=em",
    )


@pytest.mark.parametrize("name", ["echoes", "azimuths"])
@names
def test_numbers_that_are_none(localizer: Localizer, name: str) -> None:
    if name in {field.name for field in fields(localizer)}:  # type: ignore[arg-type]
        with pytest.raises(BadValue, match=f"^localizer.{name}=many"):
            replace(localizer, **{name: "many"})  # type: ignore[type-var]


# ---------------------------------------------------------------- survived


@pytest.mark.parametrize(
    "dtype", [np.int16, np.int32, np.uint16, np.float16, np.float32, np.longdouble]
)
@names
def test_any_real_dtype_gives_the_same_echoes(localizer: Localizer, dtype: type) -> None:
    """Louder than the root of what an int16 holds, so that its squares would wrap around; uint16
    has an offset."""
    samples = (np.rint(8000 * heard()) + 12_000 * (dtype is np.uint16)).astype(dtype)
    noise = np.rint(1000 * np.random.default_rng(1).standard_normal((6, 6000))).astype(np.int16)
    told = {
        "noise_psd": signals.noise_psd(noise),
        "noise_covariance": signals.noise_covariance(noise),
    }
    expected = localizer(Observation(samples.astype(float), PROBE, RING, **told))
    found = localizer(Observation(samples, PROBE, RING, **told))
    assert all(
        np.array_equal(getattr(found, name), value) for name, value in vars(expected).items()
    )
    assert found.toa[0, 0] * 22050.0 == pytest.approx(180, abs=0.51)
    assert signals.noise_psd(noise).mean() == pytest.approx(1e6, rel=0.05)


WITHOUT = [(one, 4) for one in OURS] + [
    (one, 1) for one in OURS if not isinstance(one, Snls | Gated | Peaks)
]


@pytest.mark.parametrize(
    ("localizer", "microphone"), WITHOUT, ids=lambda one: getattr(one, "real", type(one).__name__)
)
@pytest.mark.parametrize("fault", ["silent", "stuck", "faint"])
def test_a_microphone_that_does_not_hear_is_told_and_left_out(
    localizer: Localizer, fault: str, microphone: int
) -> None:
    samples = np.concatenate([heard(), heard(-2.0)])
    level = 1e-4 * np.random.default_rng(5).standard_normal(6000)
    samples[0, microphone - 1] = {"silent": 0.0, "stuck": 0.7, "faint": level}[fault]
    message = f"microphone {microphone} is silent in 1 of 2 observations and is left out there"
    with pytest.warns(faults.SilentMicrophone, match=message):
        echoes = localizer(Observation(samples, PROBE, RING))
    assert np.allclose(echoes.toa[:, 0] * 22050.0, 180, atol=0.51)
    assert np.allclose(echoes.azimuth[:, 0], [0.5, -2.0], atol=np.radians(4))
    assert np.allclose(echoes.gain[:, 0], 0.1, rtol=0.1)


@pytest.mark.parametrize("fault", [0.0, 0.7])
@pytest.mark.parametrize("kind", [Snls, Gated, Joint, Em, Mclam])
def test_whitening_does_not_wake_a_deaf_microphone(kind: type, fault: float) -> None:
    samples = heard()
    samples[0, 3] = fault
    with pytest.warns(faults.SilentMicrophone, match="microphone 4 is silent"):
        echoes = kind(whiten=True)(
            Observation(samples, PROBE, RING, noise_psd=np.linspace(1, 2, 65))
        )
    assert echoes.toa[0, 0] * 22050.0 == pytest.approx(180, abs=0.51)
    assert echoes.azimuth[0, 0] == pytest.approx(0.5, abs=np.radians(4))


@pytest.mark.parametrize("kind", [Gated, Joint, Em])
def test_an_array_too_wide_to_be_steered_is_refused(kind: type) -> None:
    wide = Observation(heard(), PROBE, MicArray(4 * RING.positions))
    with pytest.raises(
        BadValue, match=r"^array.positions=1.60 m: microphones up to 1.00 m from the first"
    ):
        kind()(wide)


@pytest.mark.parametrize("psd", [np.ones((5, 9)), np.full(9, np.nan), -np.ones((6, 9))])
def test_a_density_that_is_none_is_refused_even_if_only_for_weights(psd: np.ndarray) -> None:
    for localizer in (Em(), Mclam()):
        refused(localizer, heard(), r"^observation.noise_psd=", noise_psd=psd)


@names
def test_sound_recordings_are_not_complained_of(localizer: Localizer) -> None:
    """PCM of 16 bits with few levels in use repeats its extremes, and is not clipped."""
    coarse = np.round(heard() * 100) / 100
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        localizer(Observation(np.concatenate([heard(), coarse, 1e-9 * heard()]), PROBE, RING))


def test_a_silent_recording_has_no_deaf_microphone() -> None:
    assert not faults.silent_microphones(np.zeros((1, 6, 100))).any()


def test_weights_are_one_over_the_noise_but_not_for_the_faintest() -> None:
    rng = np.random.default_rng(3)
    levels = np.array([1.0, 1.0, 1.0, 3.0, 0.1, 0.0])
    observation = Observation(levels[:, None] * rng.standard_normal((1, 6, 20_000)), PROBE, RING)
    silent = np.array([[False] * 5 + [True]])
    found = whitening.noise_weights(observation, silent)[0]
    assert np.allclose(found, [1, 1, 1, 1 / 9, whitening.LARGEST_WEIGHT, 0], rtol=0.1)
    told = replace(observation, noise_psd=levels[:, None] ** 2 * np.ones(9))
    assert np.allclose(whitening.noise_weights(told, silent)[0], [1, 1, 1, 1 / 9, whitening.LARGEST_WEIGHT, 0])


def test_a_single_microphone_has_times_but_no_direction() -> None:
    one = Observation(heard()[:, :1], PROBE, MicArray(RING.positions[:1]))
    assert Joint()(one).toa[0, 0] * 22050.0 == pytest.approx(180, abs=0.1)
