"""A comparison looked at closely: each warning by hand, exchanges, shifts, pictures made again."""

import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from echolearn.comparison import examined_figures, importance, shifts, warnings, worst
from echolearn.comparison.compare import examined_files, look_closer
from echolearn.comparison.evaluate import Inputs
from echolearn.comparison.examined import learning_curves
from echolearn.comparison.looks import looks
from echolearn.comparison.ranking import Ranking, rank_models
from echolearn.comparison.recorded_set import label_survey
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.records import records
from echolearn.evaluation import metrics
from echolearn.evaluation.ranks import critical_difference
from echolearn.localization.methods.gated import Gated
from echolearn.survey.reader import read_survey
from echolearn.training.predictions import load_scorer, predict_rows
from echolearn.training.runs import Run
from small_comparisons import bare, row, trained
from world import plans


def codes(found):
    return [(each.code, each.classifier, each.tested_on) for each in found]


# ---------------------------------------------------------------- warnings


def test_a_position_of_the_training_set_is_a_leak(comparison, world):
    """The world's sets have none in common; its own grid under another name has them all."""
    folders = {dataset.digest: dataset.folder for dataset in world.sets.values()}
    walks = {name: world.runs / "survey" / name for name, _ in comparison.surveys}
    assert codes(warnings.leaks(comparison, folders, surveys=walks)) == []
    twin = {"test": world.sets["grid"]}
    digest = world.sets["scattered"].digest
    [found] = warnings.leaks(
        bare(*comparison.models.items(), sets=twin), {digest: twin["test"].folder}, surveys={}
    )
    assert (found.code, found.training, found.tested_on, found.value) == (
        "W01",
        "grid",
        "test",
        1.0,
    )
    [leaky] = warnings.leaks(bare(trained("svm", "grid", 0.9, split="row")), {}, surveys={})
    assert (leaky.code, leaky.classifier, leaky.training) == ("W01", "svm", "grid (row split)")


def test_a_set_that_an_adapted_filter_had_learned_from_is_a_leak(world):
    """Of its own set a run is tested on held-out rows; of the earlier one nobody holds any out."""
    model, [run] = trained("adapted", "grid", 0.9)
    sets = {name: world.sets[name] for name in ("grid", "scattered")}
    about = {"data": sets["grid"].digest, "adapted_from": {"data": [sets["scattered"].digest]}}
    adapted = model, [replace(run, metrics={**run.metrics, **about})]
    [found] = warnings.leaks(bare(adapted, sets=sets), {}, surveys={})
    assert (found.code, found.classifier, found.tested_on) == ("W01", "adapted", "scattered")


def test_a_walk_that_was_labelled_and_learned_is_a_leak(world, tmp_path):
    """A walk at another SNR visits the same places; the same poses in another room do not."""
    learned, again = (read_survey(world.runs / "survey" / f"hall_{db}dB") for db in (0, -10))
    made = label_survey(learned.folder, localizer=Gated(learned.window, 36), runs=tmp_path)
    training = Dataset(made)
    model, [run] = trained("svm", "hall_0dB", 0.9)
    known = bare((model, [Run(Path(), {**run.metrics, "data": training.digest})]))
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(learned.folder, elsewhere)
    about = yaml.safe_load((elsewhere / "survey.yaml").read_text())
    moved = yaml.safe_dump(about | {"walls": [[0, 0], [9, 0], [9, 9], [0, 9]]})
    (elsewhere / "survey.yaml").write_text(moved)
    walks = {"./again": again.folder, "elsewhere": elsewhere}
    [found] = warnings.leaks(known, {training.digest: made}, surveys=walks)
    assert codes([found]) == [("W01", "", "hall_-10dB")] and found.value == 1.0
    assert found.message == "100.0% of its poses are at positions of the training set"


