"""One contract for every configuration of a classifier, found by glob."""

import numpy as np
import onnx
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from safetensors.torch import load_file

from echolearn.checks import BadValue
from echolearn.classifiers import inference, onnx_export
from echolearn.classifiers.calibration import calibrate
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.inputs import view_of
from echolearn.classifiers.methods.ensemble import Ensemble
from echolearn.classifiers.methods.network import Network
from echolearn.cli import config, own
from echolearn.evaluation.metrics import auc
from echolearn.localization.columns import MAP_SECTORS, STRIP_ENTRIES

NAMES = sorted(path.stem for path in (own.folder() / "classifier").glob("*.yaml"))
QUICK = {
    "Network": {"epochs": 12, "patience": 12, "batch_size": 32, "lr": 5e-3},
    "Sklearn": {
        "estimator": {"_target_": "sklearn.ensemble.RandomForestClassifier", "n_estimators": 20}
    },
    "Svm": {"c_grid": [1.0, 10.0], "gamma_grid": [0.01, 0.1]},
    "Trees": {"iterations": 25, "min_leaf": 5},
}


def plain(name):
    """Return a classifier's configuration as the command line composes it."""
    with initialize_config_dir(str(own.folder()), version_base=None):
        composed = compose(overrides=[f"+classifier={name}"])
    return OmegaConf.to_container(composed, resolve=True)["classifier"]


def quick(name):
    """Build a classifier with settings for small problems."""
    return config.build(quicker(plain(name)), "classifier")


def quicker(keys):
    """Return a classifier's configuration, and its members', with settings for small problems."""
    found = keys | QUICK.get(keys["_target_"].rpartition(".")[2], {})
    if "rounds" in keys.get("net", {}):
        found["net"] = keys["net"] | {"channels": 4, "width": 16, "rounds": 1}
    if "members" in keys:
        found["members"] = {name: quicker(each) for name, each in keys["members"].items()}
    return found


