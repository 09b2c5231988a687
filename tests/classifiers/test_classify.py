"""Classifiers: one contract for every configuration, then what is particular to each method."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.classifiers import inference, onnx_export
from echolearn.classifiers.architectures import CovarianceNet, Mlp
from echolearn.classifiers.calibration import Calibrated, best_threshold, calibrate, platt
from echolearn.classifiers.inputs import as_input, view_of
from echolearn.classifiers.methods.network import Network
from echolearn.classifiers.methods.svm import Svm, some_positions
from echolearn.classifiers.methods.threshold import Threshold
from echolearn.classifiers.methods.trees import Trees
from echolearn.classifiers.standardise import Standardise
from echolearn.cli import config
from echolearn.evaluation.metrics import auc

NAMES = sorted(path.stem for path in (config.folder() / "classifier").glob("*.yaml"))
QUICK = {
    "Network": {"epochs": 12, "patience": 12, "batch_size": 32, "lr": 5e-3},
    "Svm": {"c_grid": [1.0, 10.0], "gamma_grid": [0.01, 0.1]},
    "Trees": {"iterations": 25, "min_leaf": 5},
}


def plain(name: str) -> dict[str, Any]:
    """Return a classifier's configuration as the command line composes it."""
    with initialize_config_dir(str(config.folder()), version_base=None):
        composed = compose(overrides=[f"+classifier={name}"])
    return OmegaConf.to_container(composed, resolve=True)["classifier"]  # type: ignore[return-value, index]


def quick(name: str) -> Any:
    """Build a classifier with settings for small problems."""
    keys = plain(name)
    return config.build(keys | QUICK.get(keys["_target_"].rpartition(".")[2], {}))


def problem(inputs: tuple[str, ...], *, rows: int, seed: int) -> tuple[Array, Array]:
    """Draw rows whose every entry tells a little, in units of very different size."""
    rng = np.random.default_rng(seed)
    y = rng.random(rows) < 0.5
    shape = (4, 36) if inputs[0].startswith("covariance") else (len(inputs),)
    push = 0.5 if len(shape) == 2 else 2.2
    scale = 10.0 ** np.linspace(-3, 2, shape[-1])
    x = rng.normal(size=(rows, *shape)) + push * y.reshape(-1, *[1] * len(shape))
    return (x * scale + scale).astype(np.float32), y


def learn(model: Any, folder: Path, seed: int = 3) -> Any:
    """Fit on 240 rows, two for each position."""
    (x, y), validation = (
        problem(model.inputs, rows=240, seed=0),
        problem(model.inputs, rows=80, seed=1),
    )
    return model.fit(
        x, y, groups=np.arange(240) // 2, validation=validation, folder=folder, seed=seed
    )


