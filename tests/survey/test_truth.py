"""True echoes, further columns and loudspeakers of their own: what is written is read back."""

from dataclasses import replace

import numpy as np
import pytest

from by_hand import ARRAY, FILES, POSES, PROBE, edit
from echolearn.acoustics.types import Truth
from echolearn.checks import BadValue
from echolearn.survey.direct_path import delayed
from echolearn.survey.poses import poses_csv
from echolearn.survey.reader import read_survey
from echolearn.survey.truth import truth_csv

HEAD = "index,toa_s,azimuth_rad,elevation_rad\n"
KNOWN = Truth(np.array([0.01, 1 / 300]), np.array([-3.0, np.nan]), np.array([1.5, np.nan]))
NONE = Truth(*np.zeros((3, 0)))


def test_true_echoes_are_read_back(folder):
    assert read_survey(folder).truth is None
    (folder / "truth.csv").write_bytes(truth_csv([KNOWN, NONE]))
    truth = read_survey(folder).truth
    for found, given in zip(truth, (KNOWN, NONE), strict=True):
        for name in ("toa", "azimuth", "elevation"):
            assert np.array_equal(getattr(found, name), getattr(given, name), equal_nan=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("index,toa,azimuth_rad,elevation_rad\n0,0.1,0,0\n", " columns=index,toa,azimuth_rad"),
        ("", " columns=: must be index,toa_s"),
        (HEAD + "2,0.01,0,0\n", " row 2 index=2: must be that of a pose in poses.csv"),
        (HEAD + "0,12.5,0,0\n", " row 2 toa_s='12.5': must be a number from 0 to 10 s; is it in"),
        (HEAD + "0,,0,0\n", " row 2 toa_s=''"),
        (HEAD + "0,0.01,90,0\n", " row 2 azimuth_rad='90': must be a number .*; is it in degrees"),
        (HEAD + "0,0.01\n0,0.01,0,-1\n", " row 3 elevation_rad='-1'"),
        (HEAD + "0,0.01,0,0,0\n", " row 2=5 cells: must be 4"),
        ("\x00\xff", ": cannot be read|columns="),
    ],
)
def test_what_is_no_table_of_echoes_is_refused(folder, text, message):
    (folder / "truth.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(BadValue, match=rf"truth\.csv({message})") as caught:
        read_survey(folder)
    assert str(caught.value).isprintable()


def test_further_columns_are_kept_and_a_moving_loudspeaker_is_told_to_the_robot(folder):
    """In the frame of the robot, which has turned."""
    places = [[2.0, 2.0, 1.5], [1.1, 4 / 3, 2.0]]
    names = ("loudspeaker_x_m", "loudspeaker_y_m", "loudspeaker_z_m")
    further = dict(zip(names, zip(*places, strict=True), strict=True)) | {"floor": ["oak", "tile"]}
    (folder / "poses.csv").write_bytes(poses_csv(POSES, FILES, further=further))
    edit(folder, direct_path="present", map=False)
    survey = read_survey(folder)
    assert survey.further == {"floor": ("oak", "tile")} and not survey.mapped
    for pose, (found, place) in enumerate(zip(survey.loudspeakers, places, strict=True)):
        heading = POSES[pose].heading
        toward = np.array(place) - POSES[pose].position
        assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(toward))
        turned = np.arctan2(found[1], found[0]) + heading
        assert np.exp(1j * turned) == pytest.approx(np.exp(1j * np.arctan2(*toward[1::-1])))
        apart = np.linalg.norm(ARRAY.positions - found, axis=1)
        assert np.linalg.norm(survey.around(pose).positions, axis=1) == pytest.approx(apart)
    # What is taken off each recording is the burst as it comes from there.
    survey = replace(survey, direct="fitted")
    removed = np.array([survey.recording(pose) for pose in (0, 1)]) - survey.observe([0, 1]).samples
    for pose, gone in enumerate(removed):
        arrived = delayed(PROBE, survey.around(pose), speed_of_sound=340.0)
        alike = np.sum(gone * arrived, axis=1) ** 2
        assert alike == pytest.approx(np.sum(gone**2, axis=1) * np.sum(arrived**2, axis=1))


def test_a_loudspeaker_needs_all_three_coordinates(folder):
    text = poses_csv(POSES, FILES, further={"loudspeaker_x_m": [0, 0]})
    (folder / "poses.csv").write_bytes(text)
    with pytest.raises(BadValue, match="without loudspeaker_y_m, loudspeaker_z_m: must have all"):
        read_survey(folder)
