"""A comparison from trained runs to files on the disk: what is in them, when it is made again, and
what stops it."""

import csv
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from echolearn.checks import BadValue
from echolearn.comparison import report
from echolearn.comparison.choice import chosen, chosen_run
from echolearn.comparison.compare import (
    COLUMNS,
    TEST_COLUMNS,
    _finished,
    compare,
    examined_files,
    load_inputs,
    look_closer,
    page_files,
)
from echolearn.comparison.evaluate import Inputs
from echolearn.comparison.finding import find_set, find_survey
from echolearn.comparison.rivals import against_baseline
from echolearn.evaluation.rows import LabelledRows, Model, Predictions, Recordings, pick, to_csv
from echolearn.storage import manifests
from echolearn.training.runs import load_runs
from world import POSES, TRAINED, WALKS, coming_second

ABOUT = "role,method,split,target,kind,set_role,room,localizer,train_rows,without"
TABLES = {
    "results.csv": "classifier,trained_on,tested_on,seed,snr_db,noise,metric,"
    "value,ci_low,ci_high,n",
    "tests.csv": "classifier,against,trained_on,tested_on,snr_db,metric,"
    "difference,ci_low,ci_high,p,p_holm,n",
}
REFERENCES = {"keep_everything", "keep_nothing", "oracle", "chance"}


def table(path):
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def results(compared):
    return table(compared / "results.csv")


# ---------------------------------------------------------------- results.csv


def test_the_columns_are_the_documented_ones(compared):
    documented = (Path(__file__).parents[2] / "docs" / "formats.md").read_text()
    for name, columns in TABLES.items():
        further = ",test" if name == "tests.csv" else ""
        assert (compared / name).read_text().splitlines()[0] == f"{columns},{ABOUT}{further}"
        for column in (*columns.split(","), *ABOUT.split(","), "test"):
            assert f"`{column}`" in documented


def test_everyone_is_evaluated_everywhere(results, world):
    models = {(name, plan) for plan, _, names in TRAINED for name in names}
    whole = pick(results, seed="", metric="balanced_accuracy")
    where = {(name, "", "", "chance") for name in world.sets}
    for walk, snr_db in zip(WALKS, ("0", "-10"), strict=True):
        where |= {(walk, localizer, snr_db, "") for localizer in ("gated", "snls")}
    for tested_on, localizer, snr_db, alone in where:
        here = pick(whole, tested_on=tested_on, localizer=localizer, snr_db=snr_db)
        references = {(name, "-") for name in ([alone] if alone else REFERENCES)}
        found = [(row["classifier"], row["trained_on"]) for row in here]
        assert sorted(found) == sorted(models | references)
    assert {(row["tested_on"], row["localizer"]) for row in results} == {each[:2] for each in where}


def test_a_row_says_what_it_is_about(results):
    """Whatever a name might tell stands in a column."""
    about = {}
    for row in results:
        model = tuple(row[key] for key in ("role", "method", "split", "target"))
        about.setdefault(row["classifier"], set()).add(model)
        source = tuple(row[key] for key in ("kind", "set_role", "room"))
        about.setdefault(row["tested_on"], set()).add(source)
    assert about == {
        "threshold_peak": {("baseline", "threshold", "position", "reflector")},
        "svm_pair": {("learned", "svm", "position", "reflector")},
        "trees_features": {("learned", "trees", "position", "reflector")},
        **dict.fromkeys(REFERENCES, {("reference", "", "", "")}),
        "grid": {("set", "grid", "")},
        "scattered": {("set", "training", "")},
        "offgrid_hall": {("set", "test", "")},
        **dict.fromkeys(WALKS, {("survey", "", "6x5x4")}),
    }


def test_no_figure_is_given_twice(results):
    figures = ("value", "ci_low", "ci_high", "n")
    keys = [tuple(cell for key, cell in row.items() if key not in figures) for row in results]
    assert len(keys) == len(set(keys))


def test_a_run_is_evaluated_by_what_it_held_out_where_any_was_trained(results, comparison):
    """All of a set that none was trained on count, every echo of a survey, and on its own set the
    figures are those of its test rows."""
    sizes = {"grid": {"14"}, "scattered": {"28"}, "offgrid_hall": {"60"}, "hall_0dB": {str(POSES)}}
    for tested_on, expected in sizes.items():
        rows = pick(
            results, tested_on=tested_on, snr_db=("", "0"), trained_on=("grid", "scattered")
        )
        assert {row["n"] for row in rows} == expected, tested_on
    for model, runs in comparison.models.items():
        here = pick(results, **model._asdict(), tested_on=model.trained_on, snr_db="")
        for metric in ("auc", "balanced_accuracy"):
            for run in runs:
                seed = str(run.seed) if len(runs) > 1 else ""
                [row] = pick(here, seed=seed, metric=metric)
                assert float(row["value"]) == pytest.approx(run.metrics["test"][metric], abs=1e-5)


