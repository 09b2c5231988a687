"""A survey localized: every echo where it was estimated, every point where geometry puts it."""

import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from by_hand import edit
from echolearn.acoustics.signals import noise_covariance, noise_psd
from echolearn.checks import BadValue
from echolearn.comparison.evaluate import evaluate_set
from echolearn.comparison.localized import localize_survey
from echolearn.evaluation.rows import MISSING_COLUMNS, Recordings
from echolearn.localization.localize import localize
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.mapping.echo_map import echo_map
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.survey import survey
from echolearn.survey import audio, reader
from echolearn.survey.poses import poses_csv
from echolearn.survey.survey import BLOCK, blocks
from echolearn.training.runs import load_runs
from world import HALL, POSES, plans


@pytest.fixture(scope="module")
def walk(world):
    """Return the walk at 0 dB."""
    return world.runs / "survey" / "hall_0dB"


@pytest.fixture(scope="module")
def localized(world, walk):
    """Return a function that localizes a survey by one of the world's localizers."""

    def by(name="gated", folder=walk):
        localizer = world.arguments["localizers"][name]
        return localize_survey(folder, localizer, name=name, resamples=9)

    return by


@pytest.fixture(scope="module")
def gated(localized):
    return localized()


def test_models_get_what_they_look_at_where_it_is(world, walk):
    """A survey is described as they need it; of a set without that a row says so."""
    name = "covariance_steered_ideal"
    localizer = world.arguments["localizers"]["gated"]
    survey = localize_survey(walk, localizer, name="gated", resamples=9, further=[name])
    assert survey.columns[name].shape == (POSES, 16, 49)

    runs = load_runs(world.runs)
    trained = next(run for run in runs if run.model.classifier == "trees_features")
    looking = replace(trained, metrics={**trained.metrics, "inputs": [name]})
    other = trained.model._replace(classifier="covnet_ideal")
    models = {trained.model: [trained], other: [looking]}
    found = evaluate_set(models, world.sets["offgrid_hall"].folder, robots={}, resamples=20)
    unfit = [row for row in found.rows if row["metric"] == MISSING_COLUMNS]
    assert [row["classifier"] for row in unfit] == ["covnet_ideal"]
    assert any(row["classifier"] == "trees_features" for row in found.rows)


def test_blocks_of_recordings_give_what_all_of_them_give(world, walk, gated):
    """Every echo is its pose's, every point where `echo_map` puts it."""
    read = reader.read_survey(walk)
    observation = read.observe(range(POSES))
    echoes, columns = localize(observation, world.arguments["localizers"]["gated"])
    placed = echo_map(echoes, read.poses, array=observation.array, speed_of_sound=343.0)
    assert BLOCK < POSES == len(gated.points)
    assert np.allclose(gated.points, placed.points, atol=1e-5)
    assert np.array_equal(gated.poses, placed.poses)
    assert set(gated.columns) == set(columns)
    for name, column in columns.items():
        assert np.allclose(gated.columns[name], column, rtol=1e-3, atol=1e-4), name


@dataclass(frozen=True)
class Counted(Snls):
    """Notes how many recordings it is given at a time."""

    given: list[int] = field(default_factory=list)

    def __call__(self, observation, view=None):
        self.given.append(len(observation.samples))
        return super().__call__(observation, view)


def test_few_long_recordings_are_held_together(walk, tmp_path):
    """Twelve seconds of 6 microphones are 1.6 million samples, of which two are less than 2^22 and
    three are more."""
    long = 1 << 18
    folder = shutil.copytree(walk, tmp_path / "walk")
    read = reader.read_survey(folder)
    padded = np.pad(read.probe.samples, (0, long - len(read.probe.samples)))
    (folder / "probe.wav").write_bytes(audio.wav_bytes(padded, read.probe.sample_rate))
    samples = np.random.default_rng(0).standard_normal((6, long))
    (folder / "long.wav").write_bytes(audio.wav_bytes(samples, read.probe.sample_rate))
    files = [f"{pose}.wav" for pose in range(5)]
    for name in files:
        (folder / name).hardlink_to(folder / "long.wav")
    (folder / "poses.csv").write_bytes(poses_csv(read.poses[:5], files))
    localizer = Counted()
    assert len(localize_survey(folder, localizer, name="snls", resamples=2).points) == 5
    assert localizer.given == [2, 2, 1]
    assert blocks(reader.read_survey(walk)) == [range(32), range(32, 36)]


