"""Wall hypotheses of a set of walks: right ones are right, and classifiers learn from them."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.cli.commands import verify_folder
from echolearn.dataset.generate import generate
from echolearn.dataset.hypothesis_records import HypothesisPlan, hypothesis_records
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.walk_plan import WalkPlan
from echolearn.dataset.walk_set import WalkSet
from echolearn.localization.columns import STRIP_ENTRIES
from echolearn.runtime.engines.processes import Processes
from echolearn.runtime.engines.serial import Serial
from echolearn.simulation.noise.white import White
from echolearn.simulation.odometry import MODELS
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage import manifests
from echolearn.training.split import LearningProblem
from echolearn.walls.hypotheses import hypotheses
from echolearn.walls.nouns import GEOMETRY, SOUND
from echolearn.walls.strips import geometry_columns, sound_columns, strips
from echolearn.walls.track import follow
from refusals import refused

SCENE = Scene(circular_array(), noise_probe(burst=500, length=4000), Images(), White())
PLAN = WalkPlan(
    name="few",
    seed=5,
    rows=5,
    poses=30,
    paths=("wandering",),
    rooms=("box",),
    odometry=MODELS,
    odometry_error=(0.0, 0.01),
    extent=(1.0, 3.0),
    stride=(0.2, 0.5),
    margin=(1.1, 1.4),
    height=(2.5, 4.0),
    t60=(0.3, 0.3),
    wall_factor=(1.0, 1.0),
    snr_db=(5.0, 5.0),
    window=SearchWindow(1.0, 1.9),
    scene=SCENE,
    shard_rows=5,
    room=Room((5.0, 4.0, 3.0), 0.3),
)
"""Walks through a room of 5 x 4 m, 1.1 m or more from its walls, loud and with little error."""

WANTED = HypothesisPlan(PLAN, count=8, shard_rows=3)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with the set of walks; not to be changed."""
    place = tmp_path_factory.mktemp("walks")
    generate(PLAN, runs=place, engine=Serial())
    return place


@pytest.fixture(scope="module")
def made(runs):
    """Return the folder of the walks' hypotheses."""
    return generate(WANTED, runs=runs, engine=Serial())


def test_the_walls_that_a_loud_walk_passes_are_found_and_called_walls(made):
    dataset = Dataset(made)
    found = [int(dataset["is_wall"][dataset["group"] == walk].sum()) for walk in range(5)]
    assert sum(found) >= 16 and max(found) <= 4
    # A wall is nobody's twice, and the strongest line of each walk is a wall.
    for walk in range(5):
        rows = dataset["group"] == walk
        walls = dataset["wall"][rows]
        assert len(np.unique(walls[walls >= 0])) == found[walk]
        assert dataset["is_wall"][rows][0]
    assert (dataset["walls"] == 4).all()


def test_a_record_is_what_strips_of_the_walk_say(runs, made):
    [source] = [place for place in (runs / "data").glob("few-*")]
    records = hypothesis_records(WANTED, range(3, 4), source=source)
    walk = WalkSet(source).heard(3)
    found = hypotheses(walk, count=8)
    cut = strips(walk, found)
    for names, table in (
        (SOUND, sound_columns(walk, found, cut=cut)),
        (GEOMETRY, geometry_columns(walk, found, cut=cut)),
    ):
        assert np.array_equal(np.stack([records[name] for name in names], axis=1), table)
    assert np.array_equal(records["theta"], found.theta)
    dataset = Dataset(made)
    assert np.array_equal(dataset["rho"][dataset["group"] == 3], found.rho)


def test_strips_are_stored_with_the_walks_number_and_noise_where_nothing_is_known(runs, made):
    [source] = [place for place in (runs / "data").glob("few-*")]
    walk = WalkSet(source).heard(3)
    cut = strips(walk, hypotheses(walk, count=8))
    dataset = Dataset(made)
    stored = dataset["strips"][dataset["group"] == 3].astype(float)
    assert stored.shape == (len(cut.seen), 30, STRIP_ENTRIES)
    assert (stored[:, :2, 0] == [0, 3]).all() and not stored[:, 2:, 0].any()
    rows = stored[..., 1:].reshape(*cut.values.shape)
    for strip, values, known, seen in zip(rows, cut.values, cut.known, cut.seen, strict=True):
        # Poses that have the line in their window come first, in their order.
        count = seen.sum()
        assert not strip[count:].any()
        np.testing.assert_allclose(
            strip[:count][known[seen]], values[seen][known[seen]], rtol=1e-3, atol=1e-3
        )
        assert (strip[:count] != 0).all()


def test_lines_are_kept_as_their_tracks_have_them(runs, made):
    [source] = [place for place in (runs / "data").glob("few-*")]
    walk = WalkSet(source).heard(2)
    found = hypotheses(walk, count=8)
    track = follow(walk, found, cut=strips(walk, found), number=0)
    dataset = Dataset(made)
    first = np.flatnonzero(dataset["group"] == 2)[:1]
    line = [dataset.gather(name, first)[0] for name in ("normal", "offset", "normal_sd")]
    assert line == [track.line.normal, track.line.offset, track.line.normal_sd]
    stretches = dataset.gather("stretches", first)[0]
    assert np.array_equal(stretches[: len(track.stretches)], track.stretches)
    assert np.isnan(stretches[len(track.stretches) :]).all()


def test_the_set_is_verified_resumed_and_the_same_for_any_engine(made, runs):
    content = {path.name: path.read_bytes() for path in made.iterdir()}
    verify_folder(made)
    assert len(Dataset(made)) == Dataset(made).manifest["rows"] > 5
    (made / manifests.shard_name(1)).unlink()
    assert generate(WANTED, runs=runs, engine=Processes(workers=2)) == made
    assert {path.name: path.read_bytes() for path in made.iterdir()} == content


def test_hypotheses_of_one_walk_are_never_parted(made):
    problem = LearningProblem(Dataset(made), target="is_wall", test_share=0.4)
    groups = problem.groups()
    train, validation, test = (set(groups[rows].tolist()) for rows in problem.parts())
    assert len(test) == 2 and not (train & test or train & validation or validation & test)


def test_without_its_walks_there_is_nothing_to_make_it_of(tmp_path):
    with refused(f"folder={tmp_path}"):
        generate(WANTED, runs=tmp_path, engine=Serial())


def test_more_hypotheses_than_there_can_be_are_refused():
    with refused("plan.count=0: must be a whole number from 1"):
        HypothesisPlan(PLAN, count=0)
