"""Surveys by a simulator that shares no line with this one: the generator of Habets, at 44.1 kHz,
in int16.

Turning, delaying and convolving are done here once more, by hand; of the project come only the
burst that the bundle wants and the path of the walk.
"""

import numpy as np
import pytest
import yaml
from scipy.io import wavfile
from scipy.signal import fftconvolve

from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.robot.survey_map import map_survey
from echolearn.simulation.walk import trajectory
from world import plans

rir_generator = pytest.importorskip("rir_generator")

RATE = 44_100
LENGTH = 12_000
"""Samples of a recording."""

RESPONSE = 7_000
"""Samples of a response: what follows is 30 dB below."""

ROOM = (6.0, 5.0, 7.0)
"""m, of which floor and ceiling are out of reach."""

T60 = 0.3

TURN = np.radians(-50.0)
"""How the array is mounted."""

NAMES = np.random.default_rng(0).permutation(1000)
"""What poses are called."""


def turned(places, angle):
    """Return places (M, 3) turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return places @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


ANGLES = np.arange(6) * np.pi / 3
MICROPHONES = turned(0.2 * np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1), TURN)
"""In the robot's frame, m."""


def burst():
    """Return the bundle's burst at twice its rate, by zeros in its spectrum."""
    samples = plans()[0].scene.probe.samples
    return np.fft.irfft(np.fft.rfft(samples, 2048), 4096)[: 2 * len(samples)] * 2


def received(emitted, pose, *, order):
    """Return what arrives of a burst at the microphones, (6, LENGTH); of order 0 in free space."""
    places = turned(MICROPHONES, pose.heading) + pose.position
    about = {"c": 343.0, "fs": RATE, "r": places, "s": pose.position, "L": [*ROOM]}
    responses = rir_generator.generate(
        **about, nsample=RESPONSE, reverberation_time=T60, order=order, hp_filter=False
    )
    arrived = fftconvolve(responses.T, emitted[None], axes=1)[:, :LENGTH]
    return np.pad(arrived, ((0, 0), (0, LENGTH - arrived.shape[1])))


def record(folder, poses, *, snr_db):
    """Write a survey, its noise at an SNR below the echoes; the loudest sample is 0.9."""
    (folder / "observations").mkdir(parents=True)
    emitted = burst()
    lines = ["index,x_m,y_m,z_m,heading_rad,file"]
    for index, pose in enumerate(poses):
        samples, direct = (received(emitted, pose, order=order) for order in (-1, 0))
        noise = np.random.default_rng(index).standard_normal(samples.shape)
        noise *= np.sqrt(np.mean((samples - direct) ** 2) / 10 ** (snr_db / 10))
        samples = samples + noise
        whole = np.rint(samples.T * (0.9 * 32767 / np.abs(samples).max())).astype(np.int16)
        name = f"observations/{index}.wav"
        wavfile.write(folder / name, RATE, whole)
        lines.append(",".join(map(str, [NAMES[index], *pose.position, pose.heading, name])))
    (folder / "poses.csv").write_text("\n".join(lines))
    padded = np.pad(emitted, (0, LENGTH - len(emitted))).astype(np.float32)
    wavfile.write(folder / "probe.wav", RATE, padded)
    about = {"sample_rate": RATE, "speed_of_sound": 343.0, "microphones": MICROPHONES.tolist()}
    about |= {"loudspeaker": [0.0, 0.0, 0.0], "direct_path": "present"}
    (folder / "survey.yaml").write_text(yaml.safe_dump(about))


def test_another_simulators_survey_is_mapped(packed, tmp_path):
    """Twelve places along the walls, one echo each, at 10 dB: nearly all that is kept is on one."""
    record(tmp_path / "walk", trajectory(Room(ROOM, T60), poses=60)[:24:2], snr_db=10.0)
    with pytest.raises(BadValue, match="resample with resample=true"):
        map_survey(survey=tmp_path / "walk", bundle=packed, runs=tmp_path)
    made = map_survey(survey=tmp_path / "walk", bundle=packed, runs=tmp_path, resample=True)
    table = np.genfromtxt(made / "map.csv", delimiter=",", names=True)
    assert table["index"].tolist() == NAMES[:12].tolist()
    x, y = (table[name][table["kept"] == 1] for name in ("x_m", "y_m"))
    off = np.abs([x, y, ROOM[0] - x, ROOM[1] - y]).min(axis=0)
    assert len(off) >= 9
    assert np.mean(off <= 0.10) >= 0.9 and np.median(off) < 0.02
