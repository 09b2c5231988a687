"""Tables by hand: who is chosen, which cells a line has, in which order they come."""

from dataclasses import replace
from pathlib import Path
from statistics import mean
from typing import Any

import numpy as np
import pytest

from echolearn.comparison import tables
from echolearn.comparison.tables import Comparison, pick
from echolearn.evaluation.scoring import Heard, Row, Sheet
from echolearn.training.runs import Run
from world import World


def row(classifier: str, trained_on: str, tested_on: str, value: float, **more: Any) -> Row:
    """Return a row of results with the mean over seeds."""
    common = {
        "seed": "",
        "snr_db": "",
        "metric": "auc",
        "ci_low": value - 0.1,
        "ci_high": value + 0.1,
    }
    return (
        {"classifier": classifier, "trained_on": trained_on, "tested_on": tested_on, "value": value}
        | common
        | more
    )


def validated(*balanced: float) -> list[Run]:
    """Return a run per seed with these validation figures."""
    return [
        Run(Path(), {"validation": {"balanced_accuracy": share}, "seed": s})
        for s, share in enumerate(balanced)
    ]


def bare(
    runs: dict[tuple[str, str], list[Run]] | None = None,
    heard: dict[tuple[str, str], Heard] | None = None,
) -> Comparison:
    """Return a comparison that knows nothing else."""
    return Comparison(runs or {}, {}, heard or {}, [], [])


def walk(snr_db: float) -> Heard:
    """Return a survey of four poses at an SNR, two of them near a wall."""
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]])
    poses = np.array([[1.5, 4.0], [4.0, 4.0], [4.1, 4.0], [4.0, 1.2]])
    sheet = Sheet("", np.ones(4, dtype=bool), np.arange(4), np.full(4, snr_db), np.ones((1, 4)))
    return Heard(sheet, poses, poses, corners, {})


def test_pick_takes_rows_that_equal_all_that_is_wanted() -> None:
    rows = [
        row("a", "s", "t", 1.0),
        row("b", "s", "t", 2.0),
        row("b", "-", "t", 3.0),
        row("c", "s", "u", 4.0),
    ]
    assert [r["value"] for r in pick(rows, classifier="b")] == [2.0, 3.0]
    assert [r["value"] for r in pick(rows, trained_on=("-", "s"), tested_on="t")] == [1.0, 2.0, 3.0]
    assert pick(rows, classifier="b", tested_on="u") == []


class TestChoice:
    RUNS = {
        ("threshold_peak", "scattered"): validated(0.99, 0.99),
        ("svm_pair", "scattered"): validated(0.7, 0.8),
        ("svm_features", "scattered"): validated(0.9, 0.7),
        ("trees_features", "scattered"): validated(0.6, 0.99),
        ("mlp_pair", "scattered"): validated(0.75, 0.75),
        ("trees_features", "paper"): validated(1.0),
        ("svm_toa", "paper"): validated(1.0),
    }

    def test_the_best_learned_one_on_its_validation_rows_is_chosen(self) -> None:
        assert tables.chosen(bare(self.RUNS), "scattered") == "svm_features"

    def test_equals_are_chosen_by_name(self) -> None:
        assert tables.chosen(bare(self.RUNS), "paper") == "svm_toa"

    def test_a_threshold_is_chosen_if_nothing_was_learned(self) -> None:
        runs = {("threshold_score", "a"): validated(0.7), ("threshold_peak", "a"): validated(0.8)}
        assert tables.chosen(bare(runs), "a") == "threshold_peak"

    def test_scores_are_means_over_seeds_the_best_first(self) -> None:
        scores = tables.validated(bare(self.RUNS), "scattered")
        assert list(scores) == [
            "threshold_peak",
            "svm_features",
            "trees_features",
            "mlp_pair",
            "svm_pair",
        ]
        assert scores["trees_features"] == pytest.approx(0.795)

    def test_the_best_of_each_family_is_drawn_and_the_papers_pair(self) -> None:
        drawn = tables.drawn(bare(self.RUNS), "scattered")
        assert drawn == ["threshold_peak", "svm_features", "trees_features", "mlp_pair", "svm_pair"]
        more = self.RUNS | {
            ("svm_score", "scattered"): validated(0.75),
            ("covnet", "scattered"): validated(0.1),
        }
        more |= {("covnet_gated", "scattered"): validated(0.2)}
        assert set(tables.drawn(bare(more), "scattered")) == {*drawn, "covnet", "covnet_gated"}

    def test_the_headline_is_about_the_scattered_set(self) -> None:
        assert tables.headline_set(bare(self.RUNS)) == "scattered"
        assert (
            tables.headline_set(bare({("a", "tiny_scattered"): [], ("a", "tiny"): []}))
            == "tiny_scattered"
        )
        assert tables.headline_set(bare({("a", "paper"): [], ("a", "alone"): []})) == "alone"

    @pytest.mark.parametrize(
        "name", ["threshold_peak", "keep_everything", "keep_nothing", "oracle", "chance"]
    )
    def test_yardsticks_have_learned_nothing(self, name: str) -> None:
        assert not tables.is_learned(name)
        assert tables.is_learned("svm_pair") and tables.is_learned("covnet")


