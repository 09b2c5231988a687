"""Audio files of surveys: WAV (`wav.py`), FLAC by soundfile where it is installed.

    float or PCM of 8 to 64 bits  ->  float64, shape (M, N), PCM scaled to -1 ... 1

A file from a stranger is data: its size is limited, and of FLAC, which packs an hour of silence
into a page, what the header declares is compared with what is wanted before anything is unpacked.
FLAC has a checksum in every frame, so a flipped bit is an error there; in WAV it is noise.
"""

from collections.abc import Iterator
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line
from echolearn.survey import wav

LARGEST = 64 << 20
"""Bytes that an audio file may have."""

LOUDEST = 1e12
LOUD = "is it in another format than its header says?"
"""What samples may reach, whose squares and products a computer still holds, and what to ask."""

MORE = "has it more channels than survey.yaml has microphones, or is it longer than probe.wav?"
SHORTER = "did the recorder stop early? probe.wav is as long as a recording"
LONGER = "probe.wav is as long as a recording: pad it with silence, or cut the recordings"
FEWER = "are files of some microphones elsewhere?"
BESIDE = "are loopbacks or unused inputs among them? survey.yaml has fewer microphones"
"""What to ask where a recording has another shape than is wanted."""

HEADERS = 1 << 16
"""Bytes besides its samples that a recording may have."""


def read_recording(path: Path, sample_rate: float, *, shape: tuple[int, int]) -> Array:
    """Return a recording's samples as float64, shape (M, N).

    Args:
        path: the file; a name that ends in .flac is FLAC, all others are WAV.
        sample_rate: sample rate that it must have, in Hz.
        shape: shape (M, N) that it must have.

    Raises:
        BadValue: as `read_wav` and `read_flac`, or another number of channels or samples.
    """
    # No sample has more than 8 bytes, so a larger file cannot be what is wanted.
    check_size(path, min(LARGEST, 8 * shape[0] * shape[1] + HEADERS), hint=MORE)
    if path.suffix.lower() == ".flac":
        samples = read_flac(path, sample_rate, shape=shape)
    else:
        samples = read_wav(path, sample_rate)
    _check_shape(path, samples.shape, wanted=shape)
    return samples


def read_wav(path: Path, sample_rate: float) -> Array:
    """Return a WAV file's samples as float64, shape (M, N).

    Raises:
        BadValue: as `wav_samples`, or the file is absent or too large.
    """
    return wav_samples(_content(path), sample_rate, name=str(path))


def _content(path: Path) -> bytes:
    """Return the bytes of an audio file, or raise `BadValue`."""
    check_size(path, LARGEST)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise _absent(path) from None
    except OSError as error:
        raise BadValue(f"{path}: cannot be read as WAV ({one_line(error)})") from None


def _absent(path: Path) -> BadValue:
    """Return the complaint about a file that is not there, and where it may be."""
    kind = "FLAC" if path.suffix.lower() == ".flac" else "WAV"
    return BadValue(f"{path}: cannot be read as {kind} (there is no such file{_elsewhere(path)})")


def _elsewhere(path: Path) -> str:
    """Return where a file may be that is not where it is said to be, to be asked."""
    if "\\" in path.name:
        return "; names are written with / between folders"
    beside = [path.parent / "observations", *path.parents[:2]]
    named = [place / f"{path.name}{ending}" for place in beside for ending in ("", ".wav", ".flac")]
    found = [each for each in named if each.is_file()] or _alike(path)
    return f"; is it {found[0]}?" if found else ""


def _alike(path: Path) -> list[Path]:
    """Return the files beside a path whose names are its own but for case and blanks."""
    wanted = path.name.strip().casefold()
    try:
        return [each for each in path.parent.iterdir() if each.name.strip().casefold() == wanted]
    except OSError:
        return []


