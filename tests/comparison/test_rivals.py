"""Who is tested against whom, and figures over several rooms: by hand, and by other functions."""

from pathlib import Path

import numpy as np
import pytest

from echolearn.comparison import pooled, rivals
from echolearn.comparison.rivals import Pair
from echolearn.evaluation import metrics, pairs, pooling, stats
from echolearn.evaluation.paired_tests import corrected_t, mcnemar
from echolearn.evaluation.rows import LabelledRows, Model, Predictions, Recordings, pick
from echolearn.training.runs import Run

RNG = np.random.default_rng(0)
REFERENCE = RNG.random(80) < 0.5
GROUPS = np.arange(80) // 2


def labelled(name="offgrid", role="test"):
    weights = stats.cluster_weights(GROUPS, resamples=60)
    source = Recordings(name, "set", set_role=role)
    return LabelledRows(source, REFERENCE, GROUPS, np.zeros(80), weights)


def model(name, trained_on="set", **more):
    role = "baseline" if name.startswith("threshold") else "learned"
    return Model(name, trained_on, role, "", "position", "reflector")._replace(**more)


def says(noise, seed=0):
    rng = np.random.default_rng([seed, int(100 * noise)])
    return Predictions(seed, np.arange(80), REFERENCE + noise * rng.normal(size=80), 0.5)


BARE, TREES, SVM = map(model, ("threshold_peak", "trees", "svm"))
FEWER, BLIND = (model("trees", **change) for change in ({"train_rows": "40"}, {"without": "score"}))
GIVEN = {
    BARE: [says(1.0)],
    TREES: [says(0.5)],
    SVM: [says(0.6)],
    FEWER: [says(0.7)],
    BLIND: [says(0.8)],
    model("trees", split="row"): [says(0.4)],
    model("svm", "other"): [says(0.4)],
    model("late"): [says(0.5, seed=7), says(0.5, seed=8)],
}


def test_everyone_meets_threshold_best_and_whole_model():
    """Who learned by a leaky split meets nobody, nor who has no seed or training in common."""
    found = {*rivals.opponents(GIVEN | {BARE: [says(1.0), says(1.0, 1)]}, {"set": TREES})}
    assert found == {
        Pair(TREES, BARE, "baseline"),
        Pair(SVM, BARE, "baseline"),
        Pair(BARE, TREES, "best"),
        Pair(SVM, TREES, "best"),
        Pair(model("late"), TREES, "best"),
        Pair(FEWER, TREES, "full"),
        Pair(BLIND, TREES, "full"),
    }


def test_further_tests_are_those_of_the_functions_in_families_of_their_own():
    about = {"metric": "auc", "best": {"set": TREES}}
    found = pairs.correct(rivals.further_tests(GIVEN, labelled(), **about))
    [row] = pick(found, classifier="svm", against="trees", test="swaps")
    same = pairs.paired_difference(GIVEN[SVM], GIVEN[TREES], labelled=labelled(), metric="auc")
    assert row.items() >= same.items()
    assert row["tested_on"] == "offgrid" and row["trained_on"] == "set"

    [row] = pick(found, classifier="svm", against="threshold_peak")
    right = [each[0].kept == REFERENCE for each in (GIVEN[SVM], GIVEN[BARE])]
    assert row["p"] == mcnemar(*right, groups=GROUPS) and row["metric"] == "accuracy"
    assert row["difference"] == pytest.approx(right[0].mean() - right[1].mean())
    assert row["ci_low"] < row["difference"] < row["ci_high"] and row["n"] == 40

    # Of three against the threshold, the best p value counts three times.
    family = [each for each in found if each["against"] == "threshold_peak"]
    assert len(family) == 3 and {each["test"] for each in family} == {"mcnemar"}
    assert min(each["p_holm"] for each in family) == 3 * min(each["p"] for each in family)
    ablated = pick(found, without="score", test="swaps")
    assert [each["against"] for each in ablated] == ["trees"]


def crossed(values, seed=0):
    figures = {name: {"values": values} for name in pairs.PAIRED}
    return Run(Path(), {"seed": seed, "cross_validation": {"test_to_training": 0.3} | figures})