class TestWalks:
    HEARD = {
        ("8x6x5_10dB", "gated"): walk(10.0),
        ("8x6x5_-5dB", "gated"): walk(-5.0),
        ("8x6x5_-5dB", "snls"): walk(-5.0),
        ("8x6x5_0dB", "gated"): walk(0.0),
        ("13x11x5_0dB", "gated"): walk(0.0),
    }

    def test_rooms_and_their_snrs(self) -> None:
        one = bare(heard=self.HEARD)
        assert tables.rooms(one) == ["8x6x5", "13x11x5"]
        assert tables.snrs(one) == ["10", "-5", "0"]
        assert tables.levels(one) == ["0", "-5"]
        assert tables.walks(one, "0") == ["8x6x5_0dB", "13x11x5_0dB"]
        assert tables.walks(one, "-5") == ["8x6x5_-5dB"]
        assert tables.main_localizer(one) == "gated"

    def test_where_no_usual_snr_was_walked_all_are_shown(self) -> None:
        assert tables.levels(
            bare(heard={("a_3dB", "gated"): walk(3.0), ("a_7dB", "gated"): walk(7.0)})
        ) == ["3", "7"]

    def test_unfiltered_shares_by_room_and_localizer(self) -> None:
        whole = [
            row(
                "keep_everything",
                "-",
                f"{name}/{localizer}",
                0.1 * number,
                metric="precision",
                snr_db=tables.snr_of(h),
            )
            for number, ((name, localizer), h) in enumerate(self.HEARD.items())
        ]
        found = tables.directions(whole, bare(heard=self.HEARD))
        assert [(line["room"], line["localizer"]) for line in found] == [
            ("8x6x5", "gated"), ("8x6x5", "snls"), ("13x11x5", "gated")
        ]  # fmt: skip
        assert {snr: cell["value"] for snr, cell in found[0]["share"].items()} == pytest.approx(
            {"10": 0.0, "-5": 0.1, "0": 0.3}
        )
        assert found[0]["attainable"] == 0.5

    def test_what_a_classifier_saves_of_each_localizer(self) -> None:
        whole = [
            row(
                name,
                source,
                f"{walk}/{localizer}",
                value,
                metric=metric,
                snr_db=tables.snr_of(heard),
            )
            for (walk, localizer), heard in self.HEARD.items()
            for name, source, value in (
                ("one", "set", 0.75),
                ("two", "set", 0.5),
                ("one", "other", 0.25),
            )
            for metric in ("precision", "true_retention", "f1")
        ]
        found = tables.saved(whole, bare(heard=self.HEARD), source="set", best="one")
        assert [(line["room"], line["localizer"], list(line["cells"])) for line in found] == [
            ("8x6x5", "gated", ["10", "-5", "0"]), ("8x6x5", "snls", ["-5"]), ("13x11x5", "gated", ["0"])
        ]  # fmt: skip
        precision, retention = found[1]["cells"]["-5"]
        assert (precision["metric"], retention["metric"]) == ("precision", "true_retention")
        assert precision["value"] == retention["value"] == 0.75

    def test_a_line_has_its_metrics_and_its_test_against_the_threshold(self) -> None:
        whole = [
            row(name, "set", "a_0dB/gated", 0.5, metric=m)
            for name in ("one", "two")
            for m in ("f1", "precision")
        ]
        whole += [
            row("oracle", "-", "a_0dB/gated", 1.0, metric="f1"),
            row("one", "other", "a_0dB/gated", 0.9),
        ]
        whole += [row("one", "set", "a_0dB/snls", 0.9)]
        test = {
            "tested_on": "a_0dB/gated",
            "trained_on": "set",
            "classifier": "two",
            "difference": 0.25,
        }
        known = Comparison(
            {}, {}, {}, [], [test, test | {"trained_on": "other", "classifier": "one"}]
        )
        lines = tables.map_lines(known, whole, "a_0dB/gated", source="set")
        assert [line["classifier"] for line in lines] == ["one", "two", "oracle"]
        assert [line["test"] for line in lines] == [None, test, None]
        assert lines[1]["precision"]["value"] == 0.5 and lines[2]["f1"]["value"] == 1.0
        assert [line["learned"] for line in lines] == [True, True, False]


