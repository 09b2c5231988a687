"""Recorded surveys in a comparison: their echoes are judged one by one, by the truth beside them;
models that were made for another robot are rows that say so."""

import csv
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from by_hand import edit
from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.types import MicArray
from echolearn.checks import BadValue
from echolearn.comparison.compare import compare, load_inputs
from echolearn.comparison.evaluate import evaluate, evaluate_measured
from echolearn.comparison.finding import find_survey
from echolearn.comparison.fitting import OTHER_ARRAY, OTHER_RATE, misfit, robot_of
from echolearn.comparison.localized import localized
from echolearn.comparison.measured import grouped, measured_rows
from echolearn.evaluation.rows import OTHER_LOCALIZER, pick
from echolearn.localization.methods.gated import Gated
from echolearn.survey.poses import poses_csv
from echolearn.survey.reader import read_survey
from echolearn.survey.truth import truth_csv
from echolearn.training.runs import Run
from world import CLASSIFIERS, HALL

SOME = 12
"""Poses of each recorded walk."""


def recorded(folder, source, **about):
    """Make of a simulated walk one that a robot has recorded, its echoes known."""
    shutil.copytree(source, folder)
    (folder / "manifest.json").unlink()
    (folder / "simulated.json").unlink()
    survey = read_survey(folder)
    truths = [true_echoes(HALL, pose, array=circular_array()) for pose in survey.poses[:SOME]]
    (folder / "truth.csv").write_bytes(truth_csv(truths))
    places = {"place": [f"corner {number // 3}" for number in range(SOME)]}
    table = poses_csv(survey.poses[:SOME], survey.files[:SOME], further=places)
    (folder / "poses.csv").write_bytes(table)
    edit(folder, **{"walls": ..., "map": False} | about)
    return folder


@pytest.fixture(scope="module")
def walks(world, tmp_path_factory):
    """Return recorded walks by name: at two levels, with walls, by another array."""
    base = tmp_path_factory.mktemp("recorded")
    loud, quiet = (world.runs / "survey" / name for name in ("hall_0dB", "hall_-10dB"))
    conditions = {"noise": "white", "room": "hall"}
    made = {
        "loud": recorded(base / "loud", loud, conditions=conditions | {"snr_db": 0.0}),
        "quiet": recorded(base / "quiet", quiet, conditions=conditions | {"snr_db": -10.0}),
    }
    walls = recorded(base / "walled", loud, map=True, walls=outline(HALL)[:, 0].tolist())
    (walls / "truth.csv").unlink()
    five = recorded(base / "five", loud, conditions=conditions)
    positions = circular_array(radius=0.3).positions.tolist()
    edit(five, microphones=positions, conditions={"room": "other"})
    return made | {"walled": walls, "five": five}


@pytest.fixture(scope="module")
def rows(world, walks):
    """Return the rows of a comparison with all of them."""
    inputs = load_inputs(
        world.runs,
        tested=["offgrid_hall"],
        surveys=list(map(str, walks.values())),
        localizers={"gated": world.arguments["localizers"]["gated"]},
    )
    return evaluate(inputs, resamples=30, workers=1).rows


def one(rows, **wanted):
    """Return the only row of a kind."""
    [found] = pick(rows, kind="measured", seed="", **wanted)
    return found


def test_levels_of_one_room_are_judged_together_and_each_alone(walks, rows):
    assert {name: [each.name for each in some] for name, some in grouped(walks).items()} == {
        "hall": ["loud", "quiet"],
        "walled": ["walled"],
        "other": ["five"],
    }
    for level, count in (("", 2 * SOME), ("0", SOME), ("-10", SOME)):
        row = one(rows, tested_on="hall", classifier="chance", metric="auc", snr_db=level)
        assert (row["n"], row["room"], row["localizer"], row["noise"]) == (
            count, "hall", "gated", "white"
        )  # fmt: skip


