"""What is particular to each method: threshold, SVM, trees, network, ensemble."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from echolearn.checks import BadValue
from echolearn.classifiers import onnx_export
from echolearn.classifiers.architectures import CovarianceNet, Mlp
from echolearn.classifiers.calibration import calibrate, platt
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.inputs import as_input
from echolearn.classifiers.methods.ensemble import Ensemble
from echolearn.classifiers.methods.network import Network, accelerators
from echolearn.classifiers.methods.svm import Svm, some_positions
from echolearn.classifiers.methods.threshold import Threshold
from echolearn.classifiers.methods.trees import Trees
from echolearn.classifiers.standardise import standardiser
from echolearn.evaluation.metrics import auc

Fit = Callable[..., Any]


@pytest.fixture
def fit(tmp_path):
    """Fit a classifier; unless told, each row is a position, and validation rows are the same."""

    def fitted(model, x, y, *, seed=0, **given):
        known = {"groups": np.arange(len(x)), "validation": (x, y), "folder": tmp_path}
        return model.fit(Examples(x, y, seed=seed, **known | given))

    return fitted


class TestThreshold:
    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_ranks_as_the_column_does(self, sign, fit):
        rng = np.random.default_rng(0)
        y = rng.random(200) < 0.5
        x = (rng.normal(size=200) + 2.2 * y)[:, None].astype(np.float32)
        decision = fit(Threshold(["score"]), sign * x, y).decision(sign * x)
        np.testing.assert_array_equal(np.argsort(decision), np.argsort(x[:, 0]))
        assert decision.mean() == pytest.approx(0, abs=1e-9) and decision.std() == pytest.approx(1)


class TestSvm:
    @staticmethod
    def ring(rows, seed):
        x = np.random.default_rng(seed).normal(size=(rows, 2)).astype(np.float32)
        return x, (x**2).sum(axis=1) < 1.4

    @staticmethod
    def svm(c_grid, gamma_grid, **given):
        return Svm(["toa", "power"], c_grid=c_grid, gamma_grid=gamma_grid, **given)

    def test_is_scikit_learns(self, fit):
        x, y = self.ring(300, 0)
        new, _ = self.ring(100, 1)
        model = fit(self.svm([3.0], [0.7]), x, y)
        direct = make_pipeline(StandardScaler(), SVC(C=3.0, gamma=0.7)).fit(x.astype(float), y)
        expected = direct.decision_function(new.astype(float))
        np.testing.assert_allclose(model.decision(new), expected, atol=1e-9)
        scored = model.scorer()(torch.from_numpy(new)).numpy()
        np.testing.assert_allclose(scored, expected, atol=1e-9)

    def test_search_is_scikit_learns(self):
        x, y = self.ring(240, 0)
        groups = np.arange(240) // 2
        model = self.svm([0.1, 1.0], [0.05, 0.5, 5.0])
        found = model.search(x.astype(float), y, groups=groups, seed=4)
        folds = StratifiedGroupKFold(5, shuffle=True, random_state=4)
        grid = {"svc__C": model.c_grid, "svc__gamma": model.gamma_grid}
        machine = make_pipeline(StandardScaler(), SVC())
        search = GridSearchCV(machine, grid, scoring="roc_auc", cv=folds)
        search.fit(x.astype(float), y, groups=groups)
        assert search.best_params_ == {"svc__C": found["c"], "svc__gamma": found["gamma"]}
        spread = search.cv_results_["std_test_score"][search.best_index_]
        assert found["auc"] == pytest.approx(search.best_score_, abs=1e-6)
        assert found["auc_sd"] == pytest.approx(spread, abs=1e-6)

    def test_a_large_set_is_fitted_in_part(self, fit):
        x, y = self.ring(300, 0)
        groups = np.arange(300) // 3
        model = self.svm([1.0], [0.5], search_rows=60, fit_rows=120)
        fit(model, x, y, groups=groups, seed=5)
        found = model.cross_validation
        assert (found["search_rows"], found["fit_rows"]) == (60, 120)
        rows = some_positions(groups, rows=120, seed=5)
        assert {*some_positions(groups, rows=60, seed=5)} < {*rows}
        part = self.svm([1.0], [0.5], search_rows=60)
        fit(part, x[rows], y[rows], groups=groups[rows], seed=5)
        np.testing.assert_array_equal(model.decision(x), part.decision(x))

    def test_folds_keep_positions_together(self, fit):
        """Labels at random by position: only copies in other folds could predict them."""
        rng = np.random.default_rng(0)
        x = np.repeat(rng.normal(size=(60, 2)), 5, axis=0)
        y = np.repeat(rng.random(60) < 0.5, 5)
        model = self.svm([10.0], [100.0])
        apart = fit(model, x, y, groups=np.repeat(np.arange(60), 5)).cross_validation
        assert apart["auc"] < 0.7 and fit(model, x, y).cross_validation["auc"] > 0.95

    def test_search_rows_are_whole_positions(self):
        groups = np.repeat(np.arange(100), 7)
        rows = some_positions(groups, rows=140, seed=0)
        assert len(rows) == 140 and len(np.unique(groups[rows])) == 20
        np.testing.assert_array_equal(some_positions(groups, rows=700, seed=0), np.arange(700))


class TestTrees:
    def test_scorer_is_scikit_learns_raw_prediction(self, fit):
        rng = np.random.default_rng(0)
        x = rng.normal(size=(600, 3)).astype(np.float32)
        y = (x[:, 0] * x[:, 1] > 0) ^ (rng.random(600) < 0.05)
        model = fit(Trees(["a", "b", "c"], iterations=60), x, y, validation=(x[:100], y[:100]))
        on_limits = model.model._bin_mapper.bin_thresholds_[0][:50, None] * np.ones(3)
        new = np.concatenate([rng.normal(size=(500, 3)), on_limits]).astype(np.float32)
        raw = model.model._raw_predict(new.astype(float))[:, 0]
        scored = model.scorer()(torch.from_numpy(new)).numpy()
        np.testing.assert_allclose(scored, raw, atol=1e-12)
        assert auc(y, model.decision(x)) > 0.9

    def test_a_forest_of_stumps_and_single_leaves(self, fit):
        x = np.random.default_rng(0).normal(size=(30, 1)).astype(np.float32)
        y = x[:, 0] > 0
        fitted = calibrate(fit(Trees(["a"], min_leaf=20), x, y), x, y)
        assert onnx_export.export_proved(fitted, x).parity <= 1e-5
        assert np.ptp(fitted.confidence(x)) == 0.0


class TestNetwork:
    @staticmethod
    def xor(rows, seed):
        x = np.random.default_rng(seed).uniform(-1, 1, size=(rows, 2)).astype(np.float32)
        return x, x[:, 0] * x[:, 1] > 0

    @pytest.mark.parametrize("accelerator", ["cpu", "auto", "gpu", "mps"])
    def test_learns_what_no_line_can_wherever_it_is_trained(self, accelerator, fit):
        if accelerator not in accelerators():
            pytest.skip("not on this machine")
        settings = {"epochs": 40, "lr": 0.02, "batch_size": 64, "accelerator": accelerator}
        net = Network(["a", "b"], Mlp(widths=[32]), **settings)
        fit(net, *self.xor(500, 0), validation=self.xor(200, 1))
        new, truth = self.xor(500, 2)
        assert auc(truth, net.decision(new)) > 0.97
        assert net.device == "cpu" or accelerator != "cpu"
        assert not torch.are_deterministic_algorithms_enabled()
        assert {value.device.type for value in net.scorer().state_dict().values()} == {"cpu"}

    def test_an_accelerator_that_is_not_there_is_one_line(self, monkeypatch):
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
        monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
        said = "^classifier.accelerator=gpu: must be what this machine has: cpu, auto$"
        with pytest.raises(BadValue, match=said):
            Network(["a"], Mlp(), accelerator="gpu")

    def test_stops_early_and_keeps_the_best_epoch(self, fit, tmp_path):
        """Pure noise: the validation loss can only rise, so the best epoch is an early one."""
        rng = np.random.default_rng(0)
        x, new = rng.normal(size=(2, 100, 5)).astype(np.float32)
        y, truth = rng.random((2, 100)) < 0.5
        recipe = Mlp(widths=[64], dropout=0.0)
        net = Network([*"abcde"], recipe, epochs=200, patience=4, lr=0.02, weight_decay=0.0)
        fit(net, x, y, validation=(new, truth))
        table = np.genfromtxt(tmp_path / "metrics.csv", delimiter=",", names=True)
        losses = table["valloss"][np.isfinite(table["valloss"])]
        assert 5 <= len(losses) <= 60 and len(losses) - 1 - losses.argmin() == 4
        decision = net.decision(new)
        loss = np.mean(np.logaddexp(0, decision) - truth * decision)
        assert loss == pytest.approx(losses.min(), rel=1e-4)

    def test_covariance_net_takes_any_number_of_bands(self):
        for shape in [(1, 4), (16, 36), (3, 9)]:
            assert CovarianceNet(channels=4)(shape)(torch.zeros(5, *shape)).shape == (5,)

    def test_standardise_bounds_the_tails(self):
        x = np.random.default_rng(0).standard_cauchy((2000, 2)) * [1e-3, 1e3]
        z = standardiser(x)(torch.from_numpy(x.astype(np.float32))).numpy()
        np.testing.assert_allclose([z.mean(axis=0), z.std(axis=0)], [[0, 0], [1, 1]], atol=1e-4)
        assert np.abs(z).max() < 20
        assert (np.diff(z[np.argsort(x[:, 0])[20:-20], 0]) > 0).all()

    def test_a_constant_column_is_harmless(self):
        assert torch.isfinite(standardiser(np.ones((10, 3)))(torch.full((2, 3), 7.0))).all()


MLP = {"inputs": ["a"], "net": Mlp()}
SVM = {"inputs": ["a"]}
BAD = {
    "classifier.lr=abc": (Network, MLP | {"lr": "abc"}),
    "classifier.epochs=1.5": (Network, MLP | {"epochs": 1.5}),
    "classifier.net=": (Network, MLP | {"net": {"widths": [3]}}),
    "classifier.accelerator=abacus: must be what this machine has: cpu, auto": (
        Network,
        MLP | {"accelerator": "abacus"},
    ),
    "net=Mlp": (Network, MLP | {"inputs": ["covariance"]}),
    "net=CovarianceNet": (Network, MLP | {"net": CovarianceNet()}),
    "one tensor alone": (Network, MLP | {"inputs": ["covariance", "toa"]}),
    "net.dropout=2": (Mlp, {"dropout": 2}),
    "net.widths=64": (Mlp, {"widths": 64}),
    "net.widths=[]": (Mlp, {"widths": []}),
    "net.kernel=4": (CovarianceNet, {"kernel": 4}),
    "net.layers=21": (CovarianceNet, {"layers": 21}),
    "classifier.c_grid=0": (Svm, SVM | {"c_grid": [0]}),
    "classifier.gamma_grid=": (Svm, SVM | {"gamma_grid": []}),
    "classifier.search_rows=20000": (Svm, SVM | {"search_rows": 20_000}),
    "classifier.fit_rows=10": (Svm, SVM | {"fit_rows": 10}),
    "classifier.folds=1": (Svm, SVM | {"folds": 1}),
    "columns for this classifier": (Svm, {"inputs": ["covariance"]}),
    "classifier.leaves=many": (Trees, SVM | {"leaves": "many"}),
    "only a simulation knows snr_db": (Trees, {"inputs": ["score", "snr_db"]}),
    "each name once": (Trees, {"inputs": ["score", "score"]}),
    "classifier.inputs=toa": (Threshold, {"inputs": "toa"}),
    "one column": (Threshold, {"inputs": ["a", "b"]}),
}


def test_a_scorer_that_no_runtime_could_compute_is_refused_by_its_operator():
    class Middle(torch.nn.Module):
        def forward(self, x):
            return x.median(1).values

    with pytest.raises(BadValue, match=r"^scorer=median: must be operators of ONNX's set 13; "):
        onnx_export.to_onnx(Middle(), shape=(5,))


@pytest.mark.parametrize("part", BAD)
def test_bad_arguments_are_named_in_one_line(part):
    kind, arguments = BAD[part]
    with pytest.raises(BadValue, match=rf"^.*{re.escape(part)}.*\Z"):
        kind(**arguments)


def test_as_input_names_the_column():
    with pytest.raises(BadValue, match="power=nan in row 1"):
        as_input(np.array([[1.0, 2.0], [3.0, np.nan]]), ["toa", "power"])


class TestEnsemble:
    @staticmethod
    def members():
        svm = Svm(["b"], c_grid=[1.0], gamma_grid=[0.1], folds=2)
        return {"trees": Trees(["a", "b"], iterations=20, min_leaf=5), "svm": svm}

    def test_is_the_mean_of_the_logits_that_its_members_have_alone(self, fit):
        rng = np.random.default_rng(0)
        y = rng.random(300) < 0.5
        x = (rng.normal(size=(300, 2)) + y[:, None]).astype(np.float32)
        logits = []
        for member, columns in zip(self.members().values(), ([0, 1], [1]), strict=True):
            decision = fit(member, x[:, columns], y).decision(x[:, columns])
            slope, intercept = platt(decision, y)
            logits.append(slope * decision + intercept)
        found = fit(Ensemble(self.members()), x, y)
        assert found.inputs == ("a", "b")
        np.testing.assert_allclose(found.decision(x), np.mean(logits, axis=0), rtol=1e-6)

    def test_of_what_does_not_see_the_same_is_refused(self):
        tensors = {name: Network([f"covariance{name}"], CovarianceNet()) for name in ("", "_gated")}
        for members, said in (
            ({"alone": Trees(["a"])}, "must be two classifiers or more, by name"),
            ({**self.members(), "": tensors[""]}, "must all see columns, or all the same tensor"),
            (tensors, "must all see columns, or all the same tensor"),
        ):
            with pytest.raises(BadValue, match=said):
                Ensemble(members)