class TestSets:
    def test_trained_on_times_tested_on(self) -> None:
        whole = [
            row("a", "paper", "paper", 0.9),
            row("a", "paper", "off", 0.5),
            row("a", "alone", "off", 0.8),
            row("chance", "-", "off", 0.51),
            row("a", "paper", "off", 0.1, snr_db="-5:40"),
            row("a", "paper", "room_0dB/gated", 0.2),
        ]
        found = tables.generalisation(
            whole, Comparison({}, {"paper": None, "off": None}, {}, [], [])
        )  # type: ignore[dict-item]
        assert found["columns"] == ["paper", "off"]
        assert [(line["trained_on"], line["classifier"]) for line in found["lines"]] == [
            ("-", "chance"), ("alone", "a"), ("paper", "a")
        ]  # fmt: skip
        cells = [
            {name: cell["value"] for name, cell in line["cells"].items()} for line in found["lines"]
        ]
        assert cells == [{"off": 0.51}, {"off": 0.8}, {"paper": 0.9, "off": 0.5}]

    def test_the_worst_off_grid_set_counts(self) -> None:
        whole = [
            row("a", "set", name, v)
            for name, v in (("offgrid_1", 0.8), ("offgrid_2", 0.7), ("paper", 0.2))
        ]
        whole += [row("a", "other", "offgrid_1", 0.1), row("chance", "-", "offgrid_1", 0.5)]
        found = tables.worst_off_grid(whole, "set")
        assert {name: cell["value"] for name, cell in found.items()} == {"a": 0.7, "chance": 0.5}

    def test_a_leak_is_the_same_classifier_split_both_ways(self) -> None:
        clean, leaky = (
            row("a", "planar", "planar", 0.8),
            row("a", "planar (row split)", "planar", 0.95),
        )
        alone, elsewhere = (
            row("b", "planar (row split)", "planar", 0.9),
            row("a", "planar (row split)", "paper", 0.7),
        )
        assert tables.leak([clean, leaky, alone, elsewhere]) == [
            {"classifier": "a", "set": "planar", "leaky": leaky, "clean": clean}
        ]

    def test_the_papers_protocol_is_a_mean_over_seeds(self) -> None:
        def figures(auc: float) -> dict[str, float]:
            return {"auc": auc, "balanced_accuracy": auc - 0.1, "accuracy": auc - 0.2}

        folds = {"balanced_accuracy": {"mean": 0.77}}
        runs = [
            Run(
                Path(),
                {
                    "rows": {},
                    "validation": figures(0.9),
                    "test": figures(auc),
                    "cross_validation": crossed,
                },
            )
            for auc, crossed in ((0.7, folds), (0.9, None))
        ]
        [line] = tables.protocol(bare({("a", "set"): runs}))
        assert line["test"] == pytest.approx(figures(0.8))
        assert line["spread"] == pytest.approx(0.1 * 2**0.5)
        assert line["folds"] == 0.77

    def test_a_set_is_described_by_its_rows(self, world: World) -> None:
        dataset = world.sets["scattered"]
        found = tables.describe_set("scattered", dataset)
        assert (found["rows"], found["positions"], found["digest"]) == (140, 140, dataset.digest)
        assert found["reflector"] == pytest.approx(dataset["reflector"].mean())
        assert found["on_map"] == pytest.approx(dataset["on_map"].mean())
        loud = dataset["snr_db"] >= -5
        assert found["right"][-1] == pytest.approx(dataset["reflector"][loud].mean())
        sizes = [
            np.sum((dataset["snr_db"] >= low) & (dataset["snr_db"] < high))
            for low, high in tables.BANDS
        ]
        assert mean(share for share in found["right"]) > 0
        assert np.dot(found["right"], sizes) == pytest.approx(dataset["reflector"].sum())


def test_a_real_comparison_has_every_table(contest: Comparison) -> None:
    source = tables.headline_set(contest)
    best = tables.chosen(contest, source)
    facts = tables.gather(contest, source=source, best=best)
    assert source == "scattered" and best in ("svm_pair", "trees_features")
    assert facts["seeds"] == [0, 1] and facts["runs"] == 7
    assert facts["snrs"] == facts["levels"] == ["0", "-10"]
    [room] = facts["rooms"]
    assert (room["room"], room["poses"]) == ("hall", 36)
    assert set(room["best"]) == {"0", "-10"}
    assert all(line["classifier"] == best for line in room["best"].values())
    assert set(facts["names"]) == {
        "svm_pair", "threshold_peak", "trees_features", "chance", "keep_everything", "keep_nothing", "oracle"
    }  # fmt: skip
    assert facts["leak"] == []
    assert {r["trained_on"] for r in facts["tests"]} == {"scattered"}
    assert set(facts["worst"]) == {"svm_pair", "threshold_peak", "trees_features", "chance"}


def test_a_scattered_set_heads_the_tables_and_rather_one_that_is_tested() -> None:
    runs = {("svm", name): validated(0.5) for name in ("paper", "b_scattered", "a_scattered")}
    contest = bare(runs)
    assert tables.headline_set(contest) == "a_scattered"
    tested: Any = {"paper": {}, "b_scattered": {}}
    assert tables.headline_set(replace(contest, sets=tested)) == "b_scattered"
    assert tables.headline_set(replace(contest, sets={"paper": tested["paper"]})) == "paper"


def test_a_room_is_new_to_a_classifier_unless_its_set_was_made_there() -> None:
    contest = bare(heard={("8x8x5_0dB", "gated"): walk(0.0)})
    sizes = {"there": [[8.0, 8.0, 5.0], [9.0, 8.0, 5.0]], "elsewhere": [[8.0, 7.9, 5.0]]}
    sets: Any = {name: {"room": np.array(size)} for name, size in sizes.items()}
    assert tables.unseen(replace(contest, sets=sets), "elsewhere")
    assert not tables.unseen(replace(contest, sets=sets), "there")
    assert not tables.unseen(contest, "elsewhere")  # nobody knows