def told(classifier, difference, p, **more):
    about = {"test": "swaps", "against": "threshold_peak", "metric": "auc", "tested_on": "t"}
    return about | {
        "classifier": classifier,
        "training": "s",
        "difference": difference,
        "p_holm": p,
        **more,
    }


def test_who_is_worse_than_the_threshold_is_told_once():
    rows = [
        told("svm", -0.2, 0.01),
        told("svm", -0.4, 0.05, tested_on="u"),
        told("svm", 0.1, 0.01),
        told("luck", -0.4, 0.06),
        told("best", -0.4, 0.01, against="other"),
        told("right", -0.4, 0.01, test="mcnemar"),
    ]
    [found] = warnings.below_threshold(rows)
    assert codes([found]) == [("W02", "svm", "u")] and found.value == -0.4
    assert "worse than threshold_peak in 2 of 3 tests, most by 0.400 of auc" in found.message


def test_seeds_that_scatter_by_more_than_the_effect():
    """Leads of 0.3 and -0.1 scatter by 0.28 about 0.1; those of 0.2 and 0.3 do not."""
    rows = [
        row(name, "s", "t", value, seed=seed)
        for name, *values in (("threshold_peak", 0.6, 0.6), ("a", 0.9, 0.5), ("b", 0.8, 0.9))
        for seed, value in enumerate(values)
    ]
    [found] = warnings.unsettled(bare(rows=[*rows, row("c", "s", "t", 0.5, seed=0)]))
    assert codes([found]) == [("W03", "a", "t")]
    assert (found.value, found.limit) == pytest.approx((0.2 * 2**0.5, 0.1))


def test_where_the_threshold_is_always_right_nothing_can_be_told():
    rows = [
        row("threshold_peak", "s", "t", value, snr_db=band)
        for band, value in (("", 0.95), ("-5:40", 0.99), ("-10:-5", 0.98))
    ]
    found = list(warnings.saturated(bare(trained("a", "s", 0.9), rows=rows)))
    assert codes(found) == [("W04", "threshold_peak", "t")]
    assert "0.990 (-5 to 40 dB)" in found[0].message


def test_columns_outside_of_those_trained_on():
    shared = {"trained_on": "s", "tested_on": "t", "localizer": ""}
    rows = [shared | {"column": c, "outside": v} for c, v in (("a", 0.1), ("b", 0.2), ("c", 0.5))]
    [found] = warnings.shifted(rows)
    assert codes([found]) == [("W05", "", "t")] and found.message.endswith(": c 50%, b 20%")


def test_a_missing_yardstick_is_named():
    known = [trained(name, "s", 0.9) for name in warnings.YARDSTICKS]
    assert codes(warnings.missing_yardsticks(bare(*known))) == []
    threshold = trained("threshold_peak", "u", 0.9, method="threshold")
    [found] = warnings.missing_yardsticks(bare(*known[1:], trained("net", "s", 0.9), threshold))
    assert (found.training, found.value) == ("s", 1) and "train threshold_peak on" in found.message


def test_each_code_is_documented_and_told(capsys):
    page = (Path(__file__).parents[2] / "docs" / "statistics.md").read_text()
    for code, name in warnings.CODES.items():
        assert f"| `{code}` | {name} |" in page
    one = warnings.Warned("W04", "", "", "", 1, 1, "")
    warnings.tell([one, one, one._replace(code="W01")])
    assert (
        capsys.readouterr().err
        == "W01 leak: 1, see warnings.csv\nW04 saturated: 2, see warnings.csv\n"
    )


# ---------------------------------------------------------------- shifts, importance, ranks


def test_a_shift_by_hand():
    trained_on = np.arange(1000.0)
    assert shifts.compare_columns(trained_on, trained_on) == pytest.approx(
        {"distance": 0, "outside": 0.01}
    )
    moved = shifts.compare_columns(trained_on, trained_on + 250)
    assert moved == pytest.approx({"distance": 0.25, "outside": 0.255}, abs=0.002)