def wav_pieces(path: Path, sample_rate: float, *, samples: int) -> Iterator[Array]:
    """Yield the samples (M, n) of a WAV file in pieces, as float64: 8 times what 8 bits take.

    Args:
        path: the file.
        sample_rate: sample rate that it must have, in Hz.
        samples: least number n of samples in a piece; all have fewer than twice as many.

    Raises:
        BadValue: as `read_wav`.
    """
    content = _content(path)
    try:
        whole = wav.length(content)
    except ValueError as error:
        raise BadValue(f"{path}: cannot be read as WAV ({one_line(error)})") from None
    count = max(1, whole // samples)
    ends = [whole * piece // count for piece in range(count + 1)]
    for start, stop in pairwise(ends):
        yield wav_samples(content, sample_rate, name=str(path), start=start, stop=stop)


def wav_samples(
    content: bytes, sample_rate: float, *, name: str, start: int = 0, stop: int | None = None
) -> Array:
    """Return the samples of WAV as float64, shape (M, N).

    Args:
        content: of a file.
        sample_rate: sample rate that it must have, in Hz.
        name: name of the file in errors.
        start, stop: the first sample that is wanted, and the one after the last.

    Raises:
        BadValue: no WAV, it ends before its header says so, it has another sample rate, or NaN.
    """
    try:
        rate, samples = wav.read(content, start=start, stop=stop)
    except ValueError as error:
        raise BadValue(f"{name}: cannot be read as WAV ({one_line(error)})") from None
    _check_rate(name, rate, wanted=sample_rate)
    finite = bool(np.isfinite(samples).all())
    check(finite, name, "NaN or infinity", allowed="must be finite samples", hint=LOUD)
    loudest = np.abs(samples).max(initial=0.0)
    allowed = f"must be samples of at most {LOUDEST:g}; full scale is 1"
    check(loudest <= LOUDEST, name, f"{loudest:g}", allowed=allowed, hint=LOUD)
    return samples


def burst_of(samples: Array, *, name: str) -> Array:
    """Return the burst of a probe (1, N), shape (L,): without the silence up to N.

    Raises:
        BadValue: several channels, or nothing but silence; names the file.
    """
    allowed = "must be the one channel that the loudspeaker played"
    hint = "is it stereo? sox in.wav out.wav remix 1 keeps the first"
    check(len(samples) == 1, name, f"{len(samples)} channels", allowed=allowed, hint=hint)
    sounding = np.flatnonzero(samples[0])
    check(len(sounding) > 0, name, "silence", allowed="must be the burst that was emitted")
    return samples[0, : sounding[-1] + 1]


def read_flac(path: Path, sample_rate: float, *, shape: tuple[int, int]) -> Array:
    """Return a FLAC file's samples as float64, shape (M, N).

    Args:
        path: the file.
        sample_rate: sample rate that it must have, in Hz.
        shape: shape (M, N) that it must declare.

    Raises:
        BadValue: soundfile is not installed; not FLAC, damaged, or declared to have another sample
            rate, number of channels or length than wanted.
    """
    try:
        import soundfile
    except (ImportError, OSError):  # the latter where it comes without its library
        mend = "pip install soundfile, or unpack it, flac -d, and name the WAV in poses.csv"
        raise BadValue(f"{path}: FLAC needs soundfile; {mend}") from None
    try:
        with path.open("rb") as file:
            # soundfile goes by content, and would open whatever format it knows.
            allowed = "must be a FLAC file; other names are read as WAV"
            check(file.read(4) == b"fLaC", str(path), "no FLAC", allowed=allowed)
            file.seek(0)
            with soundfile.SoundFile(file) as held:
                _check_rate(str(path), held.samplerate, wanted=sample_rate)
                _check_shape(path, (held.channels, held.frames), wanted=shape)
                samples: Array = held.read(dtype="float64", always_2d=True).T
    except BadValue:
        raise
    except FileNotFoundError:
        raise _absent(path) from None
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise BadValue(f"{path}: cannot be read as FLAC ({one_line(error)})") from None
    return np.ascontiguousarray(samples)


def _check_rate(name: str, rate: float, *, wanted: float) -> None:
    name = f"{name} sample_rate"
    hint = "resample the recording, unless survey.yaml is wrong"
    check(rate == wanted, name, f"{rate} Hz", allowed=f"must be {wanted:g} Hz", hint=hint)


def _check_shape(path: Path, shape: tuple[int, ...], *, wanted: tuple[int, int]) -> None:
    if shape[0] != wanted[0]:
        hint = BESIDE if shape[0] > wanted[0] else FEWER
    else:
        hint = LONGER if shape[1] > wanted[1] else SHORTER
    allowed = f"must be {wanted[0]} channels of {wanted[1]} samples"
    check(shape == wanted, str(path), shape, allowed=allowed, hint=hint)


def undecided_words(path: Path) -> NDArray[Any] | None:
    """Return words of a file that do not tell their bits, None of all other files.

    What is missing or damaged is left to its reader.
    """
    if path.suffix.lower() == ".flac" or not path.is_file():
        return None
    check_size(path, LARGEST)
    try:
        return wav.undecided(path.read_bytes())
    except (OSError, ValueError):
        return None


def check_size(path: Path, limit: int, *, hint: str = "") -> None:
    """Raise `BadValue` if a file is too large or no plain file.

    One that is missing is left to its reader.

    Args:
        path: of the file.
        limit: largest size, in bytes.
        hint: what to do about a larger one.
    """
    if path.exists():
        check(path.is_file(), str(path), "no plain file", allowed="must be a file")
        size = path.stat().st_size
        allowed = f"must be at most {limit} bytes"
        check(size <= limit, str(path), f"{size} bytes", allowed=allowed, hint=hint)


def longest(channels: int) -> int:
    """Return how many samples of so many channels a float32 WAV file can hold that may be read."""
    return (LARGEST - 4096) // (4 * channels)  # headers take less


def wav_bytes(samples: Array, sample_rate: float) -> bytes:
    """Return `samples` (M, N) or (N,) as a float32 WAV file."""
    buffer = BytesIO()
    wavfile.write(buffer, round(sample_rate), np.ascontiguousarray(samples.T, dtype=np.float32))
    return buffer.getvalue()
