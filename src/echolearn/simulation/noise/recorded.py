"""Noise from a recording: a random stretch of the user's own file, WAV or FLAC, brought to the rate
that is wanted.
"""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check, check_number

NAME = "diffuse.source.path"

SILENCE = 0.1
"""s, that is too long: 80 dB below the rest."""


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
        hint = "diffuse.source.sample_rate should be that of the probe"
        check(sample_rate == self.sample_rate, "diffuse.source.sample_rate", f"{self.sample_rate:g} Hz",
              allowed=f"{sample_rate:g} Hz", hint=hint)  # fmt: skip
        left = len(self.samples) - length
        allowed = f"at least {length / sample_rate:.2f} s at once"
        hint = "every microphone takes a stretch of its own; use a longer one, a minute or more"
        check(
            left >= 0,
            NAME,
            f"{len(self.samples) / sample_rate:.2f} s of sound",
            allowed=allowed,
            hint=hint,
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
    check_number("diffuse.source.sample_rate", sample_rate, low=1000.0, high=400_000.0, unit="Hz")
    samples, rate = _read(path)
    chosen = _choose(samples, channel)
    check(
        bool(np.isfinite(chosen).all()), NAME, f"{path}, NaN or infinity", allowed="finite samples"
    )
    ratio = Fraction(sample_rate / rate).limit_denominator(10_000)
    heard = resample_poly(chosen, ratio.numerator, ratio.denominator) if ratio != 1 else chosen
    heard = heard - heard.mean()
    deviation = heard.std()
    check(
        deviation > 1e-9,
        NAME,
        f"{path}, silence",
        allowed="a recording of noise",
        hint="is it another channel?",
    )
    block = int(SILENCE * sample_rate)
    still = heard[: len(heard) // block * block].reshape(-1, block).std(axis=1) < 1e-4 * deviation
    where, hint = (
        float(still.argmax() * SILENCE),
        "cut it away; what is heard may begin anywhere in the recording",
    )
    check(
        not still.any(),
        NAME,
        f"{path}, silence at {where:.1f} s",
        allowed="noise throughout",
        hint=hint,
    )
    return Recorded((heard / deviation).astype(np.float32), float(sample_rate))


def _read(path: str | None) -> tuple[Array, int]:
    """Return samples (K, channels) and the sample rate."""
    check(
        isinstance(path, str) and path != "",
        NAME,
        path,
        allowed="a WAV or FLAC file",
        hint="give it",
    )
    try:
        import soundfile
    except ImportError:
        raise BadValue(f"{NAME}={path}: needs soundfile; pip install 'echolearn[lab]'") from None
    check(
        Path(str(path)).is_file(),
        NAME,
        path,
        allowed="a file",
        hint=f"is it relative to {Path.cwd()}?",
    )
    try:
        samples, rate = soundfile.read(path, dtype="float64", always_2d=True)
    except (RuntimeError, TypeError, ValueError) as error:
        raise BadValue(
            f"{NAME}={path}: cannot be read as audio ({' '.join(str(error).split())})"
        ) from None
    check(len(samples) > 0, NAME, f"{path}, no samples", allowed="a recording")
    return samples, int(rate)


def _choose(samples: Array, channel: int | str | None) -> Array:
    """Return one channel of samples (K, channels), or their mean."""
    count = samples.shape[1]
    known = f"1 to {count}, or mix"
    if channel == "mix":
        return samples.mean(axis=1)
    if channel is None:
        check(
            count == 1,
            "diffuse.source.channel",
            "none",
            allowed=f"{known}; the file has {count} channels",
        )
        return samples[:, 0]
    whole = isinstance(channel, int) and not isinstance(channel, bool)
    check(whole and 1 <= int(channel) <= count, "diffuse.source.channel", channel, allowed=known)
    return samples[:, int(channel) - 1]
