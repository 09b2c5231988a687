"""A survey heard: every echo where it was estimated, every point where geometry puts it, judged by
the room's walls."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from echolearn.acoustics.signals import noise_covariance, noise_psd
from echolearn.acoustics.types import Echoes, Observation
from echolearn.checks import BadValue
from echolearn.comparison.localized import hear
from echolearn.comparison.tables import Comparison, snr_of
from echolearn.evaluation.scoring import Heard
from echolearn.localization import features
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.survey import survey
from echolearn.survey import audio, reader
from echolearn.survey.poses import poses_csv
from world import HALL, POSES, World, plans

SPEED = 343.0


@pytest.fixture(scope="module")
def heard(world: World) -> Heard:
    """Return the walk at 0 dB with echo-gated directions."""
    gated = world.arguments["localizers"]["gated"]
    return hear(world.runs / "survey" / "hall_0dB", gated, name="hall_0dB/gated", resamples=9)


def test_every_pose_has_its_echo_in_its_place(world: World, heard: Heard) -> None:
    """Recordings are heard in blocks; together they give the same."""
    gated = world.arguments["localizers"]["gated"]
    walk = reader.read_survey(world.runs / "survey" / "hall_0dB")
    observation = walk.observe(range(POSES))
    columns = features.describe(MatchedFilter(observation, gated.window), gated(observation))
    assert reader.BLOCK < POSES == len(heard.points)
    assert set(heard.columns) == set(columns)
    for name, column in columns.items():
        assert np.allclose(heard.columns[name], column, rtol=1e-3, atol=1e-4), name


@dataclass(frozen=True)
class Counted(Snls):
    """Notes how many recordings it is given at a time."""

    given: list[int] = field(default_factory=list)

    def __call__(self, observation: Observation) -> Echoes:
        self.given.append(len(observation.samples))
        return super().__call__(observation)


def test_few_long_recordings_are_held_together(world: World, tmp_path: Path) -> None:
    """Twelve seconds of 6 microphones are 1.6 million samples, of which two are less than 2^22 and
    three are more."""
    long, source = 1 << 18, world.runs / "survey" / "hall_0dB"
    folder = shutil.copytree(source, tmp_path / "walk")
    walk = reader.read_survey(folder)
    padded = np.pad(walk.probe.samples, (0, long - len(walk.probe.samples)))
    (folder / "probe.wav").write_bytes(audio.wav_bytes(padded, walk.probe.sample_rate))
    samples = np.random.default_rng(0).standard_normal((6, long))
    (folder / walk.files[0]).write_bytes(audio.wav_bytes(samples, walk.probe.sample_rate))
    (folder / "poses.csv").write_bytes(poses_csv(walk.poses[:5], walk.files[:1] * 5))
    localizer = Counted()
    assert len(hear(folder, localizer, name="walk/snls", resamples=2).points) == 5
    assert localizer.given == [2, 2, 1]
    assert reader.blocks(reader.read_survey(source)) == [range(32), range(32, 36)]


@pytest.mark.parametrize(("walk", "spelled"), [("hall_0dB", "0"), ("hall_-10dB", "-10")])
def test_a_survey_in_white_noise_has_the_ratio_of_its_name(
    contest: Comparison, walk: str, spelled: str
) -> None:
    assert snr_of(contest.heard[walk, "gated"]) == spelled


def test_points_lie_where_their_echoes_came_from(heard: Heard, world: World) -> None:
    """Its mirror image beyond the wall is as far from microphone 1 as the echo has come."""
    walk = reader.read_survey(world.runs / "survey" / "hall_0dB")
    for pose, place, point, toa, azimuth, elevation in zip(
        walk.poses,
        heard.poses,
        heard.points,
        *(heard.columns[n] for n in ("toa", "azimuth", "elevation")),
        strict=True,
    ):
        assert np.array_equal(place, pose.position[:2])
        angle, reach = azimuth + pose.heading, np.linalg.norm(point - place)
        level = np.sin(elevation)
        assert np.allclose(point, place + reach * np.array([np.cos(angle), np.sin(angle)]))
        microphone = 0.2 * np.array([np.cos(pose.heading), np.sin(pose.heading)])
        if level > 0.5:  # in the array's plane
            assert np.linalg.norm(2 * (point - place) - microphone) == pytest.approx(
                SPEED * toa, abs=1e-6
            )
        else:  # from the floor or the ceiling
            assert reach == pytest.approx(0.0, abs=1e-9)


def test_true_is_what_lies_within_ten_centimetres_of_a_wall(contest: Comparison) -> None:
    length, width, _ = HALL.size
    distances = []
    for heard in contest.heard.values():
        x, y = heard.points.T
        outside = np.hypot(
            np.maximum(np.maximum(-x, x - length), 0), np.maximum(np.maximum(-y, y - width), 0)
        )
        distance = np.where(outside > 0, outside, np.minimum.reduce([x, y, length - x, width - y]))
        assert np.array_equal(heard.sheet.reference, distance <= 0.10)
        distances.append(distance)
    near = np.concatenate(distances)
    assert (near <= 0.10).any() and ((near > 0.10) & (near < 0.20)).any()


def test_in_quiet_most_points_are_true(heard: Heard) -> None:
    assert 0.4 < heard.sheet.reference.mean() <= heard.attainable + 0.1


def test_what_is_known_of_the_recording_is_on_the_sheet(heard: Heard) -> None:
    sheet = heard.sheet
    assert (sheet.name, sheet.noise) == ("hall_0dB/gated", "white")
    assert (sheet.snr_db == 0.0).all()
    assert np.array_equal(sheet.groups, np.arange(POSES))
    assert sheet.weights.shape == (9, POSES) and (sheet.weights.sum(axis=1) == POSES).all()
    assert np.array_equal(heard.corners, [[0, 0], [6, 0], [6, 5], [0, 5]])


def test_localizers_hear_the_same_times_and_other_directions(world: World, heard: Heard) -> None:
    whole = hear(
        world.runs / "survey" / "hall_0dB",
        world.arguments["localizers"]["snls"],
        name="hall_0dB/snls",
        resamples=9,
    )
    assert np.array_equal(whole.columns["toa"], heard.columns["toa"])
    assert np.array_equal(whole.sheet.weights, heard.sheet.weights)
    assert whole.sheet.reference.sum() < heard.sheet.reference.sum()


@pytest.fixture
def edited(world: World, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that copies a walk and changes its `survey.yaml`; None removes a key."""

    def edit(**changes: Any) -> Path:
        folder = shutil.copytree(world.runs / "survey" / "hall_0dB", tmp_path / "copy")
        about = yaml.safe_load((folder / "survey.yaml").read_text()) | changes
        about = {key: value for key, value in about.items() if value is not None}
        (folder / "survey.yaml").write_text(yaml.safe_dump(about))
        return folder

    return edit


