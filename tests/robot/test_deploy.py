"""A bundle at work: the laboratory's confidences and points, pose by pose, in a process that has
nothing else."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Observation
from echolearn.checks import BadValue
from echolearn.comparison.localized import localize_survey
from echolearn.evaluation.rows import LocalizedSurvey
from echolearn.robot.scorer import BLOCK, Scorer, load
from echolearn.survey import reader
from echolearn.training.predictions import load_scorer, predict, stack_inputs
from echolearn.training.runs import Run, load_runs
from world import POSES, World, pack

WALK = "hall_0dB"


@pytest.fixture(scope="module")
def scorer(packed: Path) -> Scorer:
    return load(packed)


@pytest.fixture(scope="module")
def walk(world: World) -> reader.Survey:
    return reader.read_survey(world.runs / "survey" / WALK)


@pytest.fixture(scope="module")
def observation(walk: reader.Survey) -> Observation:
    return walk.observe(range(POSES))


@pytest.fixture(scope="module")
def heard(world: World) -> LocalizedSurvey:
    """Return what the laboratory hears."""
    gated = world.arguments["localizers"]["gated"]
    return localize_survey(world.runs / "survey" / WALK, gated, name="gated", resamples=9)


@pytest.fixture(scope="module")
def run(world: World) -> Run:
    [found] = [r for r in load_runs(world.runs) if r.classifier == "trees_features"]
    return found


def alone(observation: Observation, pose: int) -> Observation:
    """Return one recording, samples (M, N)."""
    return replace(observation, samples=observation.samples[pose])


def test_confidences_are_the_runs(scorer: Scorer, run: Run, world: World) -> None:
    x = stack_inputs(run.inputs, {name: world.sets["offgrid_hall"][name] for name in run.inputs})
    many = (
        np.tile(x, (100, 1)) * np.geomspace(0.01, 100, 100).repeat(len(x))[:, None]
    )  # more than are scored at once
    assert len(many) > BLOCK
    assert np.abs(scorer(many) - load_scorer(run.folder)(many)).max() <= 1e-5
    assert scorer(many[:0]).shape == (0,)


def test_points_and_confidences_are_the_laboratorys(
    scorer: Scorer, run: Run, heard: LocalizedSurvey, walk: reader.Survey, observation: Observation
) -> None:
    found = scorer.score(observation, walk.poses)
    assert np.abs(found.map.points - heard.points).max() <= 1e-5
    assert np.abs(found.map.confidence - predict(run, heard.columns)).max() <= 1e-5
    assert np.array_equal(found.map.kept, predict(run, heard.columns) >= run.threshold)
    assert 0 < found.map.kept.sum() < POSES
    assert np.allclose(found.echoes.toa[:, 0], heard.columns["toa"], atol=1e-12)


def test_pose_by_pose_the_same_points_come_out(
    scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    whole = scorer.score(observation, walk.poses).map
    steps = [scorer.update(alone(observation, pose), walk.poses[pose]) for pose in range(POSES)]
    kept = whole.kept
    assert np.allclose(
        np.concatenate([step.points for step in steps]), whole.points[kept], atol=1e-5
    )
    assert np.allclose(
        np.concatenate([step.confidence for step in steps]), whole.confidence[kept], atol=1e-5
    )
    assert np.array_equal(np.concatenate([step.poses for step in steps]), whole.poses[kept])
    assert {len(step.points) for step in steps} == {0, 1} and all(step.kept.all() for step in steps)


def test_a_gain_of_the_recording_and_a_louder_copy_of_the_probe_change_nothing(
    scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    louder = replace(observation.probe, samples=observation.probe.samples * 0.25)
    scorer.check(replace(observation, probe=louder))
    found = scorer.score(replace(observation, samples=3.0 * observation.samples), walk.poses)
    assert np.allclose(
        found.map.confidence, scorer.score(observation, walk.poses).map.confidence, atol=1e-4
    )


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float16, np.float32])
def test_samples_of_any_real_dtype_give_the_points_of_floats(
    dtype: type, scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    """As a sound card gives them; each recording fills the range of 16 bits, whose squares would
    wrap around."""
    level = 30_000 / np.abs(observation.samples).max(axis=(1, 2))
    for pose in range(4):
        samples = np.rint(level[pose] * observation.samples[pose]).astype(dtype)
        found = scorer.update(replace(observation, samples=samples), walk.poses[pose])
        expected = scorer.update(
            replace(observation, samples=samples.astype(float)), walk.poses[pose]
        )
        exact = scorer.update(alone(observation, pose), walk.poses[pose])
        assert np.array_equal(found.points, expected.points)
        assert np.allclose(found.points, exact.points, atol=1e-3)


def test_silence_is_refused_as_in_a_survey(
    scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    samples = observation.samples.copy()
    samples[3] = 0.0
    with pytest.raises(
        BadValue,
        match=r"^observation.samples=silence in \[3\]: recordings; was the recorder running",
    ):
        scorer.score(replace(observation, samples=samples), walk.poses)
    with pytest.raises(BadValue, match=r"^observation.samples=silence in \[0\]"):
        scorer.update(replace(observation, samples=samples[3].astype(np.int16)), walk.poses[3])


def test_recordings_of_another_robot_are_refused(
    scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    probe, positions = observation.probe, observation.array.positions
    moved = positions + np.eye(6, 3) * 0.004
    cases = {
        "bundle expects sample_rate=22050 Hz, survey has 44100 Hz; resample with": {
            "probe": replace(probe, sample_rate=44100.0)
        },
        "microphones=4: 6, the bundle's": {"array": circular_array(microphones=4)},
        "microphones=one is off by 4.0 mm: at most 1 mm": {"array": MicArray(moved)},
        "are the microphones in the same order": {"array": MicArray(positions[::-1])},
        r"samples=\(5,\) channels": {"samples": observation.samples[:, :5]},
        "probe=correlates .* with the bundle's: the same burst; play": {
            "probe": noise_probe(seed=8, length=6000)
        },
        "window.farthest=2.0 m: echoes within the recording": {
            "samples": observation.samples[..., :200]
        },
    }
    for said, changes in cases.items():
        with pytest.raises(BadValue, match=said):
            scorer.score(replace(observation, **changes), walk.poses)


def test_an_array_mounted_at_an_angle_hears_the_same_walls(
    scorer: Scorer, walk: reader.Survey, observation: Observation
) -> None:
    """The same recordings by a robot whose x axis points elsewhere: other headings and angles, the
    same points."""
    turn = 0.6
    rotation = np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    turned = replace(observation, array=MicArray(observation.array.positions @ rotation))
    found = scorer.score(
        turned, [replace(pose, heading=pose.heading - turn) for pose in walk.poses]
    )
    straight = scorer.score(observation, walk.poses)
    assert np.allclose(found.map.points, straight.map.points) and np.allclose(
        found.map.confidence, straight.map.confidence
    )
    difference = found.echoes.azimuth - straight.echoes.azimuth - turn
    assert np.allclose(np.exp(1j * difference), 1)


def test_inputs_that_are_none_are_refused(scorer: Scorer) -> None:
    for x, said in (
        (np.zeros((3, 5)), r"inputs.shape=\(3, 5\): \(B, 4,\) of peak_to_rms, second_to_first"),
        (np.zeros(4), "inputs.shape"),
        (np.zeros(()), "inputs.shape"),
        (np.full((1, 4), np.nan), "inputs=NaN or infinity"),
        (np.full((1, 4), 1e300), "inputs=NaN or infinity"),
    ):
        with pytest.raises(BadValue, match=said):
            scorer(x)


def test_tensors_travel_too(
    world: World, tmp_path: Path, walk: reader.Survey, observation: Observation
) -> None:
    from world import train

    keys = {
        "_target_": "echolearn.classifiers.methods.network.Network",
        "inputs": ["covariance_steered"],
        "net": {
            "_target_": "echolearn.classifiers.architectures.CovarianceNet",
            "channels": 4,
            "layers": 1,
        },
        "epochs": 2,
    }
    runs = tmp_path / "runs"
    (runs / "data").parent.mkdir(parents=True)
    (runs / "data").symlink_to(world.runs / "data")
    train(world.sets["scattered"], "threshold_peak", seed=0, runs=runs, **keys)
    [folder] = (runs / "train").iterdir()
    scorer = load(pack(world, "svm_pair", tmp_path, run=folder, name="tensors"))
    assert scorer.bundle.shape == (16, 36)
    confidence = scorer.score(observation, walk.poses).map.confidence
    assert np.isfinite(confidence).all() and np.ptp(confidence) > 0


def test_a_process_with_three_libraries_is_enough(
    packed: Path, world: World, tmp_path: Path
) -> None:
    """Everything else that is installed is hidden from it."""
    walk = reader.read_survey(world.runs / "survey" / WALK)
    observation = walk.observe([0])
    arrays = {
        "samples": observation.samples[0],
        "probe": walk.probe.samples,
        "microphones": walk.array.positions,
    }
    np.savez(
        tmp_path / "given.npz",
        **arrays,
        position=walk.poses[0].position,
        heading=walk.poses[0].heading,
    )
    code = f"""
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("torch", "sklearn", "hydra", "omegaconf", "lightning", "pyroomacoustics", "numba",
                                  "yaml", "onnx", "matplotlib", "soundfile", "rich", "jinja2"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hidden())
import numpy as np
from echolearn.robot.scorer import load
from echolearn.acoustics.types import MicArray, Observation, Pose, Probe
given = np.load({str(tmp_path / "given.npz")!r})
scorer = load({str(packed)!r})
probe = Probe(given["probe"], 22050.0, 6000)
observation = Observation(given["samples"], probe, MicArray(given["microphones"]))
pose = Pose(given["position"], float(given["heading"]))
found = scorer.score(Observation(given["samples"][None], probe, observation.array), [pose])
print(found.map.points[0, 0], found.map.confidence[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    expected = load(packed).score(observation, walk.poses[:1]).map
    assert np.allclose(
        [float(word) for word in done.stdout.split()],
        [expected.points[0, 0], expected.confidence[0]],
    )


@pytest.mark.parametrize("module", ["echolearn.robot.scorer", "echolearn.classifiers.inference"])
def test_what_imports_onnxruntime_keeps_it_out_of_the_home_folder(
    module: str, tmp_path: Path
) -> None:
    subprocess.run(
        [sys.executable, "-c", f"import {module}"],
        env={**os.environ, "HOME": str(tmp_path)},
        check=True,
    )
    assert not [path for path in tmp_path.rglob("*") if "onnxruntime" in path.name]