def test_true_is_what_lies_within_ten_centimetres_of_a_wall(comparison):
    sides = np.array(HALL.size[:2])
    distances = []
    for each in comparison.surveys.values():
        beyond = np.maximum(-each.points, each.points - sides)
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        distance = np.where(outside > 0, outside, -beyond.max(axis=1))
        assert np.array_equal(each.labelled.reference, distance <= 0.10)
        distances.append(distance)
    near = np.concatenate(distances)
    assert (near <= 0.10).any() and ((near > 0.10) & (near < 0.20)).any()


def test_what_is_known_of_the_recording_goes_into_columns(gated, comparison):
    labelled = gated.labelled
    assert labelled.source == Recordings("hall_0dB", "survey", "white", "", "6x5x4", "gated")
    assert (labelled.joint_snr_db == 0.0).all()
    assert np.array_equal(labelled.groups, np.arange(POSES))
    assert labelled.weights.shape == (9, POSES)
    assert (labelled.weights.sum(axis=1) == POSES).all()
    assert np.array_equal(gated.walls[:, 0], [[0, 0], [6, 0], [6, 5], [0, 5]])
    assert gated.snr_db == "0" and comparison.surveys["hall_-10dB", "gated"].snr_db == "-10"


def test_localizers_find_the_same_times_and_other_directions(localized, gated):
    whole = localized("snls")
    assert np.array_equal(whole.columns["toa"], gated.columns["toa"])
    assert np.array_equal(whole.labelled.weights, gated.labelled.weights)
    assert whole.labelled.reference.sum() < gated.labelled.reference.sum()


@pytest.fixture
def copied(walk, tmp_path):
    return Path(shutil.copytree(walk, tmp_path / "copy"))


def test_without_walls_there_is_nothing_to_evaluate_against(localized, copied):
    edit(copied, walls=...)
    with pytest.raises(BadValue, match=r"survey.yaml: it has no walls; without the room's outline"):
        localized(folder=copied)


@pytest.mark.parametrize(
    ("conditions", "noise", "room"),
    [(..., "unknown", "copy"), ({"room": "attic", "noise": "fan"}, "fan", "attic")],
)
def test_a_robots_survey_says_what_it_knows(localized, copied, conditions, noise, room):
    edit(copied, conditions=conditions)
    labelled = localized(folder=copied).labelled
    assert (labelled.source.noise, labelled.source.room) == (noise, room)
    assert np.isnan(labelled.joint_snr_db).all()


def test_a_missing_recording_is_named(localized, copied):
    (copied / "observations" / "0033.wav").unlink()
    with pytest.raises(BadValue, match=r"observations/0033.wav: cannot be read"):
        localized(folder=copied)


def test_under_rotors_a_localizer_that_whitens_finds_more_walls(tmp_path, walk):
    """What the noise alone sounds like goes with every recording; floor and ceiling are too far to
    be heard."""
    scene = replace(plans()[0].scene, diffuse=Diffuse(Rotor()))
    room = replace(HALL, size=(6.0, 5.0, 6.0))
    about = {"levels": NoiseLevels(40.0, -21.0), "poses": POSES, "runs": tmp_path}
    hovering = survey(name="rotors", room=room, scene=scene, **about)
    true = []
    for whiten in (False, True):
        localizer = Joint(echoes=1, azimuths=36, whiten=whiten)
        found = localize_survey(hovering, localizer, name="joint", resamples=2)
        true.append(found.labelled.reference.sum())
    assert true[1] > 1.5 * true[0]
    with pytest.raises(BadValue, match=r"record the noise alone: noise.wav of a survey"):
        localize_survey(walk, Joint(whiten=True), name="joint", resamples=2)

    rotors = reader.read_survey(hovering)
    [alone] = rotors.noise()
    assert alone is not None
    observation = rotors.observe([3])
    assert np.array_equal(observation.noise_psd, noise_psd(alone))
    assert np.array_equal(observation.noise_covariance, noise_covariance(alone))
    slower = replace(rotors, rate=11025.0).observe([3])
    assert slower.noise_psd is not None
    # Below 5 kHz; of half the band, half the power.
    low = noise_psd(alone)[:, :200].mean(axis=1) / 2
    assert np.allclose(slower.noise_psd[:, :400].mean(axis=1), low, rtol=0.1)
