"""`import`: published measurements as a recorded survey, with their truth, licence and attribution.

    source, folder --read--> Measurements --takes--> recordings, poses, truth --> manifest

Beside the files of the format stands `imported.json`, what the survey is made from: the responses
by their digests, the protocol, the probe, the level and the draw of the noise.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Probe
from echolearn.checks import check_name, check_number, check_whole
from echolearn.runtime.progress import track
from echolearn.storage import journal
from echolearn.storage.identity import plain
from echolearn.survey import audio
from echolearn.survey.description import description_bytes
from echolearn.survey.making import made_once
from echolearn.survey.measured import MeasuredSource, Measurements
from echolearn.survey.poses import APART, poses_csv
from echolearn.survey.protocols import Take, described, recorded_take, takes
from echolearn.survey.truth import TRUTH, truth_csv

BEGUN = "imported.json"
"""Written first: what the survey is made from, and the sign that it was imported."""


def import_survey(
    *,
    name: str,
    source: MeasuredSource,
    folder: Path | None,
    probe: Probe,
    protocol: str = "pose",
    snr_db: float | None = 10.0,
    draw: int = 0,
    runs: Path,
    command: str | None = None,
) -> Path:
    """Import published measurements as a recorded survey, and return its folder; once made, kept.

    Args:
        name: names the folder under `runs/survey`.
        source: reads the published set.
        folder: where that lies; None takes what comes with echolearn.
        probe: burst that a robot would emit, its rate, and the length of recordings.
        protocol: one of `protocols.PROTOCOLS`.
        snr_db: level of the direct sound 0.2 m from the loudspeaker over white noise; None adds
            none.
        draw: seed of the noise; recordings differ, levels do not.
        runs: folder of everything generated.
        command: what imports them again, for the manifest; None says nothing about it.

    Raises:
        BadValue: values out of range, a copy of the set that is wrong or broken, or a survey of
            that name made otherwise.
    """
    check_name("name", name)
    check_whole("draw", draw, low=0)
    if snr_db is not None:
        check_number("snr_db", snr_db, low=-100.0, high=100.0, unit="dB")
    measured = source.read(folder)
    made = takes(measured, protocol)
    level = None if snr_db is None else float(snr_db)
    asked = {"protocol": protocol, "probe": probe, "snr_db": level, "draw": draw}
    about = {"kind": "survey", "made_from": plain(_origin(measured) | asked)}

    print(f"{measured.name}: {measured.remark}; {len(made)} recordings", flush=True)
    contents = partial(_contents, made, measured, probe=probe, snr_db=level, draw=draw)
    place = Path(runs) / "survey" / name
    return made_once(place, about, begun=BEGUN, contents=contents, command=command)


def _origin(measured: Measurements) -> dict[str, Any]:
    """Return what tells measurements from all others."""
    # By their bytes, not by where they lie: another copy of the set makes the same survey.
    responses = [each.samples for each in measured.responses]
    return {"source": measured.name, "credits": measured.credits, "responses": responses}


def _contents(
    made: Sequence[Take],
    measured: Measurements,
    *,
    probe: Probe,
    snr_db: float | None,
    draw: int,
) -> Iterator[journal.Content]:
    """Yield the files of a survey one after the other, each as its name and what makes it."""

    def recording(index: int, take: Take) -> bytes:
        """Return a recording as a file."""
        rng = stream(draw, "observation", index)
        samples = recorded_take(take, measured, probe=probe, snr_db=snr_db, rng=rng)
        return audio.wav_bytes(samples, probe.sample_rate)

    names = []
    # Recordings come first, as they take the time: whoever is killed has lost one of them.
    for index, take in enumerate(track(made, "import", unit="recordings")):
        names.append(f"observations/{index:04d}.wav")
        yield names[-1], partial(recording, index, take)

    gated = all(take.gated for take in made)
    further = described(made) if gated else described(made) | _loudspeakers(made)
    yield (
        "poses.csv",
        partial(poses_csv, [take.response.pose for take in made], names, further=further),
    )
    yield TRUTH, partial(truth_csv, [take.truth(measured.speed_of_sound) for take in made])
    padded = np.pad(probe.samples, (0, probe.length - len(probe.samples)))
    yield "probe.wav", partial(audio.wav_bytes, padded, probe.sample_rate)
    yield (
        "survey.yaml",
        partial(
            description_bytes,
            measured.array,
            probe,
            speed_of_sound=measured.speed_of_sound,
            walls=None,
            conditions=_conditions(made, measured, snr_db=snr_db, draw=draw),
            direct_path="removed" if gated else "present",
            mapped=False,
        ),
    )


def _loudspeakers(made: Sequence[Take]) -> dict[str, list[float]]:
    """Return the columns of a loudspeaker that stands on its own, in the room's frame."""
    places = []
    for take in made:
        pose = take.response.pose
        x, y, z = take.response.loudspeaker
        cos, sin = np.cos(pose.heading), np.sin(pose.heading)
        places.append(pose.position + [cos * x - sin * y, sin * x + cos * y, z])
    return {name: column.tolist() for name, column in zip(APART, np.array(places).T, strict=True)}


def _conditions(
    made: Sequence[Take], measured: Measurements, *, snr_db: float | None, draw: int
) -> dict[str, Any]:
    """Return what is known of the recordings: level, room, and what the licence wants told."""
    states = list(dict.fromkeys(take.response.condition for take in made))
    protocol = "pose" if made[0].gated else "none"
    changes = "convolved with a burst, resampled, white noise added; protocol " + protocol
    return {
        "snr_db": snr_db,
        "noise": "none" if snr_db is None else "white",
        "room": f"{measured.name} {'+'.join(states)}",
        "source": measured.name,
        "protocol": protocol,
        "draw": draw,
        **measured.credits,
        "changes": changes,
    }
