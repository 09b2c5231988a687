"""Benchmarks: a small one run, what it writes and refuses, its arithmetic by hand."""

import csv
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.acoustics.rooms import inside
from echolearn.bench.localizers import PAPER, as_printed, at_work, literal, on_grids
from echolearn.bench.measurement import COLUMNS, Measurement, observations
from echolearn.bench.outlook import outlook
from echolearn.bench.page import digits, page, seconds
from echolearn.bench.responses import HALL, OUTLINES, PLACE, habets, peers
from echolearn.bench.run import PAGE, REPETITIONS, SCALING, STAGES, StagesFailed, bench
from echolearn.bench.sets import steady_rates
from echolearn.checks import BadValue
from echolearn.cli.commands import localizers
from echolearn.cli.main import main
from echolearn.cli.own import folder as conf
from echolearn.runtime.timing import Spread
from echolearn.simulation.realism import Realism
from echolearn.simulation.rir.images import Images
from echolearn.storage import manifests
from echolearn.storage.identity import kind_of
from echolearn.storage.marked_page import around
from world import TRAINED, pack, plans

FILES = {"bench.csv", "repetitions.csv", "bench.md", "machine.json"}
DOCS = Path(__file__).parents[2] / "docs"
MACHINE = {
    "processor": "abacus, 2 cores",
    "system": "Linux",
    "memory_gib": 4.0,
    "load_before": 0.1,
    "load_after": 2.0,
}
TEXT = f"before\n{PAGE.begin}\nold\n{PAGE.end}\nbetween\n{SCALING.begin}\n{SCALING.end}\nafter\n"


def few(rows):
    """Return a plan of some rows in one room."""
    plan = plans()[2]
    return replace(plan, rows=rows, shard_rows=4)


SMALL = {
    "plan": few(8),
    "growing": few(4),
    "realistic": Realism(spread=(0.001, 0.001), scattering=(0.3, 0.3)),
    "localizers": {"gated": replace(few(8).localizer, azimuths=8)},
    "workers": 2,
    "repetitions": 2,
    "long_repetitions": 1,
    "seconds": 0.0,
    "batch": 4,
    "positions": 2,
    "rows": [20],
    "t60": [0.3],
    "peer_t60": [0.4],
    "microphones": [3, 4],
    "azimuths": [8, 16],
}


@pytest.fixture(scope="module")
def made(world, tmp_path_factory):
    """Return the folder of a small benchmark of everything, with its page beside it."""
    runs = tmp_path_factory.mktemp("bench") / "runs"
    for part in ("data", "train"):
        shutil.copytree(world.runs / part, runs / part)
    pack(world, "trees_features", runs)
    text = runs.parent / "page.md"
    text.write_text(TEXT)
    return bench(runs=runs, page=text, scaling=text, **SMALL)


def table(path):
    """Return the rows of a CSV file."""
    return list(csv.DictReader(path.read_text().splitlines()))


def pick(rows, **wanted):
    """Return the rows with these values."""
    return [row for row in rows if wanted.items() <= row.items()]


@pytest.fixture(scope="module")
def rows(made):
    """Return the rows of `bench.csv`."""
    return table(made / "bench.csv")


# ---------------------------------------------------------------- what is measured


def test_every_stage_leaves_rows_of_the_documented_columns(made, rows):
    assert {row["stage"] for row in rows} == set(STAGES)
    documented = (DOCS / "formats.md").read_text()
    for name, columns in (("bench.csv", COLUMNS), ("repetitions.csv", REPETITIONS)):
        assert (made / name).read_text().splitlines()[0] == ",".join(columns)
        assert all(f"`{column}`" in documented for column in columns)


def test_summaries_are_those_of_the_repetitions_and_ratios_those_of_neighbours(made, rows):
    laps = table(made / "repetitions.csv")
    for row in rows:
        keys = {key: row[key] for key in COLUMNS[:6]}
        own = np.array([float(lap["result"] or "nan") for lap in pick(laps, **keys)])
        assert len(own) == int(row["n"])
        assert float(row["median"] or "nan") == pytest.approx(np.median(own), rel=1e-6, nan_ok=True)
        if row["reference"]:
            beside = pick(laps, **keys | {"variant": row["reference"]})
            ratio = np.median(own / [float(lap["result"]) for lap in beside])
            assert float(row["ratio"]) == pytest.approx(ratio, rel=1e-5)
    assert sum(row["reference"] != "" for row in rows) > 20


