"""Arrays given by lists and files, and what no array can be."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.acoustics.types import MicArray
from echolearn.survey.placed_array import placed_array
from refusals import refused

PLACES = [[0.1, 0.0, 0.2], [0.0, 0.1, 0.2], [-0.1, -0.1, 0.25]]
CSV = "x_m,y_m,z_m\n0.1,0,0.2\n0,1e-1,0.2\n\n-0.1,-0.1,0.25\n"
YAML = "- [0.1, 0, 0.2]\n- [0, 1e-1, 0.2]\n- [-0.1, -0.1, 0.25]\n"
SURVEY = "sample_rate: 22050\nmicrophones: [[0.2, 0, 0.2], [0.1, 0.1, 0.2], [0, -0.1, 0.25]]\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", CSV),
        ("a.txt", CSV.partition("\n")[2]),
        ("a.yaml", YAML),
        ("survey.yml", SURVEY + "loudspeaker: [0.1, 0, 0]\n"),
    ],
)
def test_a_file_gives_the_array_that_a_list_gives(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    found = placed_array(file=str(tmp_path / name))
    np.testing.assert_allclose(found.positions, PLACES, atol=1e-15)
    assert placed_array(positions=PLACES) == MicArray(np.array(PLACES))


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_the_loudspeaker_becomes_the_origin(moved):
    places = (np.array(PLACES) + moved).tolist()
    found = placed_array(positions=places, loudspeaker=moved)
    np.testing.assert_allclose(found.positions, PLACES, atol=1e-12)


def of(*places, **others):
    return placed_array(positions=list(places), **others)


ELSEWHERE = [[0.1 * k, 0.3, 0.0] for k in range(33)]
HERE, THERE = [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (placed_array, "array=no places: must be array.positions, M x 3 in m, or array.file"),
        (lambda: of(HERE, THERE, file="a.csv"), "array=positions and file: must be array.positio"),
        (lambda: of(HERE), "array.positions=1 microphones: must be a whole number from 2 to 32"),
        (lambda: of(*ELSEWHERE), "array.positions=33 microphones: must be a whole number from 2"),
        (lambda: of([0.1, 0.0], [0.0, 0.1]), "array.positions=shape (2, 2): must be many x 3"),
        (lambda: of([0.1, 0.0, "a"], HERE), "array.positions=words: must be many x 3"),
        (lambda: of(HERE, THERE, HERE), "array.positions=microphones 1 and 3 at one place: must"),
        (
            lambda: of([48.0, 0.0, 0.0], [0.0, 48.0, 0.0]),
            "array.positions=microphones 1 and 2 67.8823 m apart: must be within 2 m of each "
            "other; are they in mm?",
        ),
        (lambda: of([480.0, 0.0, 0.0], THERE), "array.positions=480 m: must be coordinates from"),
        (
            lambda: of(HERE, [0.0, 0.0, 0.001]),
            "array.positions=microphone 2 1.0 mm from the loudspeaker: must be 5 mm or more from "
            "it; where is it? array.loudspeaker=[x,y,z]",
        ),
        (lambda: of(HERE, THERE, loudspeaker=[0.0]), "array.loudspeaker=shape (1,): must be 3 fin"),
        (lambda: placed_array(file="gone.csv"), "array.file=gone.csv: must be CSV or YAML"),
    ],
)
def test_what_is_no_array_is_refused(make, message):
    with refused(message):
        make()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "x,y,z\n1,2,a\n", "array.file=a.csv: must be CSV or YAML with three coordinates"),
        ("a.csv", "", "a.csv=shape (0,): must be many x 3"),
        (
            "a.csv",
            "0.1,0,0\n0,0.1\n",
            "a.csv=rows of several lengths, or no numbers: must be many x 3",
        ),
        ("a.csv", "46,0,0\n0,46,0\n", "a.csv=microphones 1 and 2 65.0538 m apart: must be within"),
        ("a.yaml", "[0.1, [", "array.file=a.yaml: must be CSV or YAML with three coordinates in m"),
        (
            "a.yaml",
            "sample_rate: 22050\n",
            "a.yaml=rows of several lengths, or no numbers: must be many x 3",
        ),
        ("a.yaml", "microphones\n", "a.yaml=words: must be many x 3"),
    ],
)
def test_what_holds_no_array_is_refused(tmp_path, monkeypatch, name, text, message):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    with refused(message):
        placed_array(file=name)
