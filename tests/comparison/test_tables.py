"""Tables and choices by hand: who is chosen, which cells a line has, in which order they come."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from echolearn.acoustics.sides import closed
from echolearn.comparison import choice, tables
from echolearn.comparison.pivot import pivot
from echolearn.evaluation.rows import (
    SNR_BANDS_DB,
    LabelledRows,
    LocalizedSurvey,
    Model,
    Recordings,
    pick,
)
from echolearn.training.runs import Run
from small_comparisons import bare, row, trained


def walk(name, room, snr_db, localizer="gated"):
    """Return a survey of four poses, two of them near a wall, by survey and localizer."""
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]])
    poses = np.array([[1.5, 4.0], [4.0, 4.0], [4.1, 4.0], [4.0, 1.2]])
    source = Recordings(name, "survey", room=room, localizer=localizer)
    true, levels = np.ones(4, dtype=bool), np.full(4, snr_db)
    labelled = LabelledRows(source, true, np.arange(4), levels, np.ones((1, 4)))
    return (name, localizer), LocalizedSurvey(labelled, poses, poses, closed(corners), {})


def test_pick_and_pivot():
    names = (("a", "s", "t"), ("b", "s", "t"), ("b", "-", "t"), ("c", "s", "u"))
    rows = [row(*each, value) for value, each in enumerate(names)]
    assert pick(rows, classifier="b") == rows[1:3]
    assert pick(rows, trained_on=("-", "s"), tested_on="t") == rows[:3]
    table = pivot(rows, lines=("classifier", "trained_on"), cells="tested_on")
    assert list(table) == [("a", "s"), ("b", "s"), ("b", "-"), ("c", "s")]
    assert table["c", "s"] == {"u": rows[3]}


class TestChoice:
    MODELS = (
        trained("threshold_peak", "scattered", 0.99, 0.99, method="threshold"),
        trained("svm_pair", "scattered", 0.7, 0.8),
        trained("svm_features", "scattered", 0.9, 0.7),
        trained("trees_features", "scattered", 0.6, 0.99, method="trees"),
        trained("mlp_pair", "scattered", 0.75, 0.75, method="network"),
        trained("trees_features", "paper", 1.0, method="trees"),
        trained("svm_toa", "paper", 1.0),
    )
    RANKED = ("threshold_peak", "svm_features", "trees_features", "mlp_pair", "svm_pair")
    MADE_FOR: Any = {"roles": {"scattered": "training"}}

    def test_the_best_learned_model_on_its_validation_rows_is_chosen(self):
        comparison = bare(*self.MODELS, **self.MADE_FOR)
        ranked = choice.ranked(comparison, "scattered")
        assert tuple(model.classifier for model in ranked) == self.RANKED
        assert choice.chosen(comparison).classifier == "svm_features"
        assert choice.chosen_run(comparison).seed == 0

    def test_equals_are_chosen_by_name_and_a_threshold_if_nothing_was_learned(self):
        assert choice.chosen(bare(*self.MODELS)).classifier == "svm_toa"
        ways = {"threshold_score": 0.7, "threshold_peak": 0.8}
        models = [trained(name, "a", share, method="threshold") for name, share in ways.items()]
        assert choice.chosen(bare(*models)).classifier == "threshold_peak"

    def test_the_best_of_each_family_is_drawn_and_the_papers_pair(self):
        more = (
            trained("svm_score", "scattered", 0.75),
            trained("covnet", "scattered", 0.1, method="network"),
            trained("covnet_gated", "scattered", 0.2, method="network"),
        )
        drawn = choice.drawn(bare(*self.MODELS, *more, **self.MADE_FOR))
        names = tuple(model.classifier for model in drawn)
        assert names == (*self.RANKED, "covnet_gated", "covnet")

    @pytest.mark.parametrize(
        ("tested", "headline"),
        [
            ((), "a_made"),
            (("paper", "b_made"), "b_made"),
            (("paper",), "paper"),
            (("nothing",), "a_made"),
        ],
    )
    def test_a_set_made_for_training_is_the_headline_and_rather_one_that_is_tested(
        self, tested, headline
    ):
        names = ("paper", "b_made", "a_made")
        models = [trained("svm", name, 0.5) for name in names]
        models.append(trained("svm", "a_made", 0.5, split="row"))
        roles = {"paper": "grid", "a_made": "training", "b_made": "training"}
        sets = dict.fromkeys(tested)
        assert choice.headline(bare(*models, roles=roles, sets=sets)) == headline
        # The label that was learned is no reason to look at a set that was not made for training.
        by_map = [trained("svm", name, 0.5, target="on_map") for name in names]
        by_map.append(trained("svm", "a_made", 0.5, target="on_map", train_rows="10"))
        said = choice.headline(bare(*by_map, roles=roles, sets=sets))
        assert said == f"{headline} (on_map)"


class TestSurveys:
    SURVEYS = dict(
        (
            walk("one_10dB", "8x6x5", 10.0),
            walk("one_-5dB", "8x6x5", -5.0),
            walk("one_-5dB", "8x6x5", -5.0, "snls"),
            walk("one_0dB", "8x6x5", 0.0),
            walk("two_0dB", "13x11x5", 0.0),
        )
    )

    def test_snrs_and_the_main_localizer(self):
        one = bare(surveys=self.SURVEYS)
        assert tables.snrs(one) == ["10", "-5", "0"]
        assert tables.levels(one) == ["-5", "0"]
        assert tables.main_localizer(one) == "gated"
        unusual = bare(surveys=dict((walk("a", "a", 3.0), walk("b", "a", 7.0))))
        assert tables.levels(unusual) == ["3", "7"]
        assert tables.main_localizer(bare()) == ""

    @pytest.mark.parametrize(
        ("noises", "snr_db", "places"),
        [
            (("white", "white"), (0.0, -5.0), ("8x6x5", "8x6x5")),
            (("white", "rotor"), (0.0, 0.0), ("8x6x5, white", "8x6x5, rotor")),
            (("white", "white"), (0.0, 0.0), ("a", "b")),
        ],
    )
    def test_surveys_of_one_room_stand_together_if_their_snr_tells_them_apart(
        self, noises, snr_db, places
    ):
        surveys = []
        for name, noise, level in zip("ab", noises, snr_db, strict=True):
            _, survey = walk(name, "8x6x5", level)
            source = survey.labelled.source._replace(noise=noise)
            surveys.append(replace(survey, labelled=replace(survey.labelled, source=source)))
        rows = [row("chance", "-", name, 0.5) for name in "ab"]
        assert tuple(each["place"] for each in tables.placed(rows, surveys)) == places

    def test_a_rooms_tables_have_metrics_and_the_test_against_the_threshold(self):
        rows = []
        for survey in self.SURVEYS.values():
            here = survey.labelled.source._asdict() | {"snr_db": survey.snr_db}
            rows.append(row("keep_everything", "-", "", 0) | here)
            for metric in ("f1", "test"):
                rows.append(row("one", "set", "", 0, metric=metric) | here)
        rows = tables.placed(rows, self.SURVEYS.values())
        rooms = tables.map_tables(rows, bare(surveys=self.SURVEYS))
        assert list(rooms) == ["8x6x5", "13x11x5"]
        room = rooms["8x6x5"]
        assert (room["poses"], room["attainable"]) == (4, 0.5)
        assert list(room["tables"]) == ["-5", "0"]
        lines = room["tables"]["0"]
        assert list(lines) == [("keep_everything", "reference"), ("one", "learned")]
        assert set(lines["one", "learned"]) == {"f1", "test"}

    def test_a_room_is_new_to_a_model_unless_its_set_was_made_there(self):
        sizes = {"there": [[8.0, 8.0, 5.0], [9.0, 8.0, 5.0]], "elsewhere": [[8.0, 7.9, 5.0]]}
        sets = {name: {"room": np.array(size)} for name, size in sizes.items()}
        one = bare(surveys=self.SURVEYS, sets=sets)
        assert tables.unseen(one, "elsewhere")
        assert not tables.unseen(one, "there")
        assert not tables.unseen(one, "nobody knows")


class TestSets:
    def test_trained_on_times_tested_on(self):
        rows = [
            row("a", "paper", "paper", 0.9),
            row("a", "paper", "off", 0.5),
            row("a", "alone", "off", 0.8),
            row("chance", "-", "off", 0.51),
            row("a", "paper", "off", 0.1, snr_db="-5:40"),
            row("a", "paper", "walk", 0.2, kind="survey"),
        ]
        found = tables.generalisation(tables.placed(rows, []), localizer="gated")
        cells = {}
        for (training, _, classifier), line in found.items():
            cells[training, classifier] = {name: cell["value"] for name, cell in line.items()}
        assert list(cells.items()) == [
            (("-", "chance"), {"off": 0.51}),
            (("alone", "a"), {"off": 0.8}),
            (("paper", "a"), {"paper": 0.9, "off": 0.5}),
        ]

    def test_the_worst_of_the_sets_made_for_testing_counts(self):
        rows = [row("a", "set", "paper", 2), row("chance", "-", "x", 5, set_role="test")]
        for name, value in {"x": 8, "y": 7, "z": 9}.items():
            rows.append(row("a", "set", name, value, set_role="test"))
        found = tables.worst_test_set(rows)
        assert {name: cell["value"] for name, cell in found.items()} == {"a": 7, "chance": 5}

    def test_a_leak_is_the_same_classifier_split_both_ways(self):
        clean = row("a", "planar", "planar", 0.8)
        leaky = row("a", "planar", "planar", 0.95, split="row")
        alone = row("b", "planar", "planar", 0.9, split="row")
        elsewhere = row("a", "planar", "paper", 0.7, split="row")
        found = tables.leak([clean, leaky, alone, elsewhere])
        assert found == {("a", "planar", "reflector"): {"row": leaky, "position": clean}}

    @pytest.mark.parametrize(("lines", "left"), [(12, 12), (13, 2)])
    def test_a_long_table_is_shortened_to_those_who_are_asked_for(self, lines, left):
        """Twelve lines are all shown; a split by rows is none of them, however few there are."""
        table = {("s", "position", f"c{number}"): {} for number in range(lines)}
        table["s", "row", "c1"] = {}
        found = tables.in_short(table, always=("c1", "c7"))
        assert len(found) == left and ("s", "row", "c1") not in found
        assert {"c1", "c7"} <= {name for _, _, name in found}

    def test_the_papers_protocol_is_a_mean_over_seeds(self):
        runs = []
        for auc, folds in ((0.7, {"balanced_accuracy": {"mean": 0.77}}), (0.9, None)):
            test = {"auc": auc, "balanced_accuracy": auc - 0.1, "accuracy": auc - 0.2}
            runs.append(Run(Path(), {"rows": {}, "test": test, "cross_validation": folds}))
        [line] = tables.protocol(bare((Model("a", "set", split="row"), runs)))
        assert line["training"] == "set (row split)"
        figures = [line[key] for key in ("auc", "balanced_accuracy", "accuracy", "spread", "folds")]
        assert figures == pytest.approx([0.8, 0.7, 0.6, 0.1 * 2**0.5, 0.77])

    def test_a_set_is_described_by_its_rows(self, world):
        dataset = world.sets["scattered"]
        found = tables.describe_set("scattered", dataset)
        assert (found["rows"], found["positions"], found["digest"]) == (140, 140, dataset.digest)
        assert found["reflector"] == pytest.approx(dataset["reflector"].mean())
        assert found["on_map"] == pytest.approx(dataset["on_map"].mean())
        snr_db = dataset["snr_db"]
        sizes = [np.sum((snr_db >= low) & (snr_db < high)) for low, high in SNR_BANDS_DB]
        assert np.dot(found["right"], sizes) == pytest.approx(dataset["reflector"].sum())


def test_a_real_comparison_has_every_table(comparison):
    facts = tables.gather(comparison)
    assert facts["source"] == "scattered" and facts["best"] in ("svm_pair", "trees_features")
    assert facts["seeds"] == [0, 1] and facts["runs"] == 7
    assert facts["away"] == "offgrid_hall" and facts["unseen"]
    assert facts["snrs"] == facts["levels"][::-1] == ["0", "-10"]
    [room] = facts["rooms"].items()
    assert (room[0], room[1]["poses"], set(room[1]["tables"])) == ("6x5x4", 36, {"0", "-10"})
    learned = {"svm_pair", "threshold_peak", "trees_features"}
    assert set(facts["worst"]) == learned | {"chance"}
    assert set(facts["names"]) == {*facts["worst"], "keep_everything", "keep_nothing", "oracle"}
    assert facts["leak"] == {}
    assert {each["trained_on"] for each in facts["tests"]} == {"scattered"}
