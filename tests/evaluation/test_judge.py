"""Rows of results by hand, intervals from hand-made resamples, and tests that know which of two is
better."""

from collections.abc import Mapping

import numpy as np
import pytest

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.evaluation import scoring, stats
from echolearn.evaluation.scoring import Answer, Heard, Row, Sheet

REFERENCE = np.array([True, True, True, False, False, False])
WHO = ("some", "set")


def sheet(reference: Array, *, snr_db: Array | float = 0.0, weights: Array | None = None) -> Sheet:
    """Return a sheet with a position per row."""
    rows = len(reference)
    weights = stats.cluster_weights(np.arange(rows), resamples=60) if weights is None else weights
    return Sheet("exam", reference, np.arange(rows), np.broadcast_to(snr_db, rows), weights)


def answer(confidence: Array | list[float], *, seed: int = 0, rows: Array | None = None) -> Answer:
    """Return an answer about all rows, with its cut at 0.5."""
    confidence = np.array(confidence, dtype=float)
    return Answer(seed, np.arange(len(confidence)) if rows is None else rows, confidence, 0.5)


def value(rows: list[Row], metric: str, **wanted: object) -> float:
    """Return the one value of a metric."""
    [row] = [
        row
        for row in rows
        if row["metric"] == metric and all(row[key] == wanted[key] for key in wanted)
    ]
    return float(row["value"])


FIRST = answer(
    [0.9, 0.8, 0.4, 0.6, 0.2, 0.1], seed=3
)  # keeps 2 of 3 reflectors, drops 2 of 3 others
SECOND = answer([0.9, 0.8, 0.7, 0.3, 0.2, 0.1], seed=8)  # is always right


class TestRows:
    def test_one_row_per_seed_and_their_mean(self) -> None:
        rows = list(scoring.judge_labels(WHO, [FIRST, SECOND], sheet(REFERENCE)))
        whole = [row for row in rows if row["snr_db"] == ""]
        assert value(whole, "accuracy", seed=3) == pytest.approx(4 / 6)
        assert value(whole, "accuracy", seed=8) == 1.0
        assert value(whole, "accuracy", seed="") == pytest.approx(5 / 6)
        assert value(whole, "auc", seed=3) == pytest.approx(8 / 9)  # 0.4 ranks below 0.6
        assert value(whole, "auc", seed="") == pytest.approx(17 / 18)
        for metric in {row["metric"] for row in whole}:
            mean = (value(whole, metric, seed=3) + value(whole, metric, seed=8)) / 2
            assert value(whole, metric, seed="") == pytest.approx(mean)

    def test_every_row_says_who_and_where(self) -> None:
        rows = list(scoring.judge_labels(WHO, [FIRST, SECOND], sheet(REFERENCE)))
        assert {(row["classifier"], row["trained_on"], row["tested_on"]) for row in rows} == {
            ("some", "set", "exam")
        }
        assert {row["noise"] for row in rows} == {"white"}
        assert all((row["ci_low"], row["ci_high"]) == ("", "") for row in rows if row["seed"] != "")

    def test_a_lone_seed_is_the_mean(self) -> None:
        rows = list(scoring.judge_labels(WHO, [FIRST], sheet(REFERENCE)))
        assert {row["seed"] for row in rows} == {""}

    def test_what_one_seed_leaves_undefined_has_no_mean(self) -> None:
        nothing = answer(np.zeros(6), seed=8)
        rows = [
            row
            for row in scoring.judge_labels(WHO, [FIRST, nothing], sheet(REFERENCE))
            if row["snr_db"] == ""
        ]
        assert np.isnan(value(rows, "precision", seed=8)) and np.isnan(
            value(rows, "precision", seed="")
        )
        assert value(rows, "specificity", seed="") == pytest.approx((2 / 3 + 1) / 2)

    def test_rows_are_counted_as_the_mean_over_seeds(self) -> None:
        seeds = [
            answer([0.9, 0.1], seed=0, rows=np.array([0, 3])),
            answer([0.9] * 4, seed=1, rows=np.array([0, 1, 3, 4])),
        ]
        assert {
            row["n"]
            for row in scoring.judge_labels(WHO, seeds, sheet(REFERENCE))
            if row["snr_db"] == ""
        } == {3}