def test_without_walls_there_is_nothing_to_judge_by(
    world: World, edited: Callable[..., Path]
) -> None:
    with pytest.raises(
        BadValue, match=r"survey.yaml: no walls; an outline is needed to judge a map$"
    ):
        hear(edited(walls=None), world.arguments["localizers"]["gated"], name="copy", resamples=2)


def test_unknown_conditions_are_unknown(world: World, edited: Callable[..., Path]) -> None:
    sheet = hear(
        edited(conditions=None), world.arguments["localizers"]["gated"], name="copy", resamples=2
    ).sheet
    assert sheet.noise == "unknown" and np.isnan(sheet.snr_db).all()


def test_a_missing_recording_is_named(world: World, edited: Callable[..., Path]) -> None:
    folder = edited()
    (folder / "observations" / "0033.wav").unlink()
    with pytest.raises(BadValue, match=r"observations/0033.wav: cannot be read"):
        hear(folder, world.arguments["localizers"]["gated"], name="copy", resamples=2)


@pytest.fixture(scope="module")
def hovering(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a walk under rotors, with what they sound like alone; floor and ceiling are too far to
    be heard."""
    scene = replace(plans()[0].scene, diffuse=Diffuse(Rotor()))
    runs = tmp_path_factory.mktemp("hovering")
    tall = replace(HALL, size=(6.0, 5.0, 6.0))
    return survey(
        name="rotors",
        room=tall,
        scene=scene,
        levels=NoiseLevels(40.0, sdnr_db=-21.0),
        poses=POSES,
        runs=runs,
    )


def test_what_noise_alone_tells_goes_with_every_recording(hovering: Path, world: World) -> None:
    walk = reader.read_survey(hovering)
    alone = walk.noise()
    assert alone is not None
    heard = walk.observe([3])
    assert np.array_equal(heard.noise_psd, noise_psd(alone))
    assert np.array_equal(heard.noise_covariance, noise_covariance(alone))
    slower = replace(walk, rate=11025.0).observe([3])
    assert slower.noise_psd is not None
    low = (
        noise_psd(alone)[:, :200].mean(axis=1) / 2
    )  # below 5 kHz; of half the band, half the power
    assert np.allclose(slower.noise_psd[:, :400].mean(axis=1), low, rtol=0.1)
    assert reader.read_survey(world.runs / "survey" / "hall_0dB").observe([0]).noise_psd is None


def test_under_rotors_a_localizer_that_whitens_hears_more_walls(hovering: Path) -> None:
    deaf, white = (
        hear(
            hovering, Joint(echoes=1, azimuths=36, whiten=whiten), name="rotors", resamples=2
        ).sheet.reference.sum()
        for whiten in (False, True)
    )
    assert white > 1.5 * deaf


def test_without_noise_alone_nothing_can_be_whitened(world: World) -> None:
    with pytest.raises(BadValue, match=r"record the noise alone: noise.wav of a survey"):
        hear(world.runs / "survey" / "hall_0dB", Joint(whiten=True), name="hall", resamples=2)
