"""Estimators of scikit-learn as classifiers: each one's function is written down as it computes."""

import numpy as np
import pytest
import torch
from sklearn.cluster import KMeans
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import (
    ExtraTreesClassifier,
    GradientBoostingClassifier,
    HistGradientBoostingClassifier,
    RandomForestClassifier,
)
from sklearn.linear_model import LogisticRegression, RidgeClassifier, SGDClassifier
from sklearn.neighbors import KNeighborsClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.svm import LinearSVC
from sklearn.tree import DecisionTreeClassifier

from echolearn.checks import BadValue
from echolearn.classifiers.calibration import calibrate
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.methods.sklearn import Sklearn
from echolearn.classifiers.onnx_export import export_proved
from echolearn.classifiers.standardise import standardiser

NAMES = ("score", "level", "agreement")
ESTIMATORS = [
    DecisionTreeClassifier(),
    ExtraTreesClassifier(7),
    GradientBoostingClassifier(n_estimators=5, learning_rate=0.3),
    HistGradientBoostingClassifier(max_iter=5),
    LinearDiscriminantAnalysis(),
    LinearSVC(),
    LogisticRegression(),
    MLPClassifier((4, 3), activation="tanh", max_iter=5),
    MLPClassifier((4,), activation="identity", max_iter=5),
    RandomForestClassifier(7),
    RidgeClassifier(),
    SGDClassifier(),
]


def rows(count, seed):
    """Draw rows of both classes, the second column a thousand times as wide."""
    rng = np.random.default_rng(seed)
    y = rng.random(count) < 0.5
    return ((rng.normal(size=(count, 3)) + 2 * y[:, None]) * [1, 1000, 1]).astype(np.float32), y


def learn(estimator, folder):
    x, y = rows(200, 0)
    examples = Examples(x, y, np.arange(200), rows(60, 1), folder=folder, seed=4)
    return Sklearn(NAMES, estimator).fit(examples)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda each: type(each).__name__)
def test_the_file_computes_what_the_estimator_does(estimator, tmp_path):
    model = learn(estimator, tmp_path)
    assert export_proved(calibrate(model, *rows(60, 1)), rows(60, 2)[0]).parity < 1e-6
    assert not hasattr(estimator, "classes_"), "the user's own object is not fitted"


def test_decisions_are_the_estimators_own_on_standardised_columns_with_the_seed_of_the_run(
    tmp_path,
):
    x, y = rows(200, 0)
    scale = standardiser(x)
    seen, unseen = (scale(torch.from_numpy(each)).numpy().astype(float) for each in (x, x[:9] / 2))
    forest = RandomForestClassifier(7, random_state=4).fit(seen, y)
    found = learn(RandomForestClassifier(7), tmp_path).decision(x[:9] / 2)
    assert np.array_equal(found, forest.predict_proba(unseen)[:, 1])
    plane = RidgeClassifier().fit(seen, y)
    found = learn(RidgeClassifier(), tmp_path).decision(x[:9] / 2)
    assert np.array_equal(found, plane.decision_function(unseen))


@pytest.mark.parametrize(
    ("estimator", "reason"),
    [
        (KMeans(), "^classifier.estimator=KMeans: must have decision_function or predict_proba"),
        (KNeighborsClassifier(), "^classifier.estimator=KNeighbors.*RandomForest.*ONNX"),
        (LogisticRegression(C=-1.0), "^classifier.estimator: The 'C' parameter"),
    ],
)
def test_what_cannot_be_stored_or_is_misset_is_refused_before_any_work(estimator, reason):
    with pytest.raises(BadValue, match=reason) as refused:
        Sklearn(NAMES, estimator)
    assert "\n" not in str(refused.value)
