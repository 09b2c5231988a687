"""The domain check: its level, what it finds, and what it says; walks of a plan share a robot."""

import json
from dataclasses import replace
from shutil import copytree

import numpy as np
import pytest

import world as small
from bundle_mutants import seal
from echolearn.checks import BadValue
from echolearn.dataset.records import records
from echolearn.robot.bundle import read_bundle
from echolearn.robot.domain import LEVEL, columns_of, domain_line, placed_among
from echolearn.robot.reference import UNCHECKED, UNLIKE, Reference
from echolearn.survey.reader import read_survey


def drawn(surveys, *, poses=8, seed=0, moved=0.0):
    """Return three columns of surveys: each has a level of its own, skewed, discrete, or normal."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((surveys, poses, 3))
    level = rng.standard_normal((surveys, 1, 3))
    rows = level + noise + moved
    rows[..., 0] = np.exp(rows[..., 0])
    rows[..., 1] = np.round(rows[..., 1])
    return rows


def reference(surveys=512):
    """Return the reference of such surveys."""
    rows = drawn(surveys)
    limits = np.quantile(rows.reshape(-1, 3), [0.01, 0.99], axis=0)
    return Reference(("score", "joint_lag", "coherence"), rows, limits)


@pytest.mark.parametrize("poses", [3, 8])
def test_of_surveys_of_the_kind_about_one_in_twenty_is_called_another(poses):
    told = reference()
    alarms = sum(placed_among(told, rows).alarm for rows in drawn(1000, poses=poses, seed=1))
    # A binomial count of 1000 at 5 %: its middle 99.9 % end at 73.
    assert 5 < alarms <= 73


def test_a_column_that_is_elsewhere_is_named():
    rows = drawn(1, seed=2)[0]
    rows[:, 2] += 9.0
    found = placed_among(reference(), rows)
    assert found.alarm and found.columns[found.worst] == "coherence"
    assert found.p[2] <= LEVEL < found.p[0]


def test_values_that_scatter_are_found_though_their_median_is_usual():
    told = reference()
    rows = np.median(told.rows, axis=(0, 1)) + np.zeros((8, 3))
    assert not placed_among(told, rows).alarm
    rows[::2, 2] += 30.0
    rows[1::2, 2] -= 30.0
    assert placed_among(told, rows).columns[placed_among(told, rows).worst] == "coherence"


def test_a_bundle_says_whether_recordings_are_of_its_kind(packed, world, tmp_path):
    walk = read_survey(world.runs / "survey" / "hall_0dB")
    assert domain_line(read_bundle(packed), walk) == UNCHECKED
    bundle = replace(read_bundle(packed), reference=reference())
    heard = replace(bundle, reference=replace(reference(), columns=("score", "joint")))
    own = columns_of(heard, walk, most=8)
    near = own[np.random.default_rng(3).integers(8, size=(100, 8))]
    told = Reference(("score", "joint"), near, np.stack([own.min(axis=0), own.max(axis=0)]))
    folder = copytree(packed, tmp_path / "bundle")
    for moved, said in ((0.0, "like simulated walks"), (5.0, UNLIKE)):
        there = replace(told, rows=told.rows + moved, limits=told.limits + moved)
        (folder / "reference.npz").write_bytes(there.to_bytes())
        seal(folder, schema=4, reference=there.about())
        line = domain_line(read_bundle(folder), walk)
        assert line.startswith(said) and line.isprintable()
    assert "score (how much echoes look like the burst)" in line or "joint (how far" in line


def test_a_walk_of_a_plan_has_one_room_noise_and_robot():
    plan = replace(small.plans()[1], poses=3, rows=6, gain_db=(-5.0, 5.0))
    found = records(plan, range(6))
    for name in ("snr_db", "t60", "room", "gain_db", "group"):
        first, second = found[name][:3], found[name][3:]
        assert (first == first[0]).all() and (second == second[0]).all()
        assert (first[0] != second[0]).any()
    assert len(np.unique(found["position"], axis=0)) == 6
    # Each row depends on its number alone.
    assert (records(plan, range(4, 6))["toa"] == found["toa"][4:]).all()


def test_export_puts_walks_of_the_plan_into_the_bundle(world, tmp_path):
    scattered = small.plans()[1]
    walks = small.write_set(
        replace(scattered, name="walks", poses=2, rows=40, seed=9), tmp_path / "runs"
    )
    folder = small.pack(world, "threshold_peak", tmp_path, reference=walks)
    about = json.loads((folder / "bundle.json").read_text())
    assert about["schema"] == 4
    assert about["reference"] == {"columns": ["peak_to_rms"], "walks": 20, "poses": 2}
    held = read_bundle(folder).reference
    assert (held.rows[:, :, 0].ravel() == walks["peak_to_rms"].astype("f4")).all()
    before = (folder / "bundle.json").stat()
    small.pack(world, "threshold_peak", tmp_path, reference=walks)
    assert (folder / "bundle.json").stat() == before

    for change, said in (
        ({"poses": 1}, "must be a set of walks"),
        ({"rows": 38}, "reference=19 walks: must be at least 20 walks of 2 poses for 1 columns"),
        ({"snr_db": (0.0, 1.0)}, "which differs in snr_db"),
        ({"seed": scattered.seed}, "must have another plan.seed"),
    ):
        keys = {"name": "other", "poses": 2, "rows": 4, "seed": 9} | change
        other = small.write_set(replace(scattered, **keys), tmp_path / "runs")
        with pytest.raises(BadValue, match=said):
            small.pack(world, "threshold_peak", tmp_path, reference=other)
