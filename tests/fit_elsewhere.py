"""`fit` on a walk by another simulator: `python tests/fit_elsewhere.py FOLDER [words of fit]`.

pyroomacoustics makes an L of 2.6 m height, its first echoes by image sources and the rest by rays,
and 40 poses of an octahedron of unequal microphones in it, 0 dB of white noise below the echoes.
`echolearn fit aim='precision 0.95'` is given the folder alone. Printed are precision, retention and
walls of the map beside the true outline; a wall is heard if at least six poses have it in the
window and stand before it.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyroomacoustics
import yaml
from scipy.io import wavfile
from scipy.signal import fftconvolve

from echolearn.acoustics.geometry import microphone_positions
from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.probes import sweep_probe
from echolearn.acoustics.types import MicArray
from echolearn.cli.main import main
from echolearn.simulation.walk import trajectory
from echolearn.storage import manifests

ROOM = PolygonRoom(((0, 0), (7, 0), (7, 3.2), (4, 3.2), (4, 7), (0, 7)), height=2.6, t60=0.6)
OCTAHEDRON = 0.048 * np.concatenate([np.eye(3), -np.eye(3)])
GAINS_DB = np.array([0.0, -2.0, 1.5, 3.0, -1.0, 0.5])
PROBE = sweep_probe(law="exponential", low=200.0, high=10000.0, seconds=0.068, length=20000)
POSES = 40
HEIGHT = 0.5
"""m of the loudspeaker. Half-way up, echoes of floor and ceiling would come at once, and together
sound as one from the side."""

ORDER = 3
SNR_DB = 0.0
WINDOW = (1.0, 2.0)
FEWEST = 6


def received(places, position, *, order):
    """Return what arrives at the microphones (6, 3), shape (6, N), of order 0 in free space."""
    absorbed = pyroomacoustics.Material(float(1.0 - ROOM.reflection(343.0)[0] ** 2), 0.02)
    corners = np.array(ROOM.corners).T
    about = {"fs": int(PROBE.sample_rate), "max_order": order, "materials": absorbed}
    built = pyroomacoustics.Room.from_corners(corners, ray_tracing=order > 0, **about)
    built.extrude(ROOM.height, materials=absorbed)
    built.add_source(position)
    built.add_microphone_array(places.T)
    built.compute_rir()
    ahead = pyroomacoustics.constants.get("frac_delay_length") // 2
    samples = np.zeros((len(places), PROBE.length))
    for heard, [response] in zip(samples, built.rir, strict=True):
        whole = fftconvolve(response[ahead:], PROBE.samples)[: PROBE.length]
        heard[: len(whole)] = whole
    return samples


def record(folder, poses):
    """Write the survey."""
    (folder / "observations").mkdir(parents=True)
    array = MicArray(OCTAHEDRON)
    rows = ["index,x_m,y_m,z_m,heading_rad,file"]
    for index, pose in enumerate(poses):
        places = microphone_positions(array, pose)
        samples = received(places, pose.position, order=ORDER)
        echoes = samples - received(places, pose.position, order=0)
        noise = np.random.default_rng(index).standard_normal(samples.shape)
        samples += noise * np.sqrt(np.mean(echoes**2) / 10 ** (SNR_DB / 10))
        samples *= 10 ** (GAINS_DB[:, None] / 20)
        name = f"observations/{index:02}.wav"
        scaled = (samples.T / np.abs(samples).max()).astype(np.float32)
        wavfile.write(folder / name, int(PROBE.sample_rate), scaled)
        rows.append(",".join(map(str, [index, *pose.position, pose.heading, name])))
    (folder / "poses.csv").write_text("\n".join(rows))
    padded = np.pad(PROBE.samples, (0, PROBE.length - len(PROBE.samples)))
    wavfile.write(folder / "probe.wav", int(PROBE.sample_rate), padded.astype(np.float32))
    about = {"sample_rate": PROBE.sample_rate, "speed_of_sound": 343.0}
    about |= {"microphones": OCTAHEDRON.tolist(), "loudspeaker": [0.0, 0.0, 0.0]}
    about |= {"direct_path": "present", "walls": [[*map(float, each)] for each in ROOM.corners]}
    (folder / "survey.yaml").write_text(yaml.safe_dump(about))


def sides():
    """Return the walls as normals out of the room, offsets, and both ends along them."""
    corners = np.array(ROOM.corners, dtype=float)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        normal = np.array([along[1], -along[0]])
        yield normal, float(normal @ start), along, sorted([along @ start, along @ end])


def walked():
    """Return the poses, from wall to wall at the robot's height."""
    poses = trajectory(ROOM, poses=POSES)
    return [replace(pose, position=[*pose.position[:2], HEIGHT]) for pose in poses]


def told(walls, poses):
    """Print each wall, how many poses hear it, and by which fitted line it was found."""
    places = np.array([pose.position[:2] for pose in poses])
    matched = set()
    for normal, offset, along, (low, high) in sides():
        away = offset - places @ normal
        foot = places @ along
        heard = (away >= WINDOW[0]) & (away <= WINDOW[1]) & (foot >= low) & (foot <= high)
        same = np.cos(walls["normal_rad"] - np.arctan2(*normal[::-1])) > np.cos(np.radians(5.0))
        middle = np.stack([walls["x0_m"] + walls["x1_m"], walls["y0_m"] + walls["y1_m"]], 1) / 2
        inside = (middle @ along > low - 0.1) & (middle @ along < high + 0.1)
        found = same & inside & (np.abs(middle @ normal - offset) < 0.1)
        matched |= {*np.flatnonzero(found).tolist()}
        kind = "to be found" if heard.sum() >= FEWEST else "heard too seldom"
        print(f"wall {normal.round()}: {heard.sum()} poses, {kind}, found {bool(found.any())}")
    print(f"lines that are no wall: {len(walls) - len(matched)} of {len(walls)}")


def show(place, words):
    """Make the walk, fit, and print what came of it."""
    folder = place / "elsewhere"
    poses = walked()
    if not folder.exists():
        record(folder, poses)
    runs = place / "runs"
    aim = "aim=precision 0.95"
    assert main(["fit", f"survey={folder}", f"runs={runs}", aim, *words]) == 0
    made = manifests.load_manifest(runs / "fit" / "elsewhere")["parts"]["map"]
    table = np.genfromtxt(runs / "maps" / made / "walls.csv", delimiter=",", names=True)
    told(np.atleast_1d(table), poses)


if __name__ == "__main__":
    show(Path(sys.argv[1]), sys.argv[2:])
