"""Numbers that headers do not tell: all recordings of a survey are read as what they are."""

import numpy as np
import pytest
from scipy.io import wavfile

from echolearn.acoustics.geometry import SearchWindow
from echolearn.localization.localize import localize
from echolearn.localization.methods.gated import Gated
from echolearn.survey.examining import examine
from echolearn.survey.health import mended
from echolearn.survey.reader import read_survey
from recorded_walks import PROBE, walk, write

LOUD = 0.4
"""Of full scale: the loudest sample of a healthy walk."""


def stored(survey, samples, kind, *, names=()):
    """Store recordings (P, M, N) of -1 ... 1 in words or floats of a kind, by scipy."""
    for name, recording in zip(names or survey.files, samples, strict=True):
        bits = {"s24_32": 24, "s16_32": 16, "f16": 16, "f24": 24, "s32": 32, "msb24": 24}[kind]
        counts = np.rint(recording.T * 2.0 ** (bits - 1))
        word = np.float32 if kind[0] == "f" else np.int32
        counts = counts * (256 if kind == "msb24" else 1)
        rate = round(PROBE.sample_rate)
        wavfile.write(survey.folder / name, rate, counts.astype(word))
    return survey


@pytest.fixture
def loud():
    samples = walk(direct=False)[:4]
    return LOUD * samples / np.abs(samples).max()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("s24_32", "all recordings: 24 bits in words of 32, which no header tells; read so"),
        ("s16_32", "all recordings: 16 bits in words of 32"),
        ("f16", "all recordings: counts of 16 bits, stored as floats; read so"),
        ("f24", "all recordings: counts of 24 bits, stored as floats; read so"),
        ("msb24", ""),
        ("s32", ""),
    ],
)
def test_power_is_that_of_the_sound_however_it_is_stored(kind, said, tmp_path, loud):
    """One recording of the walk is silent enough that alone it would tell nothing."""
    loud[2] *= 1e-2
    plain = write(tmp_path / "plain", loud, direct=False)
    survey = stored(write(tmp_path / "stored", loud, direct=False), loud, kind)
    health = examine(survey)
    assert [line.startswith(said) for line in health.mended] == [True] * bool(said)
    gated = Gated(window=SearchWindow())
    found, wanted = (
        localize(each.observe(range(4)), gated, names=("power",))[1]["power"]
        for each in (mended(survey, health), plain)
    )
    assert np.allclose(found, wanted, rtol=0.02)
    assert np.allclose(health.level_db, examine(plain).level_db, atol=0.1)


def test_soft_sound_of_32_bits_is_left_alone(tmp_path, loud):
    """If a single sample of the walk is above 24 bits, all recordings have more."""
    samples = loud * 2.0**-9
    samples[1, 0, 100] = 2.0**-7
    survey = stored(write(tmp_path, samples, direct=False), samples, "s32")
    health = examine(survey)
    assert health.mended == () and health.containers.recordings.scale == 1.0


def test_probe_and_noise_have_numbers_of_their_own(tmp_path, loud):
    """Noise is too soft to tell by itself, and is stored as the recordings are."""
    survey = stored(write(tmp_path, loud, direct=False), loud, "s24_32")
    hiss = 1e-3 * np.random.default_rng(3).standard_normal((1, 6, 9000))
    stored(survey, hiss, "s24_32", names=("noise.wav",))
    found = mended(survey, examine(survey))
    [piece] = found.noise()
    assert np.allclose(piece, hiss[0], atol=2.0**-23)

    burst = 0.9 * PROBE.samples / np.abs(PROBE.samples).max()
    padded = np.pad(burst, (0, PROBE.length - len(burst)))
    stored(survey, padded[None, None], "s16_32", names=("probe.wav",))
    probed = read_survey(survey.folder)
    assert np.allclose(probed.probe.samples, burst, atol=2.0**-15)
    assert examine(probed).mended[0] == (
        "probe.wav: 16 bits in words of 32, which no header tells; read so"
    )
