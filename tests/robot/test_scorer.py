"""A bundle at work: the laboratory's confidences and points, in a process that has nothing else."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray
from echolearn.checks import BadValue
from echolearn.classifiers.inputs import stack_inputs
from echolearn.comparison.localized import localize_survey
from echolearn.robot.scorer import BLOCK, load
from echolearn.survey import reader
from echolearn.training.predictions import load_scorer, predict
from echolearn.training.runs import load_runs
from world import POSES, pack, train

WALK = "hall_0dB"


@pytest.fixture(scope="module")
def scorer(packed):
    return load(packed)


@pytest.fixture(scope="module")
def walk(world):
    return reader.read_survey(world.runs / "survey" / WALK)


@pytest.fixture(scope="module")
def observation(walk):
    return walk.observe(range(POSES))


@pytest.fixture(scope="module")
def scored(scorer, walk, observation):
    return scorer.score(observation, walk.poses)


@pytest.fixture(scope="module")
def run(world):
    [found] = [r for r in load_runs(world.runs) if r.model.classifier == "trees_features"]
    return found


def test_confidences_are_the_runs(scorer, run, world):
    x = stack_inputs(run.inputs, world.sets["offgrid_hall"])
    factors = np.geomspace(0.01, 100, 100).repeat(len(x))
    many = np.tile(x, (100, 1)) * factors[:, None]
    assert len(many) > BLOCK
    assert np.abs(scorer(many) - load_scorer(run.folder)(many)).max() <= 1e-5
    assert scorer(many[:0]).shape == (0,)


def test_points_and_confidences_are_the_laboratorys(scored, run, world):
    gated = world.arguments["localizers"]["gated"]
    folder = world.runs / "survey" / WALK
    expected = localize_survey(folder, gated, name="gated", resamples=9)
    confidence = predict(run, expected.columns)
    assert np.abs(scored.map.points - expected.points).max() <= 1e-5
    assert np.abs(scored.map.confidence - confidence).max() <= 1e-5
    assert np.array_equal(scored.map.kept, confidence >= run.threshold)
    assert 0 < scored.map.kept.sum() < POSES
    assert np.allclose(scored.echoes.toa[:, 0], expected.columns["toa"], atol=1e-12)


def test_pose_by_pose_the_same_points_come_out(scorer, scored, walk, observation):
    steps = [
        scorer.update(replace(observation, samples=observation.samples[k]), walk.poses[k])
        for k in range(POSES)
    ]
    assert {len(step.points) for step in steps} == {0, 1} and all(step.kept.all() for step in steps)
    kept = scored.map.kept
    for name in ("points", "confidence", "poses"):
        together = np.concatenate([getattr(step, name) for step in steps])
        assert np.allclose(together, getattr(scored.map, name)[kept], atol=1e-5)


def test_a_gain_and_a_softer_copy_of_the_probe_change_nothing(scorer, scored, walk, observation):
    softer = replace(observation.probe, samples=observation.probe.samples * 0.25)
    given = replace(observation, samples=3.0 * observation.samples, probe=softer)
    confidence = scorer.score(given, walk.poses).map.confidence
    assert np.allclose(confidence, scored.map.confidence, atol=1e-4)


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float16, np.float32])
def test_samples_of_any_real_dtype_give_the_points_of_floats(
    dtype, scorer, scored, walk, observation
):
    """As a sound card gives them, filling the range of 16 bits, whose squares would wrap around."""
    few = observation.samples[:4]
    samples = np.rint(30_000 / np.abs(few).max(axis=(1, 2), keepdims=True) * few).astype(dtype)
    found, expected = (
        scorer.score(replace(observation, samples=given), walk.poses[:4]).map.points
        for given in (samples, samples.astype(float))
    )
    assert np.array_equal(found, expected)
    assert np.allclose(found, scored.map.points[:4], atol=1e-3)


def test_recordings_of_another_robot_are_refused(scorer, walk, observation):
    probe, positions = observation.probe, observation.array.positions
    silent = observation.samples.copy()
    silent[3] = 0.0
    faster = {"probe": replace(probe, sample_rate=44100.0)}
    moved = {"array": MicArray(positions + np.eye(6, 3) * 0.004)}
    other = {"probe": noise_probe(seed=8, length=6000)}
    cases = {
        "bundle expects sample_rate=22050 Hz, survey has 44100 Hz; resample with": faster,
        "microphones=4: must be 6, the bundle's": {"array": circular_array(microphones=4)},
        "microphones=one is off by 4.0 mm: must be at most 1 mm": moved,
        "are the microphones in another order": {"array": MicArray(positions[::-1])},
        r"observation.samples=shape \(36, 5, 6000\)": {"samples": observation.samples[:, :5]},
        "probe=correlates .* with the bundle's: must be the same burst; play": other,
        "window.farthest=2.0 m": {"samples": observation.samples[..., :200]},
        r"^observation.samples=silence in \[3\]: must be recordings; was": {"samples": silent},
    }
    for message, changes in cases.items():
        with pytest.raises(BadValue, match=message):
            scorer.score(replace(observation, **changes), walk.poses)
    with pytest.raises(BadValue, match=r"^observation.samples=silence in \[0\]"):
        scorer.update(replace(observation, samples=silent[3].astype(np.int16)), walk.poses[3])


def test_an_array_mounted_at_an_angle_finds_the_same_walls(scorer, scored, walk, observation):
    """The same recordings by a robot whose x axis points elsewhere: the same points."""
    turn = 0.6
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    turned = replace(observation, array=MicArray(observation.array.positions @ rotation))
    poses = [replace(pose, heading=pose.heading - turn) for pose in walk.poses]
    found = scorer.score(turned, poses)
    assert np.allclose(found.map.points, scored.map.points)
    assert np.allclose(found.map.confidence, scored.map.confidence)
    difference = found.echoes.azimuth - scored.echoes.azimuth - turn
    assert np.allclose(np.exp(1j * difference), 1)


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros((3, 5)), r"shape=\(3, 5\): must be \(B, 4\) of peak_to_rms, second_to_first"),
        (np.zeros(4), "shape"),
        (np.zeros(()), "shape"),
        (np.full((1, 4), np.nan), "NaN or infinity"),
        (np.full((1, 4), 1e300), "NaN or infinity"),
    ],
)
def test_inputs_that_are_none_are_refused(scorer, x, message):
    with pytest.raises(BadValue, match=f"^inputs.*{message}"):
        scorer(x)


def test_tensors_travel_too(world, tmp_path, walk, observation):
    net = {"_target_": "echolearn.classifiers.architectures.CovarianceNet"}
    keys = {
        "_target_": "echolearn.classifiers.methods.network.Network",
        "inputs": ["covariance_steered"],
        "net": net | {"channels": 4, "layers": 1},
        "epochs": 2,
    }
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "data").symlink_to(world.runs / "data")
    train(world.sets["scattered"], "threshold_peak", seed=0, runs=runs, **keys)
    [folder] = (runs / "train").iterdir()
    scorer = load(pack(world, "svm_pair", tmp_path, run=folder, name="tensors"))
    assert scorer.bundle.shape == (16, 36)
    confidence = scorer.score(observation, walk.poses).map.confidence
    assert np.isfinite(confidence).all() and np.ptp(confidence) > 0


ALONE = """
import sys
import numpy as np
hidden = "torch sklearn hydra omegaconf lightning numba yaml onnx rich soundfile".split()
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in hidden:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hidden())
from echolearn.robot.scorer import load
from echolearn.acoustics.types import Observation, Pose
scorer = load(sys.argv[1])
samples = np.random.default_rng(0).standard_normal((6, 6000))
observation = Observation(samples, scorer.bundle.probe, scorer.bundle.array)
assert len(scorer.update(observation, Pose(np.zeros(3))).points) <= 1
"""


@pytest.mark.parametrize("code", [ALONE, "import echolearn.classifiers.inference"])
def test_three_libraries_are_enough_and_leave_nothing_at_home(code, packed, tmp_path):
    """What a robot does not need is hidden from it; onnxruntime would keep files about its use."""
    home = {**os.environ, "HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code, str(packed)], env=home, check=True)
    assert not [path for path in tmp_path.rglob("*") if "onnxruntime" in path.name]


def test_a_scorer_is_shown_in_a_line(packed):
    """Its model and golden inputs would fill pages."""
    assert re.fullmatch(r"<Scorer small: trees_features of [a-z_, ]+>", repr(load(packed)))
