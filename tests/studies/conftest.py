"""A study that takes a second, and its folder."""

import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.studies.run import run_study
from echolearn.studies.study import Study


@pytest.fixture(scope="session")
def small():
    """Return a study of three levels and two localizers."""
    scene = Scene(circular_array(), noise_probe(length=8000), Images(), White())
    localizers = {"gated": Gated(azimuths=36), "joint": Joint(azimuths=36)}
    room = Room((6.0, 5.0, 6.0), 0.25)
    return Study("snr_db", [-30.0, 0.0, 10.0], room, scene, localizers, positions=4, trials=12)


@pytest.fixture(scope="session")
def folder(small, tmp_path_factory):
    """Return its folder; not to be changed."""
    runs = tmp_path_factory.mktemp("runs")
    command = "echolearn study runs=/tmp/x name=small"
    return run_study(small, name="small", runs=runs, resamples=50, command=command)