def test_whole_positions_are_exchanged():
    groups = np.repeat([5, 3, 9, 7], [3, 2, 1, 3])
    seen = set()
    for seed in range(60):
        given = groups[importance.permuted(groups, np.random.default_rng(seed))]
        pairs = {(int(one), int(other)) for one, other in zip(groups, given, strict=True)}
        # Each position is given one other, each is given away, in the order of its rows.
        assert len(pairs) == len({other for _, other in pairs}) == 4
        seen |= pairs
    assert len(seen) == 16
    equal = np.repeat(np.arange(6), 2)
    rows = importance.permuted(equal, np.random.default_rng(1))
    assert sorted(rows) == list(range(12)) and (rows[1::2] == rows[::2] + 1).all()


def test_importance_is_the_mean_loss_of_exchanged_columns(comparison):
    """A literal loop, with the same draws; what a model does not look at would lose nothing."""
    model = next(model for model in comparison.models if model.classifier == "trees_features")
    run = comparison.models[model][0]
    dataset = comparison.sets["offgrid_hall"]
    found = {each["column"]: each for each in importance.of_run(run, dataset, resamples=60)}
    assert list(found) == list(run.inputs)
    given = predict_rows(run, dataset)
    reference = dataset["reflector"][given.rows]
    score = load_scorer(run.folder)
    for place, name in enumerate(run.inputs):
        rng = np.random.default_rng(place)
        losses = []
        for _ in range(importance.REPEATS):
            columns = [dataset[each][given.rows] for each in run.inputs]
            columns[place] = columns[place][importance.permuted(dataset["group"][given.rows], rng)]
            lost = metrics.auc(reference, score(np.stack(columns, axis=1)))
            losses.append(metrics.auc(reference, given.confidence) - lost)
        assert found[name]["value"] == pytest.approx(np.mean(losses))
        assert found[name]["ci_low"] <= found[name]["value"] <= found[name]["ci_high"]
    assert max(each["value"] for each in found.values()) > 0.02


def banded(classifier, *values):
    """Return AUC in bands of two test sets, and over all of one."""
    cells = [("t", "-40:-20"), ("t", "-5:40"), ("u", "-40:-20"), ("u", "-5:40"), ("u", "")]
    return [
        row(classifier, "s", where, value, snr_db=band, set_role="test")
        for (where, band), value in zip(cells, (*values, 0.0), strict=True)
    ]


def test_ranks_are_over_bands_of_test_sets():
    """What one model has no figure for is no condition, nor is the whole set, nor another set."""
    rows = [
        *banded("a", 0.6, 0.9, 0.6, 0.9),
        *banded("b", 0.7, 0.8, 0.7, np.nan),
        *banded("c", 0.5, 0.7, 0.5, 0.9),
        row("c", "s", "s", 0.99, snr_db="-5:40", set_role="training"),
    ]
    models = [trained(name, "s", 0.9) for name in "abc"]
    found = rank_models(bare(*models, rows=rows))
    assert found.names == ["b", "a", "c"] and found.conditions == 3
    assert found.ranks == pytest.approx([4 / 3, 5 / 3, 3])
    assert found.difference == critical_difference(3, conditions=3)
    assert rank_models(bare(*models, rows=[r for r in rows if r["classifier"] != "c"])) is None


def test_a_learning_curve_has_a_point_for_each_number_of_rows():
    models = []
    rows = []
    for asked, rows_taught, value in (("", 300, 0.9), ("50", 48, 0.7), ("900", 300, 0.1)):
        model, runs = trained("a", "s", 0.9, train_rows=asked)
        runs[0].metrics["rows"] = {"train": rows_taught}
        models.append((model, runs))
        rows.append(row("a", "s", "t", value) | model.columns())
    other, runs = trained("b", "s", 0.9)
    runs[0].metrics["rows"] = {"train": 300}
    models.append((other, runs))
    rows.append(row("b", "s", "t", 0.5))

    class Tested:
        manifest = {"plan": {"role": "test"}}

    [(label, points)] = learning_curves(bare(*models, rows=rows, sets={"t": Tested()})).items()
    assert label == "a, s"
    assert [(each["train"], each["value"]) for each in points] == [(48, 0.7), (300, 0.9)]


