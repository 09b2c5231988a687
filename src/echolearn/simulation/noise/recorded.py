"""Noise from a recording: a random stretch of the user's own file, WAV or FLAC.

It is brought to the rate that is wanted when the file is read.
"""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check, check_rate, check_whole

NAME = "diffuse.source.path"

SILENCE = 0.1
"""Seconds of silence that are too long: 80 dB below the rest."""


@dataclass(frozen=True)
class Recorded:
    """One channel of a recording.

    Attributes:
        samples: shape (K,), zero mean and unit power over the whole recording, float32.
        sample_rate: in Hz.
    """

    samples: Array
    sample_rate: float

    def __call__(self, *, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return `length` successive samples that begin anywhere, shape (length,).

        Raises:
            BadValue: the recording is too short, or its rate another one.
        """
        check(
            sample_rate == self.sample_rate,
            "diffuse.source.sample_rate",
            f"{self.sample_rate:g} Hz",
            allowed=f"must be {sample_rate:g} Hz, the rate of the probe",
        )
        left = len(self.samples) - length
        check(
            left >= 0,
            NAME,
            f"{len(self.samples) / sample_rate:.2f} s of sound",
            allowed=f"must be at least {length / sample_rate:.2f} s",
            hint="every microphone takes a stretch of its own; use a longer one, a minute or more",
        )
        start = int(rng.integers(left + 1))
        return self.samples[start : start + length].astype(float)


def recorded(
    path: str | None, *, channel: int | str | None = None, sample_rate: float = 22050.0
) -> Recorded:
    """Read one channel of an audio file and resample it.

    Args:
        path: a WAV or FLAC file of any rate.
        channel: 1 is the first; "mix" is the mean of all; None will do for a file of one channel.
        sample_rate: wanted, in Hz.

    Raises:
        BadValue: no such file, not audio, silence somewhere, NaN, or a channel that is not there.
    """
    check_rate("diffuse.source.sample_rate", sample_rate)
    samples, rate = _read(path)
    chosen = _choose(samples, channel)
    finite = np.isfinite(chosen).all()
    check(finite, NAME, f"{path}, NaN or infinity", allowed="must be finite samples")

    ratio = Fraction(sample_rate / rate).limit_denominator(10_000)
    if ratio != 1:
        chosen = resample_poly(chosen, ratio.numerator, ratio.denominator)
    noise = chosen - chosen.mean()
    deviation = noise.std()
    _check_sound(noise, path=path, deviation=deviation, block=int(SILENCE * sample_rate))
    return Recorded((noise / deviation).astype(np.float32), float(sample_rate))


def _check_sound(noise: Array, *, path: str | None, deviation: float, block: int) -> None:
    """Raise `BadValue` where the recording, or a block of it, is silent."""
    hint = "is it another channel?"
    allowed = "must be a recording of noise"
    check(deviation > 1e-9, NAME, f"{path}, silence", allowed=allowed, hint=hint)

    blocks = noise[: len(noise) // block * block].reshape(-1, block)
    still = blocks.std(axis=1) < 1e-4 * deviation
    check(
        not still.any(),
        NAME,
        f"{path}, silence at {still.argmax() * SILENCE:.1f} s",
        allowed="must be noise throughout",
        hint="cut the silence away; a stretch may begin anywhere in the recording",
    )


def _read(path: str | None) -> tuple[Array, int]:
    """Return samples (K, channels) and the sample rate."""
    given = isinstance(path, str) and path != ""
    check(given, NAME, path, allowed="must be a WAV or FLAC file; give its name")
    try:
        import soundfile
    except ImportError:
        raise BadValue(f"{NAME}={path}: needs soundfile; pip install 'echolearn[lab]'") from None
    hint = f"is it relative to {Path.cwd()}?"
    check(Path(str(path)).is_file(), NAME, path, allowed="must be a file", hint=hint)
    try:
        samples, rate = soundfile.read(path, dtype="float64", always_2d=True)
    except (RuntimeError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise BadValue(f"{NAME}={path}: cannot be read as audio ({reason})") from None
    check(len(samples) > 0, NAME, f"{path}, no samples", allowed="must be a recording")
    return samples, int(rate)


def _choose(samples: Array, channel: int | str | None) -> Array:
    """Return one channel of samples (K, channels), or their mean."""
    count = samples.shape[1]
    if channel == "mix":
        return samples.mean(axis=1)
    if channel is None and count == 1:
        return samples[:, 0]
    hint = "that many has the file; mix is their mean"
    check_whole("diffuse.source.channel", channel, low=1, high=count, hint=hint)
    return samples[:, int(channel or 0) - 1]