class TestIntervals:
    WEIGHTS = np.array(
        [[3, 0, 0, 1, 1, 1], [0, 3, 0, 2, 1, 0], [1, 1, 1, 0, 0, 3], [0, 0, 3, 1, 1, 1]],
        dtype=float,
    )

    @staticmethod
    def confidence(given: Answer, weights: Array | None) -> Mapping[str, Array]:
        """Return the weighted mean of what was answered."""
        each = np.ones(len(given.rows)) if weights is None else weights
        return {"mean": each @ given.confidence / each.sum(axis=-1)}

    def test_an_interval_holds_the_middle_of_the_resampled_means(self) -> None:
        """Every draw is the mean over seeds for the same drawn positions."""
        rows = list(
            scoring.judge(
                WHO, [FIRST, SECOND], sheet(REFERENCE, weights=self.WEIGHTS), self.confidence
            )
        )
        draws = [sum(w @ a.confidence / 6 for a in (FIRST, SECOND)) / 2 for w in self.WEIGHTS]
        assert rows[-1]["value"] == pytest.approx(np.mean([FIRST.confidence, SECOND.confidence]))
        assert [rows[-1]["ci_low"], rows[-1]["ci_high"]] == pytest.approx(
            np.quantile(draws, [0.025, 0.975]).tolist()
        )

    def test_each_seed_is_resampled_on_its_own_rows(self) -> None:
        """Seeds that hold out other rows take other columns of the shared resamples."""
        seeds = [
            answer([0.2, 0.6], rows=np.array([1, 4])),
            answer([0.5, 0.9], seed=1, rows=np.array([2, 5])),
        ]
        weights = 1 + self.WEIGHTS
        rows = list(scoring.judge(WHO, seeds, sheet(REFERENCE, weights=weights), self.confidence))
        draws = [
            ((w[1] * 0.2 + w[4] * 0.6) / (w[1] + w[4]) + (w[2] * 0.5 + w[5] * 0.9) / (w[2] + w[5]))
            / 2
            for w in weights
        ]
        assert [rows[-1]["ci_low"], rows[-1]["ci_high"]] == pytest.approx(
            np.quantile(draws, [0.025, 0.975]).tolist()
        )

    def test_a_metric_without_resamples_has_no_interval(self) -> None:
        def whole_only(given: Answer, weights: Array | None) -> Mapping[str, Array]:
            return {"whole": np.array(2.0)} if weights is None else {}

        [row] = scoring.judge(WHO, [FIRST], sheet(REFERENCE), whole_only)
        assert row["value"] == 2.0 and np.isnan([row["ci_low"], row["ci_high"]]).all()