# ---------------------------------------------------------------- tests.csv


def test_models_are_tested_where_they_are_new_and_points_have_one_localizer(compared, comparison):
    every = table(compared / "tests.csv")
    tests = pick(every, test="swaps", against="threshold_peak")
    places = {("offgrid_hall", "", "auc")}
    places |= {(walk, "gated", "balanced_accuracy") for walk in WALKS}
    assert {(t["tested_on"], t["localizer"], t["metric"]) for t in tests} == places
    tested = {("svm_pair", "scattered"), ("trees_features", "scattered"), ("svm_pair", "grid")}
    for place, _, _ in places:
        assert {(t["classifier"], t["trained_on"]) for t in pick(tests, tested_on=place)} == tested
    # Of those on the set made for training, also against the best by validation rows.
    further = [row for row in every if row not in tests]
    asked = {(row["test"], row["against"]) for row in further if row["test"] != "bootstrap"}
    best = chosen(comparison).classifier
    assert asked == {("mcnemar", "threshold_peak"), ("mcnemar", best), ("swaps", best)}
    assert {row["trained_on"] for row in pick(further, against=best)} == {"scattered"}
    assert all(float(row["p_holm"]) >= float(row["p"]) for row in every)


def test_seeds_that_the_threshold_lacks_are_not_tested():
    """The comparison goes on without this test; nor is a leaky split tested, or another set's."""
    reference = np.array([True, False] * 6)
    rows = np.arange(12)
    labelled = LabelledRows(
        Recordings("set", "set"), reference, rows, np.zeros(12), np.ones((20, 12))
    )

    def model(name, trained_on="set", **more):
        return Model(name, trained_on, "learned", "", "position", "reflector")._replace(**more)

    def says(seed):
        return Predictions(seed, rows, reference * 1.0, 0.5)

    given = {
        model("threshold_peak"): [says(0), says(1)],
        model("late"): [says(2)],
        model("early"): [says(1)],
        model("stray", "other"): [says(0)],
        model("leaky", split="row"): [says(0)],
        model("threshold_peak", split="row"): [says(0)],
    }
    found = list(against_baseline(given, labelled, metric="auc"))
    assert [row["classifier"] for row in found] == ["early"]


# ---------------------------------------------------------------- bytes, and what is made again


