"""Audio files of surveys: WAV by SciPy, FLAC by soundfile where it is installed.

    float32 or PCM of 8, 16, 24 or 32 bits  ->  float64, shape (M, N), PCM scaled to -1 ... 1

A file from a stranger is data: its size is limited, and of FLAC, which packs an hour of silence
    into a page, what the
header declares is compared with what is wanted before anything is unpacked. FLAC has a checksum in
every frame, so a flipped bit is an error there; in WAV it is noise.
"""

import shlex
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import wavfile

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check

LARGEST = 64 << 20
"""Bytes that an audio file may have."""


def read(path: Path, sample_rate: float, *, shape: tuple[int, int]) -> Array:
    """Return a recording's samples as float64, shape (M, N); a name that ends in .flac is FLAC, all
    others are WAV.

    Args:
        path: the file.
        sample_rate: that it must have, in Hz.
        shape: that it must have, (M, N).

    Raises:
        BadValue: as `read_wav` and `read_flac`, or another number of channels or samples.
    """
    check_size(path, min(LARGEST, 8 * shape[0] * shape[1] + 65536))
    if path.suffix.lower() == ".flac":
        return read_flac(path, sample_rate, shape=shape)
    samples = read_wav(path, sample_rate)
    _check_shape(path, samples.shape, shape)
    return samples


def read_wav(path: Path, sample_rate: float) -> Array:
    """Return a WAV file's samples as float64, shape (M, N).

    Raises:
        BadValue: not a WAV file, it ends before its header says so, its sample rate is not
            `sample_rate` Hz, or it holds NaN.
    """
    check_size(path, LARGEST)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", wavfile.WavFileWarning
            )  # of chunks besides format and data
            warnings.filterwarnings("error", "Reached EOF prematurely", wavfile.WavFileWarning)
            rate, samples = wavfile.read(path)
    except Exception as error:  # scipy answers a damaged header with whatever its parser trips over
        raise BadValue(f"{path}: cannot be read as WAV ({' '.join(str(error).split())})") from None
    _check_rate(path, rate, sample_rate)
    check(bool(np.isfinite(samples).all()), str(path), "NaN or infinity", allowed="finite samples")
    return np.atleast_2d(scaled(samples).T)


def read_flac(path: Path, sample_rate: float, *, shape: tuple[int, int]) -> Array:
    """Return a FLAC file's samples as float64, shape (M, N).

    Raises:
        BadValue: soundfile is not installed; not FLAC, damaged, or declared to have another sample
            rate, number of channels or length than wanted.
    """
    try:
        import soundfile
    except (ImportError, OSError):  # the latter where it comes without its library
        unpack = f"flac -d {shlex.quote(path.name)}, and name the WAV in poses.csv"
        raise BadValue(
            f"{path}: FLAC needs soundfile; pip install soundfile, or: {unpack}"
        ) from None
    try:
        with path.open("rb") as file:
            check(
                file.read(4) == b"fLaC",
                str(path),
                "no FLAC",
                allowed="a FLAC file; other names are read as WAV",
            )
            file.seek(0)
            with soundfile.SoundFile(file) as held:
                samples = _unpacked(held, path, sample_rate=sample_rate, shape=shape)
    except BadValue:
        raise
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise BadValue(f"{path}: cannot be read as FLAC ({' '.join(str(error).split())})") from None
    _check_shape(path, samples.shape, shape)
    return samples


def _unpacked(held: Any, path: Path, *, sample_rate: float, shape: tuple[int, int]) -> Array:
    """Return the samples (M, N) of an open sound file whose header declares what is wanted."""
    _check_rate(path, held.samplerate, sample_rate)
    _check_shape(path, (held.channels, held.frames), shape)
    samples: Array = held.read(dtype="float64", always_2d=True).T
    return np.ascontiguousarray(samples)


def _check_rate(path: Path, rate: float, wanted: float) -> None:
    allowed, hint = f"{wanted:g} Hz", "resample the recording"
    check(rate == wanted, f"{path} sample_rate", f"{rate} Hz", allowed=allowed, hint=hint)


def _check_shape(path: Path, shape: tuple[int, ...], wanted: tuple[int, int]) -> None:
    check(shape == wanted, str(path), shape, allowed=f"{wanted[0]} channels of {wanted[1]} samples")


def check_size(path: Path, limit: int) -> None:
    """Raise `BadValue` if a file is too large or no plain file; one that is missing is left to its
    reader.
    """
    if path.exists():
        check(path.is_file(), str(path), "no plain file", allowed="a file")
        size = path.stat().st_size
        check(size <= limit, str(path), f"{size} bytes", allowed=f"at most {limit} bytes")


def longest(channels: int) -> int:
    """Return how many samples of so many channels a WAV file of float32 holds that is not too large
    to be read.
    """
    return (LARGEST - 4096) // (4 * channels)  # headers take less


def scaled(samples: Array) -> Array:
    """Return samples as float64, PCM of any width scaled to -1 ... 1; that of 8 bits is unsigned
    around 128.
    """
    if samples.dtype.kind not in "iu":
        return samples.astype(float)
    half = 2.0 ** (8 * samples.dtype.itemsize - 1)
    found: Array = samples.astype(float)
    found -= half if samples.dtype.kind == "u" else 0.0
    found /= half
    return found


def wav_bytes(samples: Array, sample_rate: float) -> bytes:
    """Return `samples` (M, N) or (N,) as a float32 WAV file."""
    buffer = BytesIO()
    wavfile.write(buffer, round(sample_rate), np.ascontiguousarray(samples.T, dtype=np.float32))
    return buffer.getvalue()