class TestBands:
    SNR_DB = np.array([-40.0, -20.1, -20.0, -15.0, -10.0, -5.0, 0.0, 40.0, 40.5, -41.0])
    REFERENCE = np.array([True, False, True, False, True, True, False, False, True, True])

    def banded(self, *given: Answer) -> dict[str, list[Row]]:
        rows = list(scoring.judge_labels(WHO, given, sheet(self.REFERENCE, snr_db=self.SNR_DB)))
        bands = dict.fromkeys(row["snr_db"] for row in rows if row["snr_db"])
        return {band: [row for row in rows if row["snr_db"] == band] for band in bands}

    def test_a_band_holds_its_lower_end_and_the_last_one_both(self) -> None:
        found = self.banded(answer(np.linspace(0, 1, 10)))
        sizes = {band: rows[0]["n"] for band, rows in found.items()}
        assert sizes == {"-40:-20": 2, "-20:-15": 1, "-15:-10": 1, "-10:-5": 1, "-5:40": 3}

    def test_a_band_is_judged_by_its_own_rows(self) -> None:
        right_below = np.where(self.SNR_DB < -20, self.REFERENCE, ~self.REFERENCE).astype(float)
        found = self.banded(answer(right_below))
        assert value(found["-40:-20"], "auc") == value(found["-40:-20"], "balanced_accuracy") == 1.0
        assert value(found["-5:40"], "auc") == value(found["-5:40"], "balanced_accuracy") == 0.0
        assert {row["metric"] for row in found["-5:40"]} == {"auc", "balanced_accuracy"}

    def test_seeds_with_other_rows_find_theirs(self) -> None:
        """Held-out rows 5, 6 and 7 of one seed, 5 and 7 of the other, in the order of the rows."""
        one, other = (
            answer([0.9, 0.1, 0.2], rows=np.array([5, 6, 7])),
            answer([0.1, 0.9], seed=1, rows=np.array([5, 7])),
        )
        found = self.banded(one, other)
        assert list(found) == ["-5:40"]
        assert value(found["-5:40"], "auc") == pytest.approx((1.0 + 0.0) / 2)
        assert {row["seed"] for row in found["-5:40"]} == {""}

    def test_a_band_that_a_seed_has_no_row_in_is_left_out(self) -> None:
        one, other = (
            answer([0.9, 0.1], rows=np.array([0, 6])),
            answer([0.9, 0.1], seed=1, rows=np.array([5, 6])),
        )
        assert list(self.banded(one, other)) == ["-5:40"]