def flip(path):
    """Turn one bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))


def test_the_number_of_workers_changes_nothing(world, comparison, compared):
    folders = {dataset.digest: dataset.folder for dataset in world.sets.values()}
    inputs = Inputs({}, {}, {}, {}, {}, trained=folders)
    examined = look_closer(comparison, inputs, plan_of=lambda dataset: None, resamples=50)
    made = page_files(comparison, name="small", examined=examined)
    made |= examined_files(examined, comparison)
    made["results.csv"] = to_csv(comparison.rows, COLUMNS.split())
    made["tests.csv"] = to_csv(comparison.tests, TEST_COLUMNS.split())
    for name, content in made.items():
        assert (compared / name).read_bytes() == content, name


def test_a_finished_comparison_is_shown_again(world, compared, capsys):
    before = {path: path.stat().st_mtime_ns for path in compared.rglob("*")}
    capsys.readouterr()
    assert compare(name="small", workers=2, **world.arguments) == compared
    assert {path: path.stat().st_mtime_ns for path in compared.rglob("*")} == before
    shown = capsys.readouterr()
    assert shown.out.startswith((compared / "table.md").read_text())
    assert shown.out.endswith(f"{compared / 'report.html'}\n") and shown.err == ""


@pytest.mark.usefixtures("anew")
def test_other_inputs_are_evaluated_anew(world, compared, tmp_path):
    """Under the same name: sets alone, a run fewer, a README to fill, and the damage of a report
    mended."""
    for part in ("data", "survey"):
        (tmp_path / part).symlink_to(world.runs / part)
    shutil.copytree(world.runs / "train", tmp_path / "train")
    shutil.rmtree(next((tmp_path / "train").glob("svm_pair-scattered-s1-*")))
    shutil.copytree(compared, tmp_path / "compare" / "small")
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{report.RESULTS.begin}\n{report.RESULTS.end}\nafter\n")
    changed = world.arguments | {"tested": ["offgrid_hall"], "surveys": [], "runs": tmp_path}
    command = "echolearn compare 'surveys=[]'"
    folder = compare(name="small", readme=readme, command=command, **changed)
    rows = table(folder / "results.csv")
    assert {row["tested_on"] for row in rows} == {"offgrid_hall"}
    assert {row["seed"] for row in pick(rows, classifier="svm_pair")} == {""}
    manifest = manifests.verify(folder)
    assert manifest["command"] == command
    assert set(manifest["inputs"]["runs"]) == {run.identity for run in load_runs(tmp_path)}
    assert set(manifest["files"]) == {
        "results.csv", "tests.csv", "report.html", "table.md", "importance.csv", "ranks.csv",
        "shifts.csv", "warnings.csv", "worst.csv", "answer.csv",
        "figures/importance.svg", "figures/ranks.svg", "figures/dots_1.svg",
        "figures/arrival_times.svg", "figures/bands.svg", "figures/belief.svg",
    }  # fmt: skip
    assert (folder / "table.md").read_text() in readme.read_text()


def test_what_another_command_writes_meanwhile_is_not_shown(world, compared, tmp_path, capfd):
    """It comes while this one waits to write to the README, its folder free again."""
    for part in ("data", "survey", "train"):
        (tmp_path / part).symlink_to(world.runs / part)
    folder = Path(shutil.copytree(compared, tmp_path / "compare" / "small"))
    before = [(folder / name).read_bytes() for name in report.SHOWN[:2]]
    readme = tmp_path / "README.md"
    readme.write_text(f"{report.RESULTS.begin}\n{report.RESULTS.end}\n")

    def other():
        for name in report.SHOWN:
            (folder / name).write_text("another")

    said = []

    def heard():
        said.append(capfd.readouterr().out)
        # The table is printed before the page is written.
        return "waiting for another command" if "report.html" in "".join(said) else ""

    arguments = world.arguments | {"runs": tmp_path}
    work = partial(compare, name="small", readme=readme, **arguments)
    coming_second(work, readme, other, heard)
    table, picture = before
    assert "".join(said).startswith(table.decode()) and table.decode() in readme.read_text()
    assert (tmp_path / "docs" / "before_after.svg").read_bytes() == picture


INPUTS = "runs sets surveys localizers resamples report".split()


def test_every_input_is_part_of_the_identity_and_damage_is_seen(compared, comparison, tmp_path):
    manifest = manifests.load_manifest(compared)
    assert manifest["chosen"] == chosen_run(comparison).identity
    inputs = manifest["inputs"]
    assert list(inputs) == sorted(INPUTS)
    folder = Path(shutil.copytree(compared, tmp_path / "copy"))
    shown = _finished(folder, inputs)
    assert shown == {name: (folder / name).read_bytes() for name in report.SHOWN}
    for name in INPUTS:
        assert _finished(folder, inputs | {name: "another"}) is None
    flip(folder / "figures" / "bands.svg")
    assert _finished(folder, inputs) is None


# ---------------------------------------------------------------- what stops it


BAD = (
    (
        {"tested": ["grid", "paper"]},
        "tested=paper: must be the name of exactly one finished set; "
        "run: echolearn generate plan=paper",
    ),
    ({"tested": []}, "tested=[]: must name at least one labelled set"),
    ({"tested": ["grid", "grid"]}, "tested=grid, grid: must hold each name only once"),
    (
        {"surveys": ["barn_0dB"]},
        "surveys=barn_0dB: must be the name of a finished survey, or a folder in its format, "
        "./walk; run: echolearn survey room=barn snr_db=0",
    ),
    ({"surveys": ["a", "a"]}, "surveys=a, a: must hold each name only once"),
    ({"localizers": {}}, "localizers={}: must hold at least one, to localize the surveys"),
    ({"resamples": "many"}, "resamples=many: must be a whole number from 20 to 100000"),
    ({"workers": 0}, "workers=0: must be a whole number from 1 to 1024"),
)


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_arguments_are_one_line_and_leave_nothing(world, changes, message):
    with pytest.raises(BadValue) as caught:
        compare(name="bad", **world.arguments | changes)
    assert str(caught.value).removesuffix(f" runs={world.runs}") == message
    assert not (world.runs / "compare" / "bad").exists()


def test_without_runs_there_is_nothing_to_compare(world, tmp_path):
    (tmp_path / "data").symlink_to(world.runs / "data")
    with pytest.raises(BadValue, match=r"^runs=.*: must be a folder with trained runs; "):
        compare(name="bad", **world.arguments | {"runs": tmp_path})


def test_a_readme_without_markers_stops_it_before_any_work(world, tmp_path):
    (tmp_path / "README.md").write_text("no markers\n")
    with pytest.raises(BadValue, match="readme="):
        compare(name="bad", readme=tmp_path / "README.md", **world.arguments)
    assert not (world.runs / "compare" / "bad").exists()


@pytest.mark.parametrize(
    "name",
    [
        "survey/hall_0dB/observations/0007.wav",
        "data/offgrid_hall-*/shard-00000.npy",
        "train/svm_pair-grid-s0-*/model.onnx",
        "train/svm_pair-grid-s0-*/metrics.json",
    ],
)
def test_what_is_damaged_stops_it(world, tmp_path, name):
    for part in ("data", "survey", "train"):
        if name.startswith(part):
            shutil.copytree(world.runs / part, tmp_path / part)
        else:
            (tmp_path / part).symlink_to(world.runs / part)
    [path] = tmp_path.glob(name)
    flip(path)
    with pytest.raises(
        BadValue, match=rf"{path.parent.name}/{path.name}: (damaged|cannot be read)"
    ):
        compare(name="bad", **world.arguments | {"runs": tmp_path})
    assert not (tmp_path / "compare").exists()


# ---------------------------------------------------------------- what is found


@pytest.fixture
def put(world, tmp_path):
    """Return a function that copies a set to a folder of another name."""
    grid = world.sets["grid"].folder
    return lambda name: Path(shutil.copytree(grid, tmp_path / "data" / name))


def test_two_sets_of_one_name_are_one_too_many(put, tmp_path):
    for number in range(2):
        put(f"grid-{number:012x}")
    with pytest.raises(
        BadValue, match=r"^tested=grid: .*; remove the outdated: .*grid-0+, .*grid-0+1$"
    ):
        find_set(tmp_path, "grid")


def test_a_set_of_another_version_is_passed_over(world, put, tmp_path):
    old = put("grid-0123456789ab")
    manifest = manifests.load_manifest(old)
    plan = {key: value for key, value in manifest["plan"].items() if key != "role"}
    manifests.finish(old, manifest | {"format": 1, "plan": plan}, files=manifest["files"])
    with pytest.raises(BadValue, match=r"another version of echolearn; run: echolearn generate"):
        find_set(tmp_path, "grid")
    new = put(world.sets["grid"].folder.name)
    assert find_set(tmp_path, "grid") == new
    (tmp_path / "train").symlink_to(world.runs / "train")
    inputs = load_inputs(tmp_path, tested=["grid"], surveys=[], localizers={})
    assert inputs.roles == {"grid": "grid"}


def test_a_set_is_found_by_its_whole_name(put, tmp_path):
    for name in ("grid", "grid-fine", "grid_planar"):
        put(f"{name}-0123456789ab")
    for name in ("grid", "grid_planar"):
        assert find_set(tmp_path, name).name == f"{name}-0123456789ab"
    with pytest.raises(BadValue, match="tested=planar"):
        find_set(tmp_path, "planar")
    (tmp_path / "data" / "grid-0123456789ab" / "manifest.json").unlink()
    with pytest.raises(BadValue, match="run: echolearn generate plan=grid"):
        find_set(tmp_path, "grid")


@pytest.mark.parametrize("plan", [None, "text", {}, {"name": ["a"]}, {"name": "grid"}])
def test_a_set_of_no_plan_beside_the_others_stops_nothing(world, tmp_path, plan):
    for part in ("survey", "train"):
        (tmp_path / part).symlink_to(world.runs / part)
    shutil.copytree(world.runs / "data", tmp_path / "data")
    (tmp_path / "data" / "odd").mkdir()
    manifests.finish(tmp_path / "data" / "odd", {"kind": "set", "plan": plan}, files=[])
    keys = ("tested", "surveys", "localizers")
    found = load_inputs(**{key: world.arguments[key] for key in keys}, runs=tmp_path)
    assert [*found.sets] == world.arguments["tested"] and len(found.models) == 5


def test_a_survey_is_found_once_it_finished(tmp_path):
    (tmp_path / "survey" / "half").mkdir(parents=True)
    with pytest.raises(BadValue, match="surveys=half"):
        find_survey(tmp_path, "half")
