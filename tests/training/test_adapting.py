"""`train init=`: a bundle or a run adapted to labelled places, and what says nothing refused."""

import json
import shutil
from functools import partial

import numpy as np
import pytest
import torch

from echolearn.checks import BadValue
from echolearn.classifiers.architectures import Mlp
from echolearn.classifiers.calibration import Sigmoid, calibrate
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.earlier import EarlierFilter
from echolearn.classifiers.inference import open_onnx
from echolearn.classifiers.methods.adapted import FREE, Adapted
from echolearn.classifiers.methods.network import Network
from echolearn.classifiers.onnx_behind import behind
from echolearn.classifiers.onnx_export import export_proved, to_onnx
from echolearn.cli.main import main
from echolearn.evaluation.metrics import auc
from echolearn.robot.bundle import read_bundle
from echolearn.training.adapting import begun, earlier_filter
from echolearn.training.export import set_of
from echolearn.training.predictions import predict
from echolearn.training.runs import read_run
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
from world import CLASSIFIERS

TOLD = {"kind": "bundle", "name": "old", "sha256": "0", "data": ["then"]}


def belief(x):
    """Return a filter's confidence: it knows the second column, or entry, alone."""
    return torch.sigmoid(x.flatten(1)[:, 1].double() - 0.5)


def old(inputs, shape):
    """Return that filter as an ONNX file."""
    data = to_onnx(Formula(belief), shape=shape)
    return EarlierFilter(
        TOLD, "old", inputs=inputs, microphones=None, model=data, open=lambda: open_onnx(data)
    )


def drawn(shape, *, seed, rows=120, told=2.0):
    """Draw rows whose second entry tells the label; the first does what `told` says."""
    rng = np.random.default_rng(seed)
    y = rng.random(rows) < 0.5
    x = rng.normal(size=(rows, *shape)).astype(np.float32)
    flat = x.reshape(rows, -1)
    flat[:, 0] += told * y
    flat[:, 1] += 2.0 * y
    return x, y


