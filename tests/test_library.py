"""The library's front door: few names, loaded late, and a page whose examples run."""

import doctest
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import echolearn as el
from echolearn.acoustics.geometry import SearchWindow
from echolearn.checks import BadValue
from echolearn.localization.localize import localize
from echolearn.localization.methods.gated import Gated

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "library.md"


def test_the_page_tells_every_public_name_and_its_examples_run(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert {*re.findall(r"`el\.(\w+)", PAGE.read_text())} == {*el.PUBLIC}
    ran = doctest.testfile(str(PAGE), module_relative=False, optionflags=doctest.ELLIPSIS)
    assert ran.attempted > 10 and ran.failed == 0


def test_names_are_loaded_when_they_are_used_and_others_are_refused():
    code = "import sys, echolearn as el; print(len(dir(el)) > 11, 'numpy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True", "False"]
    assert all(callable(getattr(el, name)) for name in el.PUBLIC)
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        el.simulat  # noqa: B018


def test_simulated_is_what_was_asked_for_and_localized_as_by_hand():
    told, truth = el.simulate((8, 6, 5), (1.3, 3.0, 0.0), snr_db=20, seed=3)
    again, _ = el.simulate(
        el.Room((8, 6, 5), 0.5), el.Pose(np.array([1.3, 3, 2.5])), snr_db=20, seed=3
    )
    assert np.array_equal(told.samples, again.samples)
    other, _ = el.simulate((8, 6, 5), (1.3, 3.0, 0.0), snr_db=20, seed=4)
    assert not np.array_equal(told.samples, other.samples)
    # Wall x=0 is 1.3 m away, its image 2.6 m; microphone 1 is 0.2 m farther.
    assert truth.toa[0] == pytest.approx(2.8 / 343, abs=1e-6)

    echoes, columns = el.localize(told, "gated")
    batch = el.Observation(told.samples[None], told.probe, told.array, told.speed_of_sound)
    by_hand, described = localize(batch, Gated(SearchWindow()))
    assert np.array_equal(echoes.toa, by_hand.toa)
    assert columns.keys() == described.keys()
    assert echoes.toa[0, 0] == pytest.approx(truth.toa[0], abs=2 / 22050)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (((8, 6), (1, 1, 0)), "^room=.*length, width and height"),
        (((8, 6, 5), (1, 1)), "^pose=.*x and y in m"),
        (((8, 6, 5), (9, 1, 0)), "inside"),
    ],
)
def test_a_place_that_is_none_is_refused(arguments, reason):
    with pytest.raises(BadValue, match=reason):
        el.simulate(*arguments)


def test_sets_and_runs_are_opened_by_name_or_folder(world):
    scattered = world.sets["scattered"]
    for name in ("scattered", scattered.folder):
        found = el.open_set(name, world.runs)
        assert found.digest == scattered.digest
    assert f"<Dataset scattered: {len(found)} rows, {len(found.columns)} columns>" == repr(found)
    assert "<code>snr_db</code>" in found._repr_html_() and "covariance" not in found.columns

    run = el.open_run("trees_features-scattered-s0", world.runs)
    assert repr(run) == f"<Run {run.identity}>"
    assert el.open_run(run.folder).identity == run.identity
    with pytest.raises(BadValue, match="^run=svm_pair: must be the beginning of one run's name"):
        el.open_run("svm_pair", world.runs)
    with pytest.raises(BadValue, match="^set=nothing"):
        el.open_set("nothing", world.runs)


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        (lambda walk, _: walk.observe(0), "poses=0: must be a list of whole numbers from 0 to 29"),
        (lambda walk, _: walk.observe([-1]), "poses=-1: .* they are counted from 0"),
        (lambda walk, _: walk.observe([30]), "poses=30: must be a whole number from 0 to 29"),
        (lambda walk, _: walk.observe([0.5]), "poses=0.5: must be a whole number"),
        (lambda walk, _: walk.observe([]), r"poses=\[\]: must be a list"),
        (lambda walk, _: el.localize(walk), "observation=Survey: .* survey.observe"),
        (lambda walk, _: el.localize(walk.observe([0]), "gatd"), ".* did you mean gated"),
        (lambda walk, _: el.localize(walk.observe([0]), 5), "localizer=int: must be a localizer"),
        (lambda _, rows: rows["snr"], "column=snr: .* did you mean snr_db"),
        (lambda *_: el.open_bundle("pint"), "bundle=pint: .* did you mean point"),
        (lambda _, rows: el.open_survey(rows.folder), "survey=.* it is a labelled set"),
        (lambda _, rows: el.open_run(rows.folder), "run=.* train makes runs on it"),
        (lambda walk, _: el.open_set(walk.folder), "set=.* label makes a set of it"),
    ],
)
def test_a_slip_is_told_in_a_line_with_what_was_meant(slip, said, world):
    walk = el.open_survey(ROOT / "examples" / "survey" / "short")
    with pytest.raises(BadValue, match=f"^{said}"):
        slip(walk, world.sets["scattered"])


def test_a_name_that_is_not_public_is_told_with_those_that_are():
    with pytest.raises(AttributeError, match="no attribute 'load'; it has .* open_bundle"):
        el.load("point")


def test_a_table_needs_pandas_and_says_so(world, monkeypatch):
    """An entry of None is how Python marks a module that cannot be imported."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    run = el.open_run("trees_features-scattered-s0", world.runs)
    walk = el.open_survey(world.runs / "survey" / "hall_0dB")
    for thing in (world.sets["scattered"], run, walk):
        with pytest.raises(BadValue, match="^to_pandas: needs pandas; pip install pandas$"):
            thing.to_pandas()


def test_a_set_is_a_table_for_pandas(world):
    pytest.importorskip("pandas")
    found = world.sets["scattered"]
    frame = found.to_pandas()
    assert len(frame) == len(found) and [*frame.columns] == found.columns
    assert np.array_equal(frame["snr_db"], found["snr_db"])


def test_what_is_opened_is_drawn(world, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    walk = el.open_survey(ROOT / "examples" / "survey" / "short")
    heard = el.open_bundle("point").score(walk.observe(range(30)), walk.poses)
    axis = el.plot(walk)
    assert len(axis.lines) == 1 + len(walk.walls)
    drawn = el.plot(heard, axis).lines[-1].get_xydata()
    assert np.array_equal(drawn, heard.map.points[heard.map.kept])
    assert "30 poses" in walk._repr_html_() and "trained on" in el.open_bundle()._repr_html_()

    # The brightest place is the echo: wall x = 0 lies behind the robot, 1.4 m with microphone 1.
    simulated, _ = el.simulate((8, 6, 5), (1.3, 3.0, 0.0), snr_db=20)
    [mesh] = el.plot(simulated).collections
    corners = mesh.get_coordinates()
    row, column = np.unravel_index(mesh.get_array().argmax(), mesh.get_array().shape)
    assert corners[row, column, 0] == pytest.approx(1.4, abs=0.02)
    assert abs(corners[row, column, 1]) == pytest.approx(180, abs=4)

    run = el.open_run("trees_features-scattered-s0", world.runs)
    assert len(el.plot(run).containers) == 1 and "auc" in run._repr_html_()
    with pytest.raises(BadValue, match="^thing=int"):
        el.plot(3)