@pytest.mark.parametrize(
    ("stage", "variant"), [("rir", "pyroomacoustics"), ("localize", "gated, literal")]
)
def test_what_is_fast_is_far_ahead_of_its_peer(rows, stage, variant):
    [row] = pick(rows, stage=stage, variant=variant, measure="cpu")
    assert float(row["ratio"]) > 10


def test_realistic_sound_is_timed_beside_clean_sound(rows):
    clean, real = pick(rows, stage="rir", parameter="realism", measure="cpu")
    assert (clean["variant"], real["variant"]) == ("received, clean", "received, realistic")
    assert real["reference"] == clean["variant"] and 1 < float(real["ratio"]) < 30


def test_rooms_of_other_outlines_are_timed_beside_a_box_as_large(rows):
    for variant, room in OUTLINES.items():
        assert room.volume == pytest.approx(480.0, rel=0.01) and room.t60 == 0.6
        assert inside(room, PLACE.position[None]).all()
        [row] = pick(rows, stage="rir", variant=variant, measure="cpu")
        assert (row["reference"] == "") == (variant == "images, a box")


def test_torch_is_timed_beside_the_compiled_filters_at_every_batch_size(rows):
    found = pick(rows, stage="localize", variant="torch on the CPU", measure="wall")
    assert [row["value"] for row in found] == ["1", "4"]
    assert {row["reference"] for row in found} == {"matched filters and J"}


def test_every_run_is_timed_one_row_at_a_time_and_many(rows, world):
    fitted = [row["variant"] for row in pick(rows, stage="train", measure="fit")]
    assert sorted(fitted) == sorted(path.name for path in (world.runs / "train").iterdir())
    assert len(fitted) == sum(len(names) for _, _, names in TRAINED)
    models = pick(rows, stage="models", measure="wall", reference="")
    sizes = {str(min(256, len(world.sets[source]))) for source, _, _ in TRAINED}
    assert {row["value"] for row in models} == {"1", *sizes}
    assert len(models) == 2 * len(fitted)


def test_sets_are_timed_whole_with_their_memory_and_size(rows):
    generated = pick(rows, stage="generate", measure="wall")
    assert [(row["variant"], row["reference"]) for row in generated] == [
        ("2 processes", ""),
        ("pyroomacoustics, responses alone, 2 processes", "2 processes"),
        ("1 process", "2 processes"),
    ]
    [size] = pick(rows, stage="rows", measure="size")
    # Three tensors, the columns, a manifest.
    assert 3 * 16 * 36 * 4 < float(size["median"]) / 20 < 9000
    for measure in ("memory, director", "memory, worker"):
        [peak] = pick(rows, stage="rows", measure=measure)
        assert 5e7 < float(peak["median"]) < 2e9


# ---------------------------------------------------------------- what is written


def test_the_folder_is_whole_and_holds_nothing_else(made):
    manifest = manifests.verify(made)
    assert manifest["kind"] == "benchmark"
    assert {*manifest["files"]} == FILES
    assert {path.name for path in made.iterdir()} == {*FILES, "manifest.json"}
    machine = json.loads((made / "machine.json").read_text())
    assert machine.keys() == {*MACHINE, "libraries", "usable_cores"}