def heard(points: Array, poses: Array) -> Heard:
    """Return a walk through a room of 6 x 4 m."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]])
    inside = np.minimum(points, corners[2] - points).min(axis=1)
    return Heard(sheet(np.abs(inside) <= 0.1), points, poses, corners, {})


ROOM = heard(
    np.array([[0.0, 2.0], [3.0, 0.05], [5.95, 2.0], [3.0, 3.5], [2.0, 2.0]]),
    np.array([[1.5, 2.0], [3.0, 1.5], [4.5, 2.0], [3.0, 2.5], [3.0, 2.0]]),
)  # three points on walls, one 0.5 m off, one 2 m off; the last two poses are 1.5 and 2 m from a wall


@pytest.fixture(scope="module")
def yards() -> dict[str, list[Row]]:
    rng = np.random.default_rng(0)
    points = rng.uniform([0, 0], [6, 4], (2000, 2))
    points[rng.random(2000) < 0.3, 0] = 0.0
    walk = heard(points, np.tile([[1.5, 2.0]], (2000, 1)))
    marks = scoring.yardsticks(walk.sheet.reference)
    rows = {
        name: list(scoring.judge_map((name, "-"), [given], walk, snr_db="0"))
        for name, given in marks.items()
    }
    return rows | {"share": [{"metric": "share", "value": walk.sheet.reference.mean()}]}


class TestMaps:
    def test_a_map_by_hand(self) -> None:
        given = answer([0.9, 0.8, 0.3, 0.7, 0.1])
        rows = list(scoring.judge_map(WHO, [given], ROOM, snr_db="-5"))
        assert {row["snr_db"] for row in rows} == {"-5"}
        assert value(rows, "precision") == pytest.approx(2 / 3)
        assert value(rows, "true_retention") == pytest.approx(2 / 3)
        assert value(rows, "spurious_removal") == pytest.approx(1 / 2)
        assert value(rows, "error_mean") == pytest.approx((0.0 + 0.05 + 0.5) / 3)
        [coverage] = [row for row in rows if row["metric"] == "wall_coverage"]
        assert 0 < coverage["value"] < 1 and np.isnan(coverage["ci_low"])

    def test_the_cut_is_the_runs_own(self) -> None:
        strict = Answer(0, np.arange(5), np.array([0.9, 0.8, 0.3, 0.7, 0.1]), 0.85)
        assert value(
            list(scoring.judge_map(WHO, [strict], ROOM, snr_db="")), "true_retention"
        ) == pytest.approx(1 / 3)

    def test_attainable_is_the_share_of_poses_near_a_wall(self) -> None:
        assert ROOM.attainable == 1.0
        far = np.vstack(
            [ROOM.poses[:4], [[3.0, 3.5]]]
        )  # 0.5 m from one wall, 3 m and more from all others
        assert heard(ROOM.points, far).attainable == pytest.approx(4 / 5)

    def test_the_oracle_is_perfect(self, yards: dict[str, list[Row]]) -> None:
        for metric in "precision true_retention spurious_removal balanced_accuracy f1 average_precision".split():
            assert value(yards["oracle"], metric) == 1.0
        assert value(yards["oracle"], "expected_calibration_error") == 0.0

    def test_keeping_everything_loses_nothing_and_removes_nothing(
        self, yards: dict[str, list[Row]]
    ) -> None:
        assert value(yards["keep_everything"], "true_retention") == 1.0
        assert value(yards["keep_everything"], "spurious_removal") == 0.0
        assert value(yards["keep_everything"], "precision") == pytest.approx(
            value(yards["share"], "share")
        )

    def test_keeping_nothing_has_no_precision(self, yards: dict[str, list[Row]]) -> None:
        assert np.isnan(value(yards["keep_nothing"], "precision"))
        assert value(yards["keep_nothing"], "true_retention") == 0.0
        assert value(yards["keep_nothing"], "spurious_removal") == 1.0

    def test_a_coin_keeps_half_of_either(self, yards: dict[str, list[Row]]) -> None:
        """Four standard deviations of half of at least 600 points are 8 %."""
        assert value(yards["chance"], "true_retention") == pytest.approx(0.5, abs=0.08)
        assert value(yards["chance"], "spurious_removal") == pytest.approx(0.5, abs=0.08)
        assert value(yards["chance"], "precision") == pytest.approx(
            value(yards["share"], "share"), abs=0.08
        )

    def test_the_coin_is_always_the_same(self) -> None:
        one, other = (
            scoring.yardsticks(np.ones(50, dtype=bool))["chance"].confidence for _ in range(2)
        )
        assert np.array_equal(one, other)


@pytest.fixture(scope="module")
def exam() -> Sheet:
    return sheet(np.random.default_rng(1).random(120) < 0.5)


class TestPairs:
    @staticmethod
    def noisy(exam: Sheet, noise: float, *, seed: int = 0) -> Answer:
        rng = np.random.default_rng([seed, round(10 * noise)])
        logit = 2.0 * exam.reference - 1 + noise * rng.normal(size=len(exam.reference))
        return answer(1 / (1 + np.exp(-logit)), seed=seed)

    @pytest.mark.parametrize("metric", ["auc", "balanced_accuracy"])
    def test_the_better_one_is_ahead_whichever_way_one_looks(
        self, exam: Sheet, metric: str
    ) -> None:
        good, bad = [self.noisy(exam, 0.5)], [self.noisy(exam, 4.0)]
        ahead, behind = (
            scoring.compare_pair(*pair, exam, metric=metric) for pair in ((good, bad), (bad, good))
        )
        assert ahead["difference"] > 0.2 and ahead["ci_low"] > 0 and ahead["p"] < 0.01
        assert behind["difference"] == pytest.approx(-ahead["difference"])
        assert behind["ci_high"] < 0
        assert ahead["n"] == 120 and ahead["metric"] == metric

    @pytest.mark.parametrize("metric", ["auc", "balanced_accuracy"])
    def test_nobody_is_better_than_himself(self, exam: Sheet, metric: str) -> None:
        given = [self.noisy(exam, 1.0)]
        found = scoring.compare_pair(given, given, exam, metric=metric)
        assert (found["difference"], found["p"]) == (0.0, 1.0)

    def test_the_difference_is_that_of_the_means_over_common_seeds(self, exam: Sheet) -> None:
        good = [self.noisy(exam, 1.0, seed=seed) for seed in (0, 1, 2)]
        bad = [self.noisy(exam, 3.0, seed=seed) for seed in (2, 1)]
        found = scoring.compare_pair(good, bad, exam, metric="balanced_accuracy")
        shares = [_balanced(exam, given) for given in (*good[1:], *bad)]
        assert found["difference"] == pytest.approx(sum(shares[:2]) / 2 - sum(shares[2:]) / 2)

    def test_a_lone_seed_meets_all_of_the_others(self, exam: Sheet) -> None:
        good, bad = (
            [self.noisy(exam, 1.0, seed=seed) for seed in (0, 1)],
            [self.noisy(exam, 3.0, seed=7)],
        )
        found = scoring.compare_pair(good, bad, exam, metric="balanced_accuracy")
        shares = [_balanced(exam, given) for given in (*good, *bad)]
        assert found["difference"] == pytest.approx(sum(shares[:2]) / 2 - shares[2])

    def test_without_a_common_seed_there_is_nothing_to_pair(self, exam: Sheet) -> None:
        first, second = (
            [self.noisy(exam, 1.0, seed=seed) for seed in seeds] for seeds in ((0, 1), (2, 3))
        )
        assert scoring.paired(first, second) == []
        with pytest.raises(BadValue, match=r"^seeds=\[0, 1\]: one in common"):
            scoring.compare_pair(first, second, exam, metric="auc")

    def test_rows_of_one_position_swap_together(self) -> None:
        """Ten rows in two positions leave four swaps, half of them as far apart as what was seen."""
        reference = np.array([True] * 5 + [False] * 5)
        two = Sheet("exam", reference, np.array([0, 1] * 5), np.zeros(10), np.ones((1, 10)))
        found = scoring.compare_pair(
            [answer(reference)], [answer(~reference)], two, metric="balanced_accuracy"
        )
        assert found["difference"] == 1.0 and found["n"] == 2
        assert found["p"] == pytest.approx(0.5, abs=0.07)

    def test_holm_counts_the_tests_of_the_same_metric_and_training_set(self) -> None:
        tests = [{"metric": "auc", "trained_on": "a", "p": p} for p in (0.01, 0.04, 0.03)]
        tests += [{"metric": "balanced_accuracy", "trained_on": "a", "p": 0.2}]
        assert (
            scoring.correct([*tests, {"metric": "auc", "trained_on": "b", "p": 0.5}])[-1]["p_holm"]
            == 0.5
        )
        corrected = scoring.correct(tests)
        assert [row["p_holm"] for row in corrected] == pytest.approx([0.03, 0.06, 0.06, 0.2])
        assert [row["p"] for row in corrected] == [row["p"] for row in tests]
        assert scoring.correct([]) == []

    def test_a_perfect_classifier_is_significant_among_many_tests(self) -> None:
        """The smallest p value, of so many swaps, times the tests of a family must stay well below
        0.05."""
        reference = np.arange(200) % 3 == 0
        coin = np.random.default_rng(0).uniform(size=200)
        exam = Sheet("set", reference, np.arange(200), np.zeros(200), np.ones((20, 200)))
        sure, unsure = (
            Answer(0, np.arange(200), values, 0.5) for values in (reference.astype(float), coin)
        )
        found = scoring.compare_pair([sure], [unsure], exam, metric="balanced_accuracy")
        family = [
            found | {"trained_on": "a"},
            *({"metric": "balanced_accuracy", "trained_on": "a", "p": 0.9},) * 79,
        ]
        assert scoring.correct(family)[0]["p_holm"] < 0.02


def _balanced(exam: Sheet, given: Answer) -> float:
    kept = given.confidence >= 0.5
    return float(kept[exam.reference].mean() + (~kept)[~exam.reference].mean()) / 2
