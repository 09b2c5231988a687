"""Classifiers as estimators of scikit-learn's kind."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GroupKFold, cross_val_score
from sklearn.utils.estimator_checks import check_estimator

import echolearn as el
from echolearn.checks import BadValue


def rows(names, count=200, seed=0):
    """Draw columns that tell of the label, two rows a position."""
    rng = np.random.default_rng(seed)
    y = rng.random(count) < 0.5
    return rng.normal(size=(count, len(names))) + y[:, None], y, np.arange(count) // 2


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("trees_features", {"iterations": 20, "min_leaf": 5}),
        ("svm_pair", {"c_grid": [1.0], "gamma_grid": [0.1]}),
        ("threshold_peak", {}),
    ],
)
def test_ours_are_cross_validated_by_scikit_learn(name, settings):
    model = el.filter(name, **settings)
    x, y, groups = rows(model.classifier.inputs)
    about = {"cv": GroupKFold(3), "groups": groups}
    scores = cross_val_score(model, x, y, scoring="roc_auc", **about)
    assert scores.min() > 0.7
    model.fit(x, y, groups=groups)
    proba = model.predict_proba(x)
    assert np.allclose(proba[:, 1], model.calibrated_.confidence(x.astype(np.float32)))
    assert np.array_equal(model.predict(x), proba[:, 1] > 0.5) and 0 < model.threshold_ < 1
    # Equal seeds, equal answers; the classifier that was given stays unfitted.
    again = clone(model).fit(x, y, groups=groups)
    assert np.array_equal(again.decision_function(x), model.decision_function(x))
    assert vars(model.classifier) == vars(el.filter(name, **settings).classifier)


def test_a_table_gives_the_columns_of_the_names_in_their_order():
    pandas = pytest.importorskip("pandas")
    model = el.filter("svm_score_power", c_grid=[1.0], gamma_grid=[0.1])
    x, y, _ = rows(model.classifier.inputs)
    table = pandas.DataFrame({"power": x[:, 1], "toa": 0.0, "score": x[:, 0]})
    by_table = model.fit(table, y).predict_proba(table)
    assert np.array_equal(by_table, clone(model).fit(x, y).predict_proba(x))


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"classifier": "tres"}, "tres"),
        ({"iterationz": 3}, "iterationz.*iterations"),
        ({"iterations": 0}, "^classifier.iterations=0"),
    ],
)
def test_other_names_keys_and_values_are_refused(arguments, reason):
    with pytest.raises((BadValue, Exception), match=reason):
        el.filter(**arguments)


@pytest.mark.release
def test_it_keeps_the_rules_of_an_estimator():
    """All of them for two classes: labels of any kind, columns of any number, odd arrays."""
    model = el.filter("trees_features", iterations=5, min_leaf=2, any_columns=True)
    found = check_estimator(model, on_skip=None)
    left_out = {check["check_name"] for check in found if check["status"] != "passed"}
    assert left_out <= {"check_array_api_input", "check_classifier_data_not_an_array"}
    assert len(found) > 50