def test_recorded_walks_are_examined_as_for_a_map(world, walks, tmp_path, capfd):
    """An offset is subtracted and told; a dead microphone is refused with the line of `map`."""

    def rows_of(change):
        folder = tmp_path / "loud"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(walks["loud"], folder)
        for path in (folder / name for name in read_survey(folder).files):
            rate, samples = wavfile.read(path)
            wavfile.write(path, rate, change(samples).astype(np.float32))
        inputs = load_inputs(
            world.runs, tested=[], surveys=[str(folder)], localizers={"gated": gated}
        )
        # Those who map nothing else need no model.
        found = evaluate(replace(inputs, models={}), resamples=20, workers=1).rows
        return pick(found, metric="precision", classifier="keep_everything")

    gated = world.arguments["localizers"]["gated"]
    clean = rows_of(lambda x: x)
    assert capfd.readouterr().err.count("mended") == 0
    shifted = rows_of(lambda x: x + np.where(np.arange(6) == 2, 9 * x.std(), 0.0))
    assert len(clean) and shifted == clean
    assert "loud: mended: offset up to" in capfd.readouterr().err
    with pytest.raises(BadValue, match=r"loud: dead channels=microphone 3 .* without=\[3\] maps"):
        rows_of(lambda x: x * (np.arange(6) != 2))


