"""Small worlds that many tests share: the paper's robot, a live room, and what is heard in a corner
of it."""

import os
from dataclasses import replace

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

import world as small
from children import may_be_copied
from echolearn.acoustics import signals
from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Observation, Pose, Room
from echolearn.comparison.compare import compare
from echolearn.runtime import processes
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import add_noise
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.scene import Scene

# How long an example takes tells of the machine; examples write anew what fixtures let them share.
settings.register_profile(
    "any machine",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("any machine")


@pytest.fixture(scope="session", autouse=True)
def shared(tmp_path_factory):
    """Return a folder that all processes of these tests have in common, with what they know of
    this machine's bundles."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        yield folder


@pytest.fixture(scope="session", autouse=True)
def forked():
    """Let worker processes be copies of this one, which has loaded what takes them a second."""
    with pytest.MonkeyPatch.context() as patch:
        # Copies of one that computes with many threads would wait for those for ever.
        if may_be_copied() and os.environ.get("OMP_NUM_THREADS") == "1":
            patch.setattr(processes, "_can_be_forked", lambda: True)
        yield


@pytest.fixture
def anew(monkeypatch):
    """Let worker processes begin with nothing, as commands begin them that have run threads."""
    monkeypatch.setattr(processes, "_can_be_forked", lambda: False)


@pytest.fixture(scope="session")
def scene():
    """Return the paper's robot: six microphones, 1 500 samples of noise in 20 000."""
    return Scene(circular_array(), noise_probe(), Pyroom(), White())


@pytest.fixture(scope="session")
def brief():
    """Return the same robot with recordings of 8 000 samples, for speed."""
    return Scene(circular_array(), noise_probe(length=8000), Pyroom(), White())


@pytest.fixture(scope="session")
def chamber():
    """Return a small room with a short reverberation."""
    return Room((6.0, 5.0, 4.0), 0.2)


@pytest.fixture(scope="session")
def study():
    """Return the paper's SNR study: 10 x 8 x 5 m, 1.0 and 1.5 m from two walls, microphone 1 at 90
    degrees."""
    return Room((10.0, 8.0, 5.0), 0.6), Pose(np.array([1.0, 1.5, 2.4]), np.pi / 2)


@pytest.fixture(scope="session")
def beside():
    """Return the same room with one wall within 2 m, 1 m behind the robot."""
    return Room((10.0, 8.0, 5.0), 0.6), Pose(np.array([1.0, 4.1, 2.4]))


@pytest.fixture(scope="session")
def hear(scene):
    """Return a function that hears a place `trials` times at an SNR, each time with fresh noise."""
    responses = {}

    def heard(place, *, snr_db, trials, probe=0):
        room, pose = place
        key = (*pose.position, pose.heading)
        if key not in responses:
            places = microphone_positions(scene.array, pose)
            responses[key] = scene.rir(
                room, pose.position, microphones=places, sample_rate=22050.0, speed_of_sound=343.0
            )
        robot = replace(scene, probe=noise_probe(seed=probe))
        received = signals.convolve(robot.probe.samples, responses[key], length=robot.probe.length)
        draws = (np.random.default_rng([probe, trial]) for trial in range(trials))
        levels = NoiseLevels(snr_db)
        samples = [add_noise(received, robot, levels=levels, rng=rng) for rng in draws]
        return Observation(np.stack(samples), robot.probe, robot.array)

    return heard


@pytest.fixture(scope="session")
def world(shared):
    """Return a small world, made by the first process that needs it; not to be changed."""
    with FileLock(shared / "world.lock"):
        return small.make(shared / "world")


@pytest.fixture(scope="session")
def comparison(world):
    """Return its comparison, evaluated as `compare` does, by two processes."""
    return small.evaluated(world)


@pytest.fixture(scope="session")
def compared(world, shared):
    """Return the folder of the world's comparison, made by one process; not to be changed."""
    with FileLock(shared / "compared.lock"):
        return compare(name="small", workers=1, **world.arguments)


@pytest.fixture(scope="session")
def packed(world, tmp_path_factory):
    """Return the bundle of the world's trees; not to be changed."""
    return small.pack(world, "trees_features", tmp_path_factory.mktemp("packed"))