def test_folds_are_compared_where_both_have_them():
    """Those of all common seeds together; a run without, or of another seed, adds nothing."""
    models = {
        BARE: [crossed([0.1, 0.2, 0.3]), crossed([0.4, 0.1, 0.2], 1)],
        SVM: [crossed([0.3, 0.4, 0.4]), crossed([0.9, 0.2, 0.3], 1), crossed([1, 1, 1], 2)],
        TREES: [Run(Path(), {"seed": 0, "cross_validation": None})],
        model("none"): [Run(Path(), {"seed": 0, "cross_validation": {}})],
        model("undefined"): [crossed([0.3, None, 0.4])],
    }
    rows = list(rivals.fold_tests(models))
    assert {(row["classifier"], row["metric"]) for row in rows} == {
        ("svm", m) for m in pairs.PAIRED
    }
    differences = np.array([0.2, 0.2, 0.1, 0.5, 0.1, 0.1])
    found, p = corrected_t(differences, test_to_training=0.3)
    for row in rows:
        assert (row["difference"], row["ci_low"], row["ci_high"]) == pytest.approx(found)
        assert (row["p"], row["n"], row["kind"]) == (pytest.approx(p), 6, "folds")


def share(who, room, value, draws, **more):
    source = Recordings(pooled.SETS, kind="pooled", set_role="test")
    given = {"snr_db": "", "metric": "auc", "units": 30} | more
    return pooled.Share(who, source, value=value, draws=np.array(draws), **given)


def test_figures_over_rooms_are_means_and_their_differences_paired():
    draws = np.random.default_rng(1).normal(0.8, 0.02, (2, 2, 500))
    shares = [
        share(who, room, 0.7 + 0.1 * room + 0.05 * number, draws[number, room])
        for number, who in enumerate((BARE, TREES))
        for room in (0, 1)
    ]
    # One who lacks a room, and one figure of a single room, have no mean.
    alone = share(SVM, 0, 0.9, draws[0, 0]), share(TREES, 0, 0.9, draws[0, 0], metric="other")
    rows = list(pooled.pooled_rows([*shares, *alone]))
    assert [(row["classifier"], row["value"]) for row in rows] == [
        ("threshold_peak", pytest.approx(0.75)),
        ("trees", pytest.approx(0.80)),
    ]
    assert {(row["n"], row["kind"], row["tested_on"], row["seed"]) for row in rows} == {
        (2, "pooled", "test sets", "")
    }
    [test] = pooled.pooled_tests([*shares, *alone])
    expected = pooling.pool(np.array([0.05, 0.05]), draws[1] - draws[0], units=60)
    assert test["difference"] == pytest.approx(0.05) and test["against"] == "threshold_peak"
    assert (test["ci_low"], test["ci_high"], test["p"]) == pytest.approx(
        (*expected.figure[1:], expected.p)
    )


def test_only_sets_made_for_testing_are_pooled():
    rows = [TREES.columns() | {"metric": "auc", "value": 0.5, "draws": np.ones(9)}]
    rows.append(rows[0] | {"metric": "f1"})
    del rows[1]["draws"]
    [found] = pooled.set_shares(rows, labelled().source, positions=40)
    assert (found.model, found.metric, found.units) == (TREES, "auc", 40)
    assert not pooled.set_shares(rows, labelled(role="grid").source, positions=40)


def test_walks_are_pooled_by_stretches(comparison):
    """The value is that of the map; draws of neighbours that are right together scatter more."""
    survey = next(iter(comparison.surveys.values()))
    reference = survey.labelled.reference
    count = len(reference)
    half = Predictions(0, np.arange(count), np.where(np.arange(count) < count // 2, 1.0, 0.0), 0.5)
    found = {each.metric: each for each in pooled.walk_shares({TREES: [half]}, survey)}
    expected = metrics.rates(reference, half.kept)
    assert {name: each.value for name, each in found.items()} == pytest.approx(
        {title: float(expected[name]) for name, title in pooled.OF_MAPS.items()}
    )
    each = found["true_retention"]
    assert each.units == count // stats.stretch(count)
    alone = metrics.rates(reference, half.kept, weights=survey.labelled.weights)["recall"]
    assert each.draws.std() > 1.3 * alone.std()