def test_labels_and_metrics_are_those_of_a_slow_look(walks, rows, world):
    gated = world.arguments["localizers"]["gated"]
    both = []
    timed = []
    for name in ("loud", "quiet"):
        survey = read_survey(walks[name])
        echoes, _ = localized(survey, gated)
        for pose, place in enumerate(survey.poses):
            truth = true_echoes(HALL, place, array=circular_array())
            late = np.abs(truth.toa - echoes.toa[pose, 0]) * 22050 < 10
            turned = np.angle(np.exp(1j * (truth.azimuth - echoes.azimuth[pose, 0])))
            tilted = truth.elevation - echoes.elevation[pose, 0]
            # Floor and ceiling are straight below and above.
            upright = np.abs(truth.elevation - np.pi / 2) > 1
            near = np.abs(np.where(upright, tilted, turned)) <= np.deg2rad(10)
            timed.append(bool(late.any()))
            both.append(bool((late & near).any()))
    every = {"tested_on": "hall", "classifier": "keep_everything", "snr_db": ""}
    assert one(rows, metric="precision", **every)["value"] == pytest.approx(np.mean(both))
    assert one(rows, metric="time_precision", **every)["value"] == pytest.approx(np.mean(timed))
    assert one(rows, metric="true_retention", **every)["value"] == 1.0
    measured = measured_rows(
        "hall", [walks["loud"], walks["quiet"]], localizer=gated, name="gated", resamples=30
    )
    assert measured.label == "time_and_direction" and measured.places == SOME // 3
    assert measured.labelled.reference.tolist() == both
    # Rows of a place go together into a resample, whatever their level.
    weights = measured.labelled.weights.reshape(-1, 2, SOME // 3, 3)
    assert (weights == weights[:, :1, :, :1]).all()


def test_walls_label_what_has_no_table_of_echoes(walks, rows, world):
    gated = world.arguments["localizers"]["gated"]
    measured = measured_rows(
        "walled", [walks["walled"]], localizer=gated, name="gated", resamples=30
    )
    assert measured.label == "on_map" and measured.by_time is None
    kept = one(rows, tested_on="walled", classifier="keep_everything", metric="precision")
    assert kept["value"] == pytest.approx(measured.labelled.reference.mean())
    # Its map is judged, too, as that of any walk.
    assert pick(rows, kind="survey", tested_on="walled", metric="wall_coverage")
    assert not pick(rows, kind="survey", tested_on="hall")


def test_who_was_trained_for_another_array_is_a_row_that_says_so(rows):
    here = pick(rows, kind="measured", tested_on="other")
    learned = [row for row in here if row["role"] != "reference"]
    assert {row["metric"] for row in learned} == {OTHER_ARRAY}
    assert all(np.isnan(row["value"]) and row["n"] == 0 for row in learned)
    assert {row["classifier"] for row in learned} == set(CLASSIFIERS)
    assert pick(here, classifier="chance", metric="auc", seed="")


@dataclass(frozen=True)
class Deaf(Gated):
    """Works on no array."""

    def __call__(self, *given, **more):
        raise BadValue("microphones=6: must be 7")


def test_a_localizer_that_cannot_work_is_a_row_that_says_so(world, walks, capfd):
    deaf = {"deaf": Deaf(world.arguments["localizers"]["gated"].window, 36)}
    inputs = load_inputs(
        world.runs, tested=["offgrid_hall"], surveys=[str(walks["loud"])], localizers=deaf
    )
    found = evaluate_measured(
        inputs.models,
        "hall",
        folders=[walks["loud"]],
        localizers=deaf,
        name="deaf",
        robots=inputs.robots,
        resamples=30,
    )
    assert {row["metric"] for row in found.rows} == {OTHER_LOCALIZER}
    assert len(found.rows) == len(inputs.models) and found.measured is None
    assert capfd.readouterr().err == "hall, deaf: microphones=6: must be 7\n"


def test_a_comparison_shows_measured_columns_and_its_columns_stay(world, walks, tmp_path):
    runs = tmp_path / "runs"
    for part in ("data", "train"):
        shutil.copytree(world.runs / part, runs / part)
    folder = compare(
        name="measured",
        tested=["offgrid_hall"],
        surveys=[str(walks["loud"]), str(walks["quiet"]), str(walks["five"])],
        localizers={"gated": world.arguments["localizers"]["gated"]},
        resamples=30,
        runs=runs,
    )
    with (folder / "results.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert {row["kind"] for row in found} == {"set", "measured"}
    [refused, *_] = [row for row in found if row["metric"] == OTHER_ARRAY]
    assert (refused["value"], refused["n"]) == ("", "0")
    table = (folder / "table.md").read_text()
    page = (folder / "report.html").read_text()
    assert "| offgrid_hall | hall | other |" in table and "<th>hall</th><th>other</th>" in page
    assert "| trees_features | scattered | other array |" in table and "other array</td>" in page
    auc = [
        row["value"]
        for row in found
        if (row["classifier"], row["tested_on"], row["metric"], row["snr_db"], row["seed"])
        == ("trees_features", "hall", "auc", "", "")
    ]
    assert f"| trees_features | scattered | {float(auc[0]):.2f} [" in table


# ---------------------------------------------------------------- who fits whom


def run_with(microphones):
    """Return a run whose metrics say where its microphones were."""
    said = {} if microphones is None else {"microphones": microphones.tolist()}
    return Run(Path("run"), said)


def test_a_robot_whose_survey_has_fewer_digits_or_is_turned_is_the_same():
    ring = circular_array()
    trained = robot_of(ring, 22050.0)._replace(positions=None)
    rounded = MicArray(np.round(ring.positions, 4))
    turned = circular_array(offset=0.3)
    wider = circular_array(radius=0.21)
    fewer = circular_array(microphones=5)
    known = run_with(ring.positions)
    for array, expected in ((ring, ""), (rounded, ""), (turned, "")):
        assert misfit(known, trained, tested=robot_of(array, 22050.0)) == expected
    for array in (wider, fewer):
        assert misfit(known, trained, tested=robot_of(array, 22050.0)) == OTHER_ARRAY
    assert misfit(known, trained, tested=robot_of(ring, 48000.0)) == OTHER_RATE
    # Runs of before tell the digest of their array alone.
    assert misfit(run_with(None), trained, tested=robot_of(ring, 22050.0)) == ""
    assert misfit(run_with(None), trained, tested=robot_of(rounded, 22050.0)) == OTHER_ARRAY
    assert misfit(known, None, tested=robot_of(fewer, 22050.0)) == ""


def test_walks_of_another_robot_alone_are_refused_in_one_line(world, walks, tmp_path):
    folder = Path(shutil.copytree(walks["walled"], tmp_path / "wide"))
    edit(folder, microphones=circular_array(radius=0.3).positions.tolist())
    inputs = load_inputs(
        world.runs,
        tested=["offgrid_hall"],
        surveys=[str(folder)],
        localizers={"gated": world.arguments["localizers"]["gated"]},
    )
    with pytest.raises(BadValue, match="^surveys=wide: must be of an array and a rate for which"):
        evaluate(inputs, resamples=30, workers=1)


def test_what_is_still_being_made_is_no_survey(walks, tmp_path):
    place = tmp_path / "survey" / "r3vival_0dB_1"
    shutil.copytree(walks["loud"], place)
    assert find_survey(tmp_path, place.name) == place
    (place / "imported.json").write_text("{}")
    with pytest.raises(BadValue, match="run: echolearn import source=r3vival snr_db=0 draw=1"):
        find_survey(tmp_path, place.name)