@pytest.fixture(scope="module", params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def folder(name: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp(name)


@pytest.fixture(scope="module")
def fitted(name: str, folder: Path) -> Any:
    return learn(quick(name), folder)


@pytest.fixture(scope="module")
def calibrated(fitted: Any) -> Calibrated:
    return calibrate(fitted, *problem(fitted.inputs, rows=80, seed=1))


@pytest.fixture(scope="module")
def exported(calibrated: Calibrated) -> bytes:
    return onnx_export.export_proved(
        calibrated, problem(calibrated.classifier.inputs, rows=50, seed=2)[0]
    ).data


def test_the_configurations_of_the_plan_are_there() -> None:
    columns = {
        "svm_pair": ["toa", "power"],
        "svm_score_power": ["score", "power"],
        "threshold_peak": ["peak_to_rms"],
    }
    assert all(plain(name)["inputs"] == inputs for name, inputs in columns.items())
    wide = [plain(f"{method}_features")["inputs"] for method in ("svm", "trees", "mlp")]
    assert wide[0] == wide[1] == wide[2] and len(wide[0]) == 11
    assert not {"toa", "power", "gain", "azimuth"} & set(wide[0])
    tensors = {plain(name)["inputs"][0] for name in NAMES if name.startswith("covnet")}
    assert tensors == {"covariance", "covariance_gated", "covariance_steered"}


class TestContract:
    """What every `conf/classifier/*.yaml` must keep."""

    def test_configuration_is_a_call_that_can_be_made_as_it_stands(self, name: str) -> None:
        text = (config.folder() / "classifier" / f"{name}.yaml").read_text()
        assert text.startswith("_target_: echolearn.classifiers.methods.")
        assert view_of(config.build(plain(name)).inputs) == (
            "covariance" if "covnet" in name else "features"
        )

    def test_separates_unseen_rows(self, fitted: Any) -> None:
        x, y = problem(fitted.inputs, rows=300, seed=2)
        decision = fitted.decision(x)
        assert decision.shape == (300,) and decision.dtype == np.float64
        assert auc(y, decision) > 0.9

    def test_same_seed_same_decisions(self, name: str, fitted: Any, tmp_path: Path) -> None:
        x = problem(fitted.inputs, rows=50, seed=2)[0]
        before = torch.get_rng_state(), np.random.get_state()[1].copy()
        again = learn(quick(name), tmp_path)
        np.testing.assert_array_equal(again.decision(x), fitted.decision(x))
        assert (
            torch.equal(before[0], torch.get_rng_state())
            and (before[1] == np.random.get_state()[1]).all()
        )

    def test_file_computes_the_same_confidences(
        self, calibrated: Calibrated, exported: bytes
    ) -> None:
        x = problem(calibrated.classifier.inputs, rows=5000, seed=5)[0]
        x = np.concatenate([x, *onnx_export.strange(x, 5000)])
        assert len(x) == 10_000 and np.isfinite(x).all()
        assert {0.0, *np.finfo(np.float32).max * np.array([1.0, -1.0])} <= {
            *x.reshape(len(x), -1)[:, 0].tolist()
        }
        score = inference.open_onnx(exported)
        difference = np.abs(score(x) - calibrated.confidence(x))
        assert np.isfinite(difference).all() and difference.max() <= 1e-5

    def test_any_batch(self, fitted: Any, exported: bytes) -> None:
        x = problem(fitted.inputs, rows=inference.BLOCK + 1, seed=6)[0]
        score = inference.open_onnx(exported)
        whole = score(x)
        assert whole.shape == (len(x),) and score(x[:0]).shape == (0,)
        np.testing.assert_allclose(
            np.concatenate([score(x[:1]), score(x[1:8])]), whole[:8], atol=1e-6
        )

    def test_file_holds_plain_operations_and_no_traces(self, exported: bytes) -> None:
        model = onnx.load_from_string(exported)
        onnx.checker.check_model(model)
        assert [i.name for i in model.graph.input] == ["x"] and [
            o.name for o in model.graph.output
        ] == ["confidence"]
        assert {o.domain for o in model.opset_import} == {""} and not model.functions
        assert not any(
            t.HasField("data_location") and t.data_location for t in model.graph.initializer
        )
        assert model.producer_name == "echolearn"
        assert b".py" not in exported and b"/" + b"work" not in exported

    def test_leaves_nothing_that_needs_unpickling(self, fitted: Any, folder: Path) -> None:
        for path in (p for p in folder.rglob("*") if p.is_file()):
            assert path.suffix in (".csv", ".yaml", ".ckpt") or "tfevents" in path.name
            if path.suffix == ".ckpt":
                torch.load(path, weights_only=True)

    def test_float64_inputs_are_rounded_first(self, fitted: Any) -> None:
        x = problem(fitted.inputs, rows=40, seed=7)[0]
        near = x.astype(float) * (1 + 1e-9)
        np.testing.assert_array_equal(fitted.decision(near), fitted.decision(x))

    def test_what_is_not_finite_is_refused(self, fitted: Any) -> None:
        x = problem(fitted.inputs, rows=4, seed=7)[0].astype(float)
        x[2, 0] = 1e300
        with pytest.raises(BadValue, match=f"{fitted.inputs[0]}=.*row 2"):
            fitted.decision(x)

    def test_the_other_view_is_refused(self, fitted: Any) -> None:
        with pytest.raises(BadValue, match="x.shape"):
            fitted.decision(
                np.zeros((3, 5, 36)) if view_of(fitted.inputs) == "features" else np.zeros((3, 2))
            )

    def test_one_class_is_refused(self, name: str, tmp_path: Path) -> None:
        model = quick(name)
        x = problem(model.inputs, rows=60, seed=0)[0]
        y = np.ones(60, dtype=bool)
        with pytest.raises(BadValue, match="both classes"):
            model.fit(x, y, groups=np.arange(60), validation=(x, y), folder=tmp_path, seed=0)


class TestThreshold:
    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_ranks_as_the_column_does(self, sign: float, tmp_path: Path) -> None:
        x, y = problem(("score",), rows=200, seed=0)
        model = Threshold(["score"]).fit(
            sign * x, y, groups=y, validation=(x, y), folder=tmp_path, seed=0
        )
        decision = model.decision(sign * x)
        np.testing.assert_array_equal(np.argsort(decision), np.argsort(x[:, 0]))
        assert decision.mean() == pytest.approx(0, abs=1e-9) and decision.std() == pytest.approx(1)


class TestSvm:
    @staticmethod
    def ring(rows: int, seed: int) -> tuple[Array, Array]:
        x = np.random.default_rng(seed).normal(size=(rows, 2)).astype(np.float32)
        return x, (x**2).sum(axis=1) < 1.4

    def test_is_scikit_learns(self, tmp_path: Path) -> None:
        from sklearn.preprocessing import StandardScaler
        from sklearn.svm import SVC

        (x, y), (new, _) = self.ring(300, 0), self.ring(100, 1)
        model = Svm(["toa", "power"], c_grid=[3.0], gamma_grid=[0.7])
        model.fit(x, y, groups=np.arange(300), validation=(x, y), folder=tmp_path, seed=0)
        scaler = StandardScaler().fit(x.astype(float))
        direct = SVC(C=3.0, gamma=0.7).fit(scaler.transform(x.astype(float)), y)
        expected = direct.decision_function(scaler.transform(new.astype(float)))
        np.testing.assert_allclose(model.decision(new), expected, atol=1e-9)
        np.testing.assert_allclose(
            model.scorer()(torch.from_numpy(new)).numpy(), expected, atol=1e-9
        )

    def test_search_is_scikit_learns(self, tmp_path: Path) -> None:
        from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
        from sklearn.svm import SVC

        (x, y), groups = self.ring(240, 0), np.arange(240) // 2
        model = Svm(["toa", "power"], c_grid=[0.1, 1.0], gamma_grid=[0.05, 0.5, 5.0])
        found = model.search(x.astype(float), y, groups=groups, seed=4)
        folds = StratifiedGroupKFold(5, shuffle=True, random_state=4)
        grid = {"svc__C": model.c_grid, "svc__gamma": model.gamma_grid}
        search = GridSearchCV(
            make_pipeline(StandardScaler(), SVC()), grid, scoring="roc_auc", cv=folds
        )
        search.fit(x.astype(float), y, groups=groups)
        assert search.best_params_ == {"svc__C": found["c"], "svc__gamma": found["gamma"]}
        assert found["auc"] == pytest.approx(search.best_score_, abs=1e-6)
        assert found["auc_sd"] == pytest.approx(
            search.cv_results_["std_test_score"][search.best_index_], abs=1e-6
        )

    def test_a_large_set_is_fitted_in_part(self, tmp_path: Path) -> None:
        (x, y), groups = self.ring(300, 0), np.arange(300) // 3
        settings = {
            "inputs": ["toa", "power"],
            "c_grid": [1.0],
            "gamma_grid": [0.5],
            "search_rows": 60,
        }
        model = Svm(**settings, fit_rows=120)
        model.fit(x, y, groups=groups, validation=(x, y), folder=tmp_path, seed=5)
        assert (model.cross_validation["search_rows"], model.cross_validation["fit_rows"]) == (
            60,
            120,
        )
        rows = some_positions(groups, rows=120, seed=5)
        assert len(np.unique(groups[rows])) == 40 and set(
            some_positions(groups, rows=60, seed=5)
        ) < set(rows)
        part = Svm(**settings).fit(
            x[rows], y[rows], groups=groups[rows], validation=(x, y), folder=tmp_path, seed=5
        )
        np.testing.assert_array_equal(model.decision(x), part.decision(x))

    def test_search_finds_the_kernel_width(self, tmp_path: Path) -> None:
        x, y = self.ring(300, 0)
        model = Svm(["toa", "power"], c_grid=[1.0], gamma_grid=[1e-4, 1.0, 1e4])
        model.fit(x, y, groups=np.arange(300), validation=(x, y), folder=tmp_path, seed=0)
        assert model.cross_validation["gamma"] == 1.0 and model.cross_validation["auc"] > 0.95

    def test_folds_keep_positions_together(self, tmp_path: Path) -> None:
        """Labels that belong to positions at random: only copies in other folds could predict them."""
        rng = np.random.default_rng(0)
        x, y = np.repeat(rng.normal(size=(60, 2)), 5, axis=0), np.repeat(rng.random(60) < 0.5, 5)
        model = Svm(["toa", "power"], c_grid=[10.0], gamma_grid=[100.0])
        model.fit(
            x, y, groups=np.repeat(np.arange(60), 5), validation=(x, y), folder=tmp_path, seed=0
        )
        assert model.cross_validation["auc"] < 0.7
        model.fit(x, y, groups=np.arange(300), validation=(x, y), folder=tmp_path, seed=0)
        assert model.cross_validation["auc"] > 0.95

    def test_search_rows_are_whole_positions(self) -> None:
        groups = np.repeat(np.arange(100), 7)
        rows = some_positions(groups, rows=140, seed=0)
        assert len(rows) == 140 and len(np.unique(groups[rows])) == 20
        np.testing.assert_array_equal(some_positions(groups, rows=700, seed=0), np.arange(700))


class TestTrees:
    def test_scorer_is_scikit_learns_raw_prediction(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(0)
        x = rng.normal(size=(600, 3)).astype(np.float32)
        y = (x[:, 0] * x[:, 1] > 0) ^ (rng.random(600) < 0.05)
        model = Trees(["a", "b", "c"], iterations=60).fit(
            x, y, groups=np.arange(600), validation=(x[:100], y[:100]), folder=tmp_path, seed=0
        )
        on_limits = model.model._bin_mapper.bin_thresholds_[0][:50, None] * np.ones(3)
        new = np.concatenate([rng.normal(size=(500, 3)), on_limits])
        raw = model.model._raw_predict(new.astype(np.float32).astype(float))[:, 0]
        np.testing.assert_allclose(
            model.scorer()(torch.from_numpy(new.astype(np.float32))).numpy(), raw, atol=1e-12
        )
        assert auc(y, model.decision(x)) > 0.9

    def test_a_forest_of_stumps_and_single_leaves(self, tmp_path: Path) -> None:
        x, y = problem(("a",), rows=30, seed=0)
        model = Trees(["a"], min_leaf=20).fit(
            x, y, groups=y, validation=(x, y), folder=tmp_path, seed=0
        )
        fitted = calibrate(model, x, y)
        assert onnx_export.export_proved(fitted, x)[1] <= 1e-5
        assert np.ptp(fitted.confidence(x)) == 0.0


class TestNetwork:
    @staticmethod
    def xor(rows: int, seed: int) -> tuple[Array, Array]:
        x = np.random.default_rng(seed).uniform(-1, 1, size=(rows, 2)).astype(np.float32)
        return x, x[:, 0] * x[:, 1] > 0

    def test_learns_what_no_line_can(self, tmp_path: Path) -> None:
        (x, y), validation, (new, truth) = self.xor(500, 0), self.xor(200, 1), self.xor(500, 2)
        net = Network(["a", "b"], Mlp(widths=[32]), epochs=40, lr=0.02, batch_size=64)
        net.fit(x, y, groups=np.arange(500), validation=validation, folder=tmp_path, seed=0)
        assert auc(truth, net.decision(new)) > 0.97

    def test_stops_early_and_keeps_the_best_epoch(self, tmp_path: Path) -> None:
        """Pure noise: the validation loss can only rise, so the best epoch is an early one."""
        rng = np.random.default_rng(0)
        x, y = rng.normal(size=(100, 5)).astype(np.float32), rng.random(100) < 0.5
        held = rng.normal(size=(100, 5)).astype(np.float32), rng.random(100) < 0.5
        net = Network(
            list("abcde"),
            Mlp(widths=[64], dropout=0.0),
            epochs=200,
            patience=4,
            lr=0.02,
            weight_decay=0.0,
        )
        net.fit(x, y, groups=np.arange(100), validation=held, folder=tmp_path, seed=0)
        table = np.genfromtxt(tmp_path / "metrics.csv", delimiter=",", names=True)
        losses = table["valloss"][np.isfinite(table["valloss"])]
        assert 5 <= len(losses) <= 60 and len(losses) - 1 - losses.argmin() == 4
        decision = net.decision(held[0])
        assert np.mean(np.logaddexp(0, decision) - held[1] * decision) == pytest.approx(
            losses.min(), rel=1e-4
        )

    def test_covariance_net_takes_any_number_of_bands(self) -> None:
        for shape in [(1, 4), (16, 36), (3, 9)]:
            assert CovarianceNet(channels=4)(shape)(torch.zeros(5, *shape)).shape == (5,)

    def test_standardise_bounds_the_tails(self) -> None:
        x = np.random.default_rng(0).standard_cauchy((2000, 2)) * [1e-3, 1e3]
        z = Standardise(x)(torch.from_numpy(x.astype(np.float32))).numpy()
        np.testing.assert_allclose([z.mean(axis=0), z.std(axis=0)], [[0, 0], [1, 1]], atol=1e-4)
        assert np.abs(z).max() < 20
        inside = np.argsort(x[:, 0])[20:-20]
        assert all(a < b for a, b in pairwise(z[inside, 0]))

    def test_a_constant_column_is_harmless(self) -> None:
        assert torch.isfinite(Standardise(np.ones((10, 3)))(torch.full((2, 3), 7.0))).all()


TABLE = torch.arange(12.0).reshape(12, 1) ** 2
FILTERS = torch.linspace(-1, 1, 18).reshape(2, 3, 3)

KNOWN: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "numbers on either side": lambda x: ((x * 3 + 0.5) / 2 - 1)[:, 0, 0],
    "float32 and float64": lambda x: (x.double() + 1e-9).sum(dim=[1, 2]),
    "limits": lambda x: (x.clamp(-0.5, 0.5) + x.clamp(0.1)).sum(dim=(1, 2)),
    "larger, smaller": lambda x: torch.maximum(x[:, 0], torch.minimum(x[:, 1], x[:, 2])).amax(
        dim=1
    ),
    "slices": lambda x: x[:, ::2, 1:3].sum(dim=2)[:, -1] - x[:, -1, -2],
    "keeping an axis": lambda x: (x - x.mean(dim=2, keepdim=True)).amax(dim=[-2, -1]),
    "axes exchanged": lambda x: (x.transpose(1, -1) @ x)[:, 1, 2].tanh(),
    "side by side": lambda x: torch.cat([x[:, 0], x[:, 1].relu()], dim=-1).exp().sum(dim=1),
    "one entry by index": lambda x: (
        x[:, :, 0].gather(1, (x[:, :, 1] > 0).long()).sum(dim=1).sigmoid()
    ),
    "rows of a table": lambda x: (
        torch.nn.functional.embedding((x[:, 0] > 0).long() * 5 + 2, TABLE).squeeze(2).sum(1)
    ),
    "zeros": lambda x: (torch.zeros_like(x[:, 0, :1], dtype=torch.int64) + 2).double().flatten(),
    "strided convolution": lambda x: torch.nn.functional.conv1d(x, FILTERS, None, 2, 1).sum(
        dim=(1, 2)
    ),
}


class Function(torch.nn.Module):
    """A function as a module."""

    def __init__(self, function: Callable[[torch.Tensor], torch.Tensor]) -> None:
        super().__init__()
        self.function = function

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the function."""
        return self.function(x)


class TestOnnx:
    """Graphs against torch itself; rows in number other than at the export."""

    X = np.random.default_rng(0).normal(size=(7, 3, 4)).astype(np.float32)

    def file(self, function: Callable[[torch.Tensor], torch.Tensor]) -> tuple[bytes, Array]:
        return onnx_export.to_onnx(Function(function), shape=(3, 4)), function(
            torch.from_numpy(self.X)
        ).numpy()

    @pytest.mark.parametrize("what", KNOWN)
    def test_every_known_operator(self, what: str) -> None:
        data, expected = self.file(KNOWN[what])
        model = onnx.load_from_string(data)
        onnx.checker.check_model(model, full_check=True)
        assert model.producer_name == "echolearn"
        np.testing.assert_allclose(
            inference.open_onnx(data)(self.X), expected, rtol=1e-5, atol=1e-6
        )


class TestCalibration:
    def test_recovers_the_logistic_it_was_drawn_from(self) -> None:
        rng = np.random.default_rng(0)
        decision = rng.normal(3.0, 2.0, 20_000)
        y = rng.random(20_000) < 1 / (1 + np.exp(-(1.5 * decision - 4.0)))
        np.testing.assert_allclose(platt(decision, y), (1.5, -4.0), rtol=0.05)

    def test_keeps_the_order_whatever_the_labels_say(self) -> None:
        decision = np.linspace(-50, 50, 201)
        for y in (decision > 0, decision < 0, np.arange(201) % 2 == 0):
            slope, intercept = platt(decision, y)
            assert slope > 0 and np.isfinite(intercept)

    def test_survives_perfect_separation_and_constants(self) -> None:
        y = np.arange(40) < 10
        slope, _ = platt(np.where(y, 1.0, -1.0), y)
        assert 0 < slope < 10
        slope, intercept = platt(np.full(40, 1e6 / 3), y)
        assert 1 / (1 + np.exp(-(slope * 1e6 / 3 + intercept))) == pytest.approx(0.25, abs=0.03)

    def test_threshold_by_hand(self) -> None:
        confidence = np.array([0.1, 0.2, 0.35, 0.6, 0.8, 0.9])
        assert best_threshold(confidence, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(0.475)
        assert best_threshold(confidence, np.array([0, 1, 0, 0, 1, 1])) == pytest.approx(0.7)
        assert best_threshold(np.full(4, 0.3), np.array([0, 1, 0, 1])) == 0.5
        # Cuts at 0.2 and 0.75 are equally good; the one nearer to 0.5 is taken.
        alternating = np.array([0, 1, 0, 1])
        assert best_threshold(np.array([0.1, 0.3, 0.6, 0.9]), alternating) == pytest.approx(0.75)


BAD = {
    "classifier.lr=abc": lambda: Network(["a"], Mlp(), lr="abc"),  # type: ignore[arg-type]
    "classifier.epochs=1.5": lambda: Network(["a"], Mlp(), epochs=1.5),  # type: ignore[arg-type]
    "classifier.net=": lambda: Network(["a"], {"widths": [3]}),  # type: ignore[arg-type]
    "net=Mlp": lambda: Network(["covariance"], Mlp()),
    "net=CovarianceNet": lambda: Network(["a", "b"], CovarianceNet()),
    "net.dropout=2": lambda: Mlp(dropout=2),
    "net.widths=64": lambda: Mlp(widths=64),  # type: ignore[arg-type]
    "net.kernel=4": lambda: CovarianceNet(kernel=4),
    "classifier.c_grid=0": lambda: Svm(["a"], c_grid=[0]),
    "classifier.gamma_grid=": lambda: Svm(["a"], gamma_grid=[]),
    "classifier.search_rows=20000": lambda: Svm(["a"], search_rows=20_000),
    "classifier.fit_rows=10": lambda: Svm(["a"], fit_rows=10),
    "classifier.folds=1": lambda: Svm(["a"], folds=1),
    "classifier.leaves=many": lambda: Trees(["a"], leaves="many"),  # type: ignore[arg-type]
    "classifier.inputs=toa": lambda: Threshold("toa"),  # type: ignore[arg-type]
    "one column": lambda: Threshold(["a", "b"]),
    "columns for this classifier": lambda: Svm(["covariance"]),
    "one tensor alone": lambda: Network(["covariance", "toa"], CovarianceNet()),
    "only a simulation knows snr_db": lambda: Trees(["score", "snr_db"]),
    "each name once": lambda: Trees(["score", "score"]),
}


@cache
def message(part: str) -> str:
    with pytest.raises(BadValue) as caught:
        BAD[part]()
    return str(caught.value)


@pytest.mark.parametrize("part", BAD)
def test_bad_arguments_are_named_in_one_line(part: str) -> None:
    assert part in message(part) and "\n" not in message(part)


def test_as_input_names_the_column() -> None:
    with pytest.raises(BadValue, match="power=nan in row 1"):
        as_input(np.array([[1.0, 2.0], [3.0, np.nan]]), ["toa", "power"])