def problem(inputs, *, rows, seed):
    """Draw rows whose every entry tells a little, in units of very different size."""
    rng = np.random.default_rng(seed)
    y = rng.random(rows) < 0.5
    shapes = {"covariance": (4, 36), "map": (MAP_SECTORS + 3, 8), "pose": (5, 14)}
    shapes["strips"] = (2, STRIP_ENTRIES)
    shape = shapes.get(view_of(inputs), (len(inputs),))
    push = 0.5 if len(shape) == 2 else 2.2
    scale = 10.0 ** np.linspace(-3, 2, shape[-1])
    x = rng.normal(size=(rows, *shape)) + push * y.reshape(-1, *[1] * len(shape))
    x = (x * scale + scale).astype(np.float32)
    if view_of(inputs) == "strips":
        # J is in units of its own; four rows are of one walk, and a block ends with a walk.
        x /= 2.0 * scale.astype(np.float32)
        x[:, :2, 0] = np.stack(np.divmod(np.arange(rows) // 4, 2048), axis=1)
    if view_of(inputs) == "pose":
        x[..., 0] = 1.0  # all candidates are there
    return x, y


def learn(model, folder):
    """Fit on 240 rows, two for each position."""
    x, y = problem(model.inputs, rows=240, seed=0)
    held = problem(model.inputs, rows=80, seed=1)
    return model.fit(Examples(x, y, np.arange(240) // 2, held, folder=folder, seed=3))


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return str(request.param)


@pytest.fixture(scope="module")
def folder(name, tmp_path_factory):
    return tmp_path_factory.mktemp(name)


@pytest.fixture(scope="module")
def fitted(name, folder):
    return learn(quick(name), folder)


@pytest.fixture(scope="module")
def calibrated(fitted):
    return calibrate(fitted, *problem(fitted.inputs, rows=80, seed=1))


@pytest.fixture(scope="module")
def exported(calibrated):
    x = problem(calibrated.classifier.inputs, rows=50, seed=2)[0]
    return onnx_export.export_proved(calibrated, x)


def test_the_configurations_of_the_plan_are_there():
    columns = {
        "svm_pair": ["toa", "power"],
        "svm_score_power": ["score", "power"],
        "threshold_peak": ["peak_to_rms"],
    }
    assert all(plain(name)["inputs"] == inputs for name, inputs in columns.items())
    wide = [plain(f"{method}_features")["inputs"] for method in ("svm", "trees", "mlp")]
    assert wide[0] == wide[1] == wide[2] and len(wide[0]) == 11
    assert not {"toa", "power", "gain", "azimuth"} & {*wide[0]}
    tensors = {plain(name)["inputs"][0] for name in NAMES if name.startswith("covnet")}
    kinds = ("gated", "steered", "steered_ideal")
    assert tensors == {"covariance"} | {f"covariance_{kind}" for kind in kinds}


def test_configuration_is_a_call_that_can_be_made_as_it_stands(name):
    text = (own.folder() / "classifier" / f"{name}.yaml").read_text()
    assert text.startswith("_target_: echolearn.classifiers.methods.")
    views = {"covnet": "covariance", "mapnet": "map", "posenet": "pose", "walls_joint": "strips"}
    view = views.get(name, views.get(name.partition("_")[0], "features"))
    assert view_of(config.build(plain(name), "classifier").inputs) == view


def test_separates_unseen_rows(fitted):
    x, y = problem(fitted.inputs, rows=300, seed=2)
    decision = fitted.decision(x)
    assert decision.shape == (300,) and decision.dtype == np.float64
    assert auc(y, decision) > 0.9


def test_same_seed_same_file(name, calibrated, exported, tmp_path):
    """Equal classifiers give equal bytes, and leave the global random states alone."""
    before = (torch.get_rng_state(), np.random.get_state()[1].copy())
    again = learn(quick(name), tmp_path)
    assert torch.equal(before[0], torch.get_rng_state())
    assert (before[1] == np.random.get_state()[1]).all()
    x, y = problem(again.inputs, rows=80, seed=1)
    assert np.array_equal(again.decision(x), calibrated.classifier.decision(x))
    module = onnx_export.Confidence(calibrate(again, x, y))
    found = onnx_export.to_onnx(module, shape=x.shape[1:], inputs=again.inputs)
    assert found == exported.data


def test_file_computes_the_same_confidences(calibrated, exported):
    assert exported.trials >= 10_000 and exported.parity <= 1e-5
    x = problem(calibrated.classifier.inputs, rows=5000, seed=5)[0]
    x = np.concatenate([x, *onnx_export.strange(x, 5000)])
    assert len(x) == 10_000 and np.isfinite(x).all()
    largest = float(np.finfo(np.float32).max)
    assert {0.0, largest, -largest} <= {*x.reshape(len(x), -1)[:, 0].tolist()}
    difference = np.abs(inference.open_onnx(exported.data)(x) - calibrated.confidence(x))
    assert np.isfinite(difference).all() and difference.max() <= 1e-5


def test_any_batch(fitted, exported):
    x = problem(fitted.inputs, rows=inference.BLOCK + 1, seed=6)[0]
    score = inference.open_onnx(exported.data)
    whole = score(x)
    assert whole.shape == (len(x),) and score(x[:0]).shape == (0,)
    # A walk is not parted.
    first = 4 if view_of(fitted.inputs) == "strips" else 1
    parts = np.concatenate([score(x[:first]), score(x[first:8])])
    np.testing.assert_allclose(parts, whole[:8], atol=1e-6)


def test_file_holds_plain_operations_and_no_traces(exported):
    """Whatever reads operator set 13 reads it: one file, ONNX's own operators, no paths."""
    model = onnx.load_from_string(exported.data)
    onnx.checker.check_model(model, full_check=True)
    [x], [confidence] = model.graph.input, model.graph.output
    assert (x.name, confidence.name) == ("x", "confidence")
    [opset] = model.opset_import
    assert (opset.domain, opset.version, model.ir_version) == ("", 13, 7)
    assert not model.functions and not any(t.data_location for t in model.graph.initializer)
    assert not model.producer_version and b".py" not in exported.data


def test_leaves_nothing_that_needs_unpickling(fitted, folder):
    """A network leaves the weights that it goes by, as safetensors."""
    left = {path.name for path in folder.iterdir() if "tfevents" not in path.name}
    if isinstance(fitted, Ensemble):
        # A member leaves what it leaves alone.
        assert left == {name for name, each in fitted.members.items() if isinstance(each, Network)}
        return
    if not isinstance(fitted, Network):
        assert not left
        return
    assert left == {"best.safetensors", "metrics.csv", "hparams.yaml"}
    weights = load_file(folder / "best.safetensors")
    state = fitted.fitted[1].state_dict()
    assert {*weights} == {*state}
    assert all(torch.equal(weights[name], value) for name, value in state.items())


def test_float64_inputs_are_rounded_first(fitted):
    x = problem(fitted.inputs, rows=40, seed=7)[0]
    near = x.astype(float) * (1 + 1e-9)
    np.testing.assert_array_equal(fitted.decision(near), fitted.decision(x))


def test_what_cannot_be_learned_from_is_refused(name, fitted, tmp_path):
    x, y = problem(fitted.inputs, rows=60, seed=7)
    ones = np.ones_like(y)
    given = {"groups": np.arange(60), "validation": (x, y), "folder": tmp_path, "seed": 0}
    with pytest.raises(BadValue, match="both classes"):
        quick(name).fit(Examples(x, ones, **given))
    with pytest.raises(BadValue, match=r"x\.shape"):
        fitted.decision(np.zeros((3, 2)) if x.ndim == 3 else np.zeros((3, 5, 36)))
    far = x.astype(float)
    far[2, 0] = 1e300
    with pytest.raises(BadValue, match=f"{fitted.inputs[0]}=.*row 2"):
        fitted.decision(far)