def test_both_pages_get_their_tables_and_keep_the_rest(made):
    text = (made.parents[1] / "page.md").read_text()
    parts = re.split("|".join(map(re.escape, (*PAGE[:2], *SCALING[:2]))), text)
    assert (parts[0], parts[2], parts[4]) == ("before\n", "\nbetween\n", "\nafter\n")
    assert "T60 0.4 s: images" in parts[1]
    assert "| trees_features | " in parts[1]
    assert re.search(r"\| a bundle on one core: \w+, joint \| ", parts[1])
    assert "convolution" not in parts[1]
    assert "convolution" in (made / "bench.md").read_text()
    assert "core hours" in parts[3]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stages": ["rir", "strat"]}, "stages=strat: must be some of rir, .*; did you mean start"),
        ({"stages": "rir"}, r"stages=rir: .*are brackets missing"),
        ({"stages": []}, r"stages=\[\]: must be some of"),
        ({"page": "{}/without.md"}, "page=.*without.md: must be a file with one <!-- bench"),
        (
            {"scaling": "{}/without.md"},
            "scaling=.*without.md: must be a file with one <!-- scaling",
        ),
        ({"page": "{}/no.md"}, "page=.*no.md: cannot be read"),
        ({"scaling": "{}/page.md", "stages": ["start"]}, "stages=.*: must have rows among them"),
        ({"repetitions": 0}, "repetitions=0: "),
        ({"t60": [0.0]}, "t60=0.0 s: "),
        ({"rows": 1000}, "rows=1000: "),
    ],
)
def test_mistakes_are_told_before_anything_is_timed(changes, said, tmp_path):
    (tmp_path / "without.md").write_text("nothing")
    (tmp_path / "page.md").write_text(TEXT)
    for key in {"page", "scaling"} & changes.keys():
        changes = changes | {key: changes[key].format(tmp_path)}
    with pytest.raises(BadValue, match=said):
        bench(runs=tmp_path / "runs", **SMALL | changes)
    assert not (tmp_path / "runs").exists()
    assert (tmp_path / "page.md").read_text() == TEXT


def test_a_stage_that_fails_stops_no_other_and_changes_no_page(tmp_path, capsys):
    text = tmp_path / "page.md"
    text.write_text(TEXT)
    damaged = tmp_path / "runs" / "train" / "net" / manifests.METRICS
    damaged.parent.mkdir(parents=True)
    damaged.write_text("{}")
    with pytest.raises(StagesFailed, match="train: failed"):
        bench(runs=tmp_path / "runs", stages=["train", "start"], page=text, **SMALL)
    assert "bench train: BadValue: " in capsys.readouterr().err
    assert {row["stage"] for row in table(tmp_path / "runs" / "bench" / "bench.csv")} == {"start"}
    assert text.read_text() == TEXT


def test_the_command_replaces_what_an_earlier_or_a_killed_one_left(tmp_path, capsys):
    folder = tmp_path / "bench"
    (folder / ".scratch-x" / "data").mkdir(parents=True)
    (folder / "bench.csv").write_text("old")
    assert main(["bench", "stages=[start]", "repetitions=3", f"runs={tmp_path}"]) == 0
    assert "echolearn --help" in capsys.readouterr().out
    assert {path.name for path in folder.iterdir()} == {*FILES, "manifest.json"}
    assert main(["verify", str(folder)]) == 0


def test_an_interrupt_ends_it_in_the_middle_of_a_stage(tmp_path):
    words = ["bench", "stages=[rows]", "rows=[100000]", f"runs={tmp_path}"]
    command = [sys.executable, "-m", "echolearn", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(tmp_path.glob("bench/.scratch-*/*/data/*")):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=600)[1]
    assert process.returncode == 130
    assert "\nerror: interrupted" in err
    assert not (tmp_path / "bench" / manifests.MANIFEST).exists()


@pytest.mark.parametrize(("name", "markers"), [("benchmarks.md", PAGE), ("scaling.md", SCALING)])
def test_the_projects_pages_have_a_place_for_the_times(name, markers):
    before, after = around(DOCS / name, markers)
    assert before.endswith(markers.begin)
    assert after.startswith(markers.end)


# ---------------------------------------------------------------- localizers


NAMES = sorted(path.stem for path in (conf() / "localizer").glob("*.yaml"))


@pytest.fixture(scope="module")
def every():
    """Return the localizers that the command times."""
    return localizers("paper")


def test_the_command_times_every_localizer_there_is(every):
    assert sorted(every) == NAMES
    assert {localizer.window.rule for localizer in every.values()} == {"authors"}


@pytest.mark.parametrize("name", NAMES)
def test_every_localizer_can_be_timed_and_the_papers_have_their_equations(name, every):
    localizer = on_grids(every[name], [8]).get(8, every[name])
    scene = replace(few(2).scene, array=circular_array(microphones=3))
    observation = observations(few(2), 2, scene=scene)
    contestant = at_work(localizer, observation)
    assert contestant.units == 2
    assert contestant.work().toa.shape[0] == 2
    form = literal(localizer, observation).get(kind_of(localizer))
    printed = list(as_printed(name, [0.5, 0.25], value=64))
    assert len(printed) == (name.partition("_")[0] in PAPER)
    assert form is not None or not printed
    if form is not None:
        form.work()
    if name == "snls":
        assert printed[0].ratio == (30.42, 25.35, 35.49)