def learned(model, shape, folder, *, rows=120, told=2.0):
    """Fit and calibrate a classifier, two rows of a place."""
    x, y = drawn(shape, seed=0, rows=rows, told=told)
    held = drawn(shape, seed=1, told=told)
    model.fit(Examples(x, y, np.arange(rows) // 2, held, folder=folder, seed=0))
    return calibrate(model, *held)


def test_columns_and_logit_are_looked_at_together_and_exported_as_one_file(tmp_path):
    """The oracle is the formula by hand, on what the earlier filter says."""
    model = Adapted(["peak_to_rms", "score"]).begin(old(("toa", "power"), (2,)))
    assert model.inputs == ("toa", "power", "peak_to_rms", "score") and model.seen == 5
    fitted = learned(model, (4,), tmp_path)
    x, y = drawn((4,), seed=2, rows=300)
    proved = export_proved(fitted, x)
    assert proved.parity < 1e-6 and proved.trials >= 10_000

    logit = x[:, 1] - 0.5
    constants = dict(model.scale.named_buffers())
    low, high, mean, scale = (constants[key].numpy() for key in ("low", "high", "mean", "scale"))
    z = (np.clip(np.column_stack([x, logit]), low, high) - mean) / scale
    wanted = z @ model.weight + model.bias
    assert np.allclose(model.decision(x), wanted, atol=1e-4)
    assert np.allclose(open_onnx(proved.data)(x), fitted.mapping(wanted), atol=1e-4)
    # What the filter does not know is in the first column: adapted, it orders better.
    assert auc(y, model.decision(x)) > auc(y, logit) + 0.01


def test_few_rows_and_a_large_penalty_leave_the_earlier_filter(tmp_path):
    model = Adapted(["peak_to_rms", "score"], penalties=[1e4]).begin(old(("toa", "power"), (2,)))
    learned(model, (4,), tmp_path, rows=12)
    assert abs(model.weight[-1]) > FREE * abs(model.weight[:-1]).max()
    x, _ = drawn((4,), seed=2)
    low, high = (dict(model.scale.named_buffers())[key].numpy()[-1] for key in ("low", "high"))
    assert np.corrcoef(model.decision(x), np.clip(x[:, 1] - 0.5, low, high))[0, 1] > 0.98


def test_validation_rows_choose_the_penalty(tmp_path):
    """What training rows tell and validation rows do not calls for a larger one."""
    x, y = drawn((2,), seed=0, rows=40)
    found = {}
    for told in (2.0, -2.0):
        held = drawn((2,), seed=1, told=told)
        model = Adapted(["toa", "score"]).fit(
            Examples(x, y, np.arange(40), held, folder=tmp_path, seed=0)
        )
        found[told] = model.cross_validation["penalty"]
    assert found[-2.0] > found[2.0]


def test_of_a_filter_that_sees_a_tensor_the_logit_alone_is_looked_at(tmp_path):
    earlier = old(("covariance",), (3, 4))
    model = Adapted(["toa", "score"]).begin(earlier)
    assert model.inputs == ("covariance",) and model.seen == 1
    fitted = learned(model, (3, 4), tmp_path)
    x, _ = drawn((3, 4), seed=2, rows=50)
    proved = export_proved(fitted, x)
    order = np.argsort(x.reshape(50, -1)[:, 1])
    assert (np.diff(open_onnx(proved.data)(x)[order]) >= 0).all()


def test_a_file_of_other_operators_and_penalties_below_zero_are_refused(tmp_path):
    import onnx

    earlier = old(("toa", "power"), (2,))
    plane = earlier.model
    model = onnx.load_from_string(earlier.model)
    model.opset_import[0].version = 17
    newer = EarlierFilter(
        **{**vars(earlier), "model": model.SerializeToString()},
    )
    with pytest.raises(BadValue, match="init=old operator sets=.*17.*: must be .*13"):
        behind(newer, plane, columns=2, shape=(2,))
    for wrong in ([], [-1.0], ["much"]):
        with pytest.raises(BadValue, match="classifier.penalties="):
            Adapted(["toa"], penalties=wrong)


# ---------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def place(world, tmp_path_factory):
    """Return a folder with the world's sets, runs and bundle, where more may be made."""
    runs = tmp_path_factory.mktemp("adapting") / "runs"
    for kind in ("data", "train"):
        shutil.copytree(world.runs / kind, runs / kind)
    return runs


@pytest.fixture(scope="module")
def bundled(place, packed):
    """Return the name of the bundle of the trees, among those of that folder."""
    shutil.copytree(packed, place / "bundles" / packed.name)
    return packed.name


def adapt(place, init, *words, name="offgrid_hall"):
    """Run the command on a set of the world."""
    [folder] = (place / "data").glob(f"{name}-*")
    told = [f"runs={place}", f"recorded={folder}", "target=reflector", "aim=balanced"]
    told += ["test_share=0.3", "validation_share=0.4"]
    return main(["train", f"init={init}", *told, *words])


@pytest.fixture(scope="module")
def adapted(place, bundled):
    """Return the run of the bundle adapted to the set off the grid."""
    assert adapt(place, bundled) == 0
    [run] = (place / "train").glob("adapted-offgrid_hall-s0-*")
    return read_run(run)


def test_a_bundle_is_adapted_to_a_run_like_any_other(world, place, bundled, adapted):
    about = json.loads((place / "bundles" / bundled / "bundle.json").read_text())
    told = adapted.metrics["adapted_from"]
    trained = world.sets["scattered"].digest
    places = len(np.unique(world.sets["offgrid_hall"]["group"]))
    wanted = {"kind": "bundle", "name": bundled, "sha256": about["sha256"], "data": [trained]}
    assert told == {**wanted, "places": places}
    assert adapted.model.classifier == f"adapted-from_{bundled}"
    assert adapted.learned_from == (world.sets["offgrid_hall"].digest, trained)
    trees = CLASSIFIERS["trees_features"]["inputs"]
    assert [*adapted.inputs[: len(trees)]] == trees and len(adapted.inputs) > len(trees)
    assert adapted.metrics["model"]["parity"] < 1e-6
    assert adapted.metrics["operating_point"]["aim"] == "balanced"
    assert (predict(adapted, world.sets["offgrid_hall"]) > 0.5).any()


def test_the_same_command_keeps_it_and_another_filter_makes_another(place, bundled, adapted):
    before = (adapted.folder / "metrics.json").stat()
    assert adapt(place, bundled) == 0
    assert (adapted.folder / "metrics.json").stat() == before
    assert adapt(place, "trees_features-scattered") == 0
    [other] = (place / "train").glob("adapted-*from_trees_features-*")
    told = read_run(other).metrics["adapted_from"]
    assert told["kind"] == "run" and told["name"].startswith("trees_features-scattered-s0-")


def test_its_bundle_and_card_say_what_it_began_from(place, bundled, adapted):
    words = [f"runs={place}", f"run={adapted.folder}", "scene.probe.length=6000", "resamples=30"]
    card = place / "card.md"
    assert main(["export", *words, "name=mine", f"card={card}"]) == 0
    found = read_bundle(place / "bundles" / "mine")
    assert found.about["adapted_from"] == adapted.metrics["adapted_from"]
    told = adapted.metrics["adapted_from"]
    said = f"| adapted from | the bundle `{bundled}`, SHA-256 `{told['sha256']}`, at 60 places |"
    assert said in card.read_text() and "\n\n| made by" not in card.read_text()
    # It can be adapted again, and says of all that it has learned from.
    problem = LearningProblem(set_of(adapted), target="reflector")
    with pytest.raises(BadValue, match="init=mine: must not have learned from this set"):
        earlier_filter("mine", problem, runs=place)


def test_few_places_are_refused_in_a_line_unless_they_are_forced(
    world, place, bundled, capsys, monkeypatch
):
    few = np.arange(len(world.sets["offgrid_hall"])) % 9
    monkeypatch.setattr(LearningProblem, "groups", lambda _: few)
    before = sorted((place / "train").iterdir())
    assert adapt(place, bundled, "seed=1") == 1
    said = capsys.readouterr().err
    assert "places=9: must be at least 10, so that each part of them has several; label" in said
    assert "force=true" in said and said.count("\n") == 1
    assert sorted((place / "train").iterdir()) == before
    assert adapt(place, bundled, "seed=1", "force=true") == 0
    [run] = {*(place / "train").iterdir()} - {*before}
    assert read_run(run).metrics["adapted_from"]["places"] == 9


@pytest.mark.parametrize(
    ("words", "said"),
    {
        ("init=nobody",): "init=nobody: must be the folder of a bundle or a run, or the name of",
        ("split=row",): "split=row: must be position where a filter is adapted",
        ("classifier=svm_pair",): "classifier=svm: must be adapted, or the network whose run",
        ("classifier=mlp_pair",): "init=small: must be a run of this network with these inputs",
    }.items(),
)
def test_what_cannot_be_adapted_says_why(place, bundled, capsys, words, said):
    before = sorted((place / "train").iterdir())
    assert adapt(place, bundled, *words) == 1
    assert said in capsys.readouterr().err
    assert sorted((place / "train").iterdir()) == before


def test_a_set_that_the_filter_has_learned_from_is_refused(place, bundled, capsys):
    assert adapt(place, bundled, name="scattered") == 1
    assert "must not have learned from this set; what it has seen says" in capsys.readouterr().err


# ---------------------------------------------------------------- networks


@pytest.fixture(scope="module")
def trained(world, place):
    """Return a run of a small network on the scattered set."""
    config = {"kind": "network", "inputs": ["peak_to_rms", "joint"]}
    problem = LearningProblem(world.sets["scattered"], target="reflector")
    found = train(problem, name="mlp", classifier=small, config=config, runs=place)
    return read_run(place / "train" / found["run"])


def small(width=4, **settings):
    """Return a small network."""
    return Network(["peak_to_rms", "joint"], Mlp((width,)), **{"epochs": 3, "lr": 1e-2} | settings)


def test_a_network_goes_on_from_its_run(world, place, trained):
    """At a rate of next to nothing it stays what it was, its scaler included."""
    problem = LearningProblem(world.sets["offgrid_hall"], target="reflector")
    earlier = earlier_filter(trained.identity, problem, runs=place)
    found = {}
    for lr in (1e-7, 1e-2):
        model = begun(partial(small, lr=lr, epochs=1), earlier)
        x = problem.inputs(model.inputs)
        y = problem.labels()
        folder = place / f"lr{lr:g}"
        folder.mkdir()
        held = (x.part(np.arange(30)), y[:30])
        model.fit(Examples(x, y, problem.groups(), held, folder=folder, seed=5))
        found[lr] = model.decision(x)
    mapping = Sigmoid(**trained.metrics["calibration"])
    before = predict(trained, world.sets["offgrid_hall"])
    assert np.abs(mapping(found[1e-7]) - before).max() < 1e-5
    assert np.abs(mapping(found[1e-2]) - before).max() > 1e-3


def test_other_layers_and_damaged_weights_are_refused(world, place, trained):
    problem = LearningProblem(world.sets["offgrid_hall"], target="reflector")
    earlier = partial(earlier_filter, trained.identity, problem, runs=place)
    x, y = problem.inputs(("peak_to_rms", "joint")), problem.labels()
    examples = Examples(x, y, problem.groups(), (x, y), folder=place, seed=0)
    with pytest.raises(BadValue, match="must be a run of this network, of the same layers"):
        begun(partial(small, width=5), earlier()).fit(examples)
    weights = trained.folder / "best.safetensors"
    whole = weights.read_bytes()
    for torn, said in {
        whole[:40]: "its best.safetensors is damaged",
        whole[:-2] + b"\x40\x40": "best.safetensors differs by .*: must compute what model.onnx",
    }.items():
        weights.write_bytes(torn)
        with pytest.raises(BadValue, match=said):
            begun(small, earlier()).fit(examples)
    weights.write_bytes(whole)
