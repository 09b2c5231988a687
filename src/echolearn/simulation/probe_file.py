"""A probe from the user's own file, as a robot plays it."""

from pathlib import Path

from echolearn.acoustics.types import Probe
from echolearn.checks import check
from echolearn.survey import audio


def probe_file(path: str | None, *, length: int = 20000, sample_rate: float = 22050.0) -> Probe:
    """Return the burst of a WAV file, zero-padded.

    Args:
        path: file of one channel; silence after the burst is left out.
        length: N, samples recorded.
        sample_rate: in Hz, that of the file.

    Raises:
        BadValue: no such file, one of another rate or of several channels, silence, or a burst
            longer than the recording.
    """
    name = "probe.path"
    hint = "scene.probe.path=<file>"
    given = isinstance(path, str) and path != ""
    check(given, name, path, allowed="must be a WAV file", hint=hint)
    samples = audio.read_wav(Path(str(path)), sample_rate)
    channels = len(samples)
    hint = "sox in.wav out.wav remix 1"
    check(channels == 1, name, f"{channels} channels", allowed="must have one channel", hint=hint)
    return Probe(audio.burst_of(samples, name=str(path)), sample_rate, length)