# ---------------------------------------------------------------- the worst errors


def test_the_worst_errors_are_the_surest_and_their_recordings_made_again(comparison):
    """The picture's recording gives the row that is stored; who knows no plan draws nothing."""
    plan = {each.name: each for each in plans()}["offgrid_hall"]
    found = worst.worst_errors(comparison, lambda dataset: plan)
    dataset = comparison.sets["offgrid_hall"]
    for error, sign in ((worst.BELIEVED, -1), (worst.MISSED, 1)):
        mine = [each for each in found.rows if each["error"] == error]
        sure = [sign * each["confidence"] for each in mine]
        assert sure == sorted(sure) and 0 < len(mine) <= worst.LISTED
        assert {bool(dataset["reflector"][each["row"]]) for each in mine} == {sign == 1}
    for each in found.pictures:
        number = each.row["row"]
        again = records(plan, range(number, number + 1))
        assert again["toa"][0] == dataset["toa"][number] == each.row["toa"]
        assert each.response.max() == 1.0
        assert each.response.shape == (len(each.azimuths), len(each.distances))
        assert each.truth.toa == pytest.approx(dataset["truth_toa"][number])
    assert len(found.pictures) <= 2 * worst.DRAWN
    unknown = worst.worst_errors(comparison, lambda dataset: None)
    assert unknown.rows == found.rows and not unknown.pictures


def test_a_loud_echo_is_bright_where_its_wall_is():
    plan = {each.name: each for each in plans()}["offgrid_hall"]
    rows = records(plan, range(60))
    loud = int(np.argmax(np.where(rows["on_map"] & rows["reflector"], rows["snr_db"], -99)))
    shown = worst.picture(plan, {"row": loud})
    azimuth, distance = np.unravel_index(shown.response.argmax(), shown.response.shape)
    near = np.abs(shown.distances[distance] - 343 * shown.truth.toa / 2) < 0.1
    turned = np.angle(np.exp(1j * (shown.azimuths[azimuth] - shown.truth.azimuth)))
    assert (near & (np.abs(turned) < np.radians(10))).any()


def test_every_figure_is_the_same_twice_and_needs_nothing_else(comparison, world):
    folders = {dataset.digest: dataset.folder for dataset in world.sets.values()}
    plan = {each.name: each for each in plans()}
    inputs = Inputs({}, {}, {}, {}, {}, trained=folders)
    known = {"plan_of": lambda dataset: plan[dataset.name], "resamples": 30}
    examined = look_closer(comparison, inputs, **known)
    ranking = Ranking(list("abcd"), np.array([1, 2, 2.5, 4.5]), 5, 1.2, 0.01, np.ones((4, 4)))
    curve = [row("a", "s", "t", 0.8, train=t, ci_low=0.7, ci_high=0.9) for t in (50, 300)]

    def drawn():
        figures = examined_figures.draw_examined(examined, comparison)
        figures["ranks"] = examined_figures.critical_differences(
            ranking, looks=looks(ranking.names)
        )
        return figures | {"learning": examined_figures.learning({"a": curve}, looks=looks(["a"]))}

    first = drawn()
    assert first == drawn() and {"ranks", "learning", "importance", "worst"} <= {*first}
    for svg in first.values():
        for node in ET.fromstring(svg).iter():
            links = [value for key, value in node.attrib.items() if key.endswith("href")]
            assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    files = examined_files(examined, comparison)
    assert {*files} == {f"{n}.csv" for n in "ranks importance shifts worst warnings".split()}
    assert all(
        len(content.splitlines()) > 1 for name, content in files.items() if name != "ranks.csv"
    )