# ---------------------------------------------------------------- peers


def test_a_peer_that_is_not_installed_is_left_out_with_a_word(scene, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rir_generator", None)
    assert list(peers(HALL, scene)) == ["pyroomacoustics"]
    said = "rir-generator is not installed, so it is left out; pip install 'echolearn[peers]'"
    assert capsys.readouterr().err == f"bench rir: {said}\n"


def test_the_generator_of_habets_computes_the_same_response(scene):
    pytest.importorskip("rir_generator")
    room = replace(HALL, t60=0.3)
    other = habets(room, scene)()[:, 0]
    at = microphone_positions(scene.array, PLACE)[:1]
    [own] = Images()(
        room, PLACE.position, microphones=at, sample_rate=22050.0, speed_of_sound=343.0
    )
    assert np.sum((other - own) ** 2) < 1e-3 * np.sum(own**2)
    assert peers(room, scene)["rir-generator"].units == pytest.approx(1 / 6)


# ---------------------------------------------------------------- arithmetic


@pytest.mark.parametrize(
    ("written", "workers", "rates"),
    [
        # Two processes start after 5 s and take 1 s for a shard of 10 rows each.
        ([6.0, 6.01, 7.0, 7.01, 8.0, 8.01], 2, [20.0]),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 1, [10.0, 10.0]),
        ([6.0, 6.01], 2, [np.nan]),
        ([], 2, [np.nan]),
    ],
)
def test_steady_rates_begin_when_every_process_has_written(written, workers, rates):
    assert steady_rates(written, 10, workers=workers) == pytest.approx(rates, nan_ok=True)


def test_the_outlook_is_the_arithmetic_of_its_measurements():
    """200 rows/s by two processes: 100 per core, 1e7 / 100 / 3600 = 27.8 core hours; 7 000 bytes a
    row: 70 GB."""
    taken = {"steady rate": [160.0, 200.0, 240.0], "size": [7e6], "memory, worker": [300 * 2.0**20]}
    about = ("rows", "2 processes", "rows")
    found = [Measurement(*about, 1000, name, "", values) for name, values in taken.items()]
    smaller = [Measurement(*about, 10, name, "", [1.0]) for name in taken]
    said = outlook([*smaller, *found], MACHINE, workers=2)
    for line in (
        "| rows per second and core | 100 [90.0, 110] |",
        "| bytes per row | 7000 |",
        "| memory of a worker | 300 MiB |",
        "| core hours | 28 |",
        "| disk | 70 GB |",
        "| 1 | 28 | 1 | 19.4 |",
        "From 1 000 rows measured with 2 processes.",
    ):
        assert line in said
    with pytest.raises(BadValue, match="scaling: needs the stage rows"):
        outlook([], MACHINE, workers=2)


def test_figures_are_written_with_three_digits_and_the_unit_that_suits():
    assert seconds(Spread(2.5e-3, 2.4e-3, 2.61e-3)) == "2.50 [2.40, 2.61] ms"
    assert seconds(Spread(63.25, 63.25, 63.25)) == "63.2 s"
    assert seconds(Spread(4.2e-7, 4.2e-7, 4.2e-7)) == "0.42 µs"
    shown = {1234.5: "1234", 99.96: "100.0", 9.87: "9.87", 0.123: "0.12"}
    assert {value: digits(value) for value in shown} == shown


def test_a_page_says_how_many_times_as_long_the_peer_takes():
    about = ("t60", 0.6, "wall", "s")
    own = Measurement("rir", "images", *about, [0.002, 0.004, 0.003])
    beside = {"reference": "images", "ratio": Spread(100.0, 100.0, 150.0)}
    peer = Measurement("rir", "pyroomacoustics", *about, [0.2, 0.4, 0.6], **beside)
    said = page([own, peer], MACHINE)
    ratio = "pyroomacoustics 400 ms, 100 [100, 150] times |"
    assert f"T60 0.6 s: images | 3.00 [2.50, 3.50] ms | {ratio}" in said
    assert "load average 0.1 to 2.0" in said
    assert np.isnan(own.row()["ratio"])
    assert (peer.row()["ratio"], peer.row()["ratio_q3"]) == pytest.approx((100.0, 150.0))
