"""Benchmarks: a small one really run, what it writes, what it refuses, and its arithmetic by hand."""

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
from typing import Any

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array, microphone_positions
from echolearn.bench.localizers import PAPER, batch, finer, loops, printed
from echolearn.bench.measurement import COLUMNS, Measurement, heard
from echolearn.bench.outlook import outlook
from echolearn.bench.page import digits, page, seconds
from echolearn.bench.responses import HALL, PLACE, habets, rivals
from echolearn.bench.run import README, REPETITIONS, SCALING, STAGES, StagesFailed, bench
from echolearn.bench.sets import steady_rates
from echolearn.checks import BadValue
from echolearn.cli.commands import localizers
from echolearn.cli.config import folder as conf
from echolearn.cli.main import main
from echolearn.dataset.plans import ScatteredPlan
from echolearn.runtime.timing import Spread
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage import manifests
from echolearn.storage.marked_page import around
from world import TRAINED, World, pack, plans

MACHINE = {
    "processor": "abacus, 2 cores",
    "system": "Linux",
    "memory_gib": 4.0,
    "load_before": 0.1,
    "load_after": 2.0,
}

PAGE = (
    f"before\n{README.begin}\nold\n{README.end}\nbetween\n{SCALING.begin}\n{SCALING.end}\nafter\n"
)


def few(rows: int) -> ScatteredPlan:
    """Return a plan of some rows in one room."""
    plan = plans()[2]
    assert isinstance(plan, ScatteredPlan)
    return replace(plan, rows=rows, shard_rows=4)


SMALL: dict[str, Any] = {
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
def made(world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small benchmark of everything, with its page beside it."""
    runs = tmp_path_factory.mktemp("bench") / "runs"
    shutil.copytree(world.runs, runs)
    pack(world, "trees_features", runs)
    text = runs.parent / "page.md"
    text.write_text(PAGE)
    plan = few(8)
    localizers = {"gated": plan.localizer}
    return bench(
        plan=plan,
        growing=few(4),
        localizers=localizers,
        runs=runs,
        readme=text,
        scaling=text,
        **SMALL,
    )


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def pick(rows: list[dict[str, str]], **wanted: str) -> list[dict[str, str]]:
    """Return the rows with these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


# ---------------------------------------------------------------- what is measured


def test_every_stage_leaves_rows_of_the_documented_columns(made: Path) -> None:
    rows = table(made / "bench.csv")
    assert {row["stage"] for row in rows} == set(STAGES)
    documented = (Path(__file__).parents[2] / "docs" / "formats.md").read_text()
    for name, columns in (("bench.csv", COLUMNS), ("repetitions.csv", REPETITIONS)):
        assert (made / name).read_text().splitlines()[0] == ",".join(columns)
        assert all(f"`{column}`" in documented for column in columns)


def test_summaries_are_those_of_the_repetitions_and_ratios_those_of_neighbours(made: Path) -> None:
    rows, laps = table(made / "bench.csv"), table(made / "repetitions.csv")
    keys = COLUMNS[:6]
    compared = 0
    for row in rows:
        own = np.array(
            [float(lap["result"] or "nan") for lap in pick(laps, **{key: row[key] for key in keys})]
        )
        assert len(own) == int(row["n"])
        assert float(row["median"] or "nan") == pytest.approx(np.median(own), rel=1e-6, nan_ok=True)
        if row["reference"]:
            beside = pick(laps, **{key: row[key] for key in keys} | {"variant": row["reference"]})
            ratio = np.median(own / [float(lap["result"]) for lap in beside])
            assert float(row["ratio"]) == pytest.approx(ratio, rel=1e-5)
            compared += 1
    assert compared > 20


@pytest.mark.parametrize(
    ("stage", "variant", "margin"),
    [("rir", "pyroomacoustics", 10), ("localize", "gated, literal", 10)],
)
def test_what_is_fast_is_far_ahead_of_its_peer(
    made: Path, stage: str, variant: str, margin: float
) -> None:
    [row] = pick(table(made / "bench.csv"), stage=stage, variant=variant, measure="cpu")
    assert float(row["ratio"]) > margin


def test_every_run_is_timed_one_row_at_a_time_and_many(made: Path, world: World) -> None:
    rows = table(made / "bench.csv")
    count = sum(len(names) for _, _, names in TRAINED)
    trained = pick(rows, stage="train", measure="fit")
    assert {row["variant"] for row in trained} == {
        path.name for path in (world.runs / "train").iterdir()
    }
    assert len(trained) == count
    models = pick(rows, stage="models", measure="wall", reference="")
    sizes = {str(min(256, len(world.sets[source]))) for source, _, _ in TRAINED}
    assert {row["value"] for row in models} == {"1", *sizes}
    assert len(models) == 2 * count


def test_sets_are_timed_whole_with_their_memory_and_size(made: Path) -> None:
    rows = table(made / "bench.csv")
    generated = pick(rows, stage="generate", measure="wall")
    names = ["2 processes", "pyroomacoustics, responses alone, 2 processes", "1 process"]
    assert [row["variant"] for row in generated] == names
    assert [row["reference"] for row in generated] == ["", "2 processes", "2 processes"]
    [size] = pick(rows, stage="rows", measure="size")
    assert (
        3 * 16 * 36 * 4 < float(size["median"]) / 20 < 9000
    )  # three tensors, the columns, a manifest
    for measure in ("memory, director", "memory, worker"):
        [peak] = pick(rows, stage="rows", measure=measure)
        assert 5e7 < float(peak["median"]) < 2e9


# ---------------------------------------------------------------- what is written


def test_the_folder_is_whole_and_holds_nothing_else(made: Path) -> None:
    manifest = manifests.verify(made)
    assert manifest["kind"] == "benchmark"
    found = {str(path.relative_to(made)) for path in made.rglob("*") if path.is_file()}
    assert found == {*manifest["files"], "manifest.json"}
    assert [path.name for path in made.iterdir() if path.is_dir()] == ["figures"]
    assert {path.name for path in (made / "figures").iterdir()} == {
        "rir.svg",
        "localize.svg",
        "rows.svg",
        "memory.svg",
    }
    machine = json.loads((made / "machine.json").read_text())
    assert machine.keys() >= {
        "processor",
        "system",
        "libraries",
        "load_before",
        "load_after",
        "usable_cores",
    }


def test_both_pages_get_their_tables_and_keep_the_rest(made: Path) -> None:
    text = (made.parents[1] / "page.md").read_text()
    parts = re.split("|".join(map(re.escape, (*README[:2], *SCALING[:2]))), text)
    assert (parts[0], parts[2], parts[4]) == ("before\n", "\nbetween\n", "\nafter\n")
    assert "T60 0.4 s: images" in parts[1]
    assert "| trees_features | 1 |" in parts[1]
    assert "convolution" not in parts[1]
    assert "convolution" in (made / "bench.md").read_text()
    assert "core hours" in parts[3]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stages": ["rir", "strat"]}, "stages=strat: of rir, localize, .*; did you mean start"),
        ({"stages": "rir"}, r"stages=rir: a list, \[a,b\]; are brackets missing"),
        ({"readme": "{}/without.md"}, "readme=.*without.md: a file with one <!-- bench"),
        ({"scaling": "{}/without.md"}, "scaling=.*without.md: a file with one <!-- scaling"),
        ({"readme": "{}/no.md"}, "readme=.*no.md: cannot be read"),
        ({"scaling": "{}/page.md", "stages": ["start"]}, "stages=.*: with rows among them"),
        ({"repetitions": 0}, "repetitions=0: must be a whole number from 1"),
        ({"t60": [0.0]}, "t60=0.0 s: must be a number from 0.01"),
        ({"rows": 1000}, "rows=1000: a list"),
    ],
)
def test_mistakes_are_told_before_anything_is_timed(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    (tmp_path / "without.md").write_text("nothing")
    (tmp_path / "page.md").write_text(PAGE)
    given = {
        key: value.format(tmp_path) if isinstance(value, str) else value
        for key, value in changes.items()
    }
    with pytest.raises(BadValue, match=said):
        bench(plan=few(8), growing=few(4), localizers={}, runs=tmp_path / "runs", **given)
    assert not (tmp_path / "runs").exists()
    assert (tmp_path / "page.md").read_text() == PAGE


def test_a_stage_that_fails_stops_no_other_and_changes_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, damaged = tmp_path / "page.md", tmp_path / "runs" / "train" / "net" / manifests.METRICS
    text.write_text(PAGE)
    damaged.parent.mkdir(parents=True)
    damaged.write_text("{}")
    with pytest.raises(StagesFailed, match="train: failed"):
        given = {"stages": ["train", "start"], "readme": text} | SMALL
        bench(plan=few(8), growing=few(4), localizers={}, runs=tmp_path / "runs", **given)
    assert "bench train: BadValue: " in capsys.readouterr().err
    assert {row["stage"] for row in table(tmp_path / "runs" / "bench" / "bench.csv")} == {"start"}
    assert text.read_text() == PAGE


def test_the_command_replaces_what_an_earlier_or_a_killed_one_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bench"
    for left in (folder / ".scratch-x" / "data", folder / "figures"):
        left.mkdir(parents=True)
    (folder / "figures" / "old.svg").write_text("old")
    assert main(["bench", "stages=[start]", "repetitions=3", f"runs={tmp_path}"]) == 0
    assert "echolearn --help" in capsys.readouterr().out
    names = {"bench.csv", "repetitions.csv", "bench.md", "machine.json", "manifest.json", "figures"}
    assert {path.name for path in folder.iterdir()} == names
    assert list((folder / "figures").iterdir()) == []
    assert main(["verify", str(folder)]) == 0


def test_an_interrupt_ends_it_in_the_middle_of_a_stage(tmp_path: Path) -> None:
    words = ["bench", "stages=[rows]", "rows=[100000]", f"runs={tmp_path}"]
    command = [sys.executable, "-m", "echolearn", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(tmp_path.glob("bench/.scratch-*/*/data/*")):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "\nerror: interrupted" in err
    assert not (tmp_path / "bench" / manifests.MANIFEST).exists()


# ---------------------------------------------------------------- localizers


NAMES = sorted(path.stem for path in (conf() / "localizer").glob("*.yaml"))


@pytest.fixture(scope="module")
def every() -> dict[str, Any]:
    """Return the localizers that the command times."""
    return localizers("paper")


def test_the_command_times_every_localizer_there_is(every: dict[str, Any]) -> None:
    assert sorted(every) == NAMES
    assert {localizer.window.rule for localizer in every.values()} == {"authors"}


@pytest.mark.parametrize("name", NAMES)
def test_every_localizer_can_be_timed_and_the_papers_have_their_equations(
    name: str, every: dict[str, Any]
) -> None:
    localizer = finer(every[name], [8]).get(8, every[name])
    for microphones in (3, 6):
        scene = replace(few(2).scene, array=circular_array(microphones=microphones))
        observation = heard(few(2), 2, scene)
        assert batch(localizer, observation).units == 2
        assert batch(localizer, observation).work().toa.shape[0] == 2  # type: ignore[attr-defined]
    literal = loops(localizer, observation)
    if literal is not None:
        literal.work()
    assert literal is not None or name.partition("_")[0] not in PAPER
    [printed_time] = list(printed(name, [0.5, 0.25], value=64)) or [None]
    assert (printed_time is not None) == (name.partition("_")[0] in PAPER)
    if name == "snls":
        assert printed_time.ratio == (30.42, 25.35, 35.49)


# ---------------------------------------------------------------- peers


def test_a_peer_that_is_not_installed_is_left_out_with_a_word(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rir_generator", None)
    assert list(rivals(HALL, scene)) == ["pyroomacoustics"]
    said = capsys.readouterr().err
    assert (
        said
        == "bench rir: rir-generator is not installed, so it is left out; pip install 'echolearn[peers]'\n"
    )


def test_the_generator_of_habets_computes_the_same_response(scene: Scene) -> None:
    pytest.importorskip("rir_generator")
    room = replace(HALL, t60=0.3)
    other = habets(room, scene)()[:, 0]
    at = microphone_positions(scene.array, PLACE)[:1]
    [own] = Images()(room, PLACE.position, at, sample_rate=22050.0, speed_of_sound=343.0)
    assert np.sum((other - own) ** 2) < 1e-3 * np.sum(own**2)
    assert rivals(room, scene)["rir-generator"].units == pytest.approx(1 / 6)


# ---------------------------------------------------------------- arithmetic


def test_steady_rates_begin_when_every_process_has_written() -> None:
    """Two processes start after 5 s and take 1 s for a shard of 10 rows each."""
    written = [6.0, 6.01, 7.0, 7.01, 8.0, 8.01]
    assert steady_rates(written, 10, workers=2) == [pytest.approx(20.0)]
    assert (
        steady_rates([float(second) for second in range(9)], 10, workers=1)
        == [pytest.approx(10.0)] * 2
    )
    assert np.isnan(steady_rates([6.0, 6.01], 10, workers=2)).all()
    assert np.isnan(steady_rates([], 10, workers=2)).all()


def rows_of(rows: int, **measured: list[float]) -> list[Measurement]:
    """Return what a growing set of so many rows took."""
    about = ("rows", "2 processes", "rows", rows)
    return [
        Measurement(*about, name.replace("__", ", ").replace("_", " "), "", v)
        for name, v in measured.items()
    ]


def test_the_outlook_is_the_arithmetic_of_its_measurements() -> None:
    """200 rows/s by two processes: 100 per core, 1e7 / 100 / 3600 = 27.8 core hours; 7 000 bytes a
    row: 70 GB."""
    large = {"steady_rate": [160.0, 200.0, 240.0], "size": [7e6], "memory__worker": [300 * 2.0**20]}
    small = rows_of(10, steady_rate=[1.0], size=[1.0], memory__worker=[1.0])
    said = outlook([*small, *rows_of(1000, **large)], MACHINE, workers=2)
    assert "| rows per second and core | 100 [90.0, 110] |" in said
    assert "| bytes per row | 7000 |" in said
    assert "| memory of a worker | 300 MiB |" in said
    assert "| core hours | 28 |" in said
    assert "| disk | 70 GB |" in said
    assert "| 1 | 28 | 1 | 19.4 |" in said
    assert "From 1 000 rows measured with 2 processes." in said
    with pytest.raises(BadValue, match="scaling: needs the stage rows"):
        outlook([], MACHINE, workers=2)


def test_figures_are_written_with_three_digits_and_the_unit_that_suits() -> None:
    assert seconds(Spread(2.5e-3, 2.4e-3, 2.61e-3)) == "2.50 [2.40, 2.61] ms"
    assert seconds(Spread(63.25, 63.25, 63.25)) == "63.2 s"
    assert seconds(Spread(4.2e-7, 4.2e-7, 4.2e-7)) == "0.42 µs"
    assert [digits(value) for value in (1234.5, 99.96, 9.87, 0.123)] == [
        "1234",
        "100.0",
        "9.87",
        "0.12",
    ]


def test_the_projects_readme_has_a_place_for_the_times() -> None:
    before, after = around(Path(__file__).parents[2] / "README.md", README)
    assert before.endswith(README.begin) and after.startswith(README.end)


def test_a_page_says_how_many_times_as_long_the_peer_takes() -> None:
    own = Measurement("rir", "images", "t60", 0.6, "wall", "s", [0.002, 0.004, 0.003])
    beside = {"reference": "images", "beside": own.repetitions}
    peer = Measurement("rir", "pyroomacoustics", "t60", 0.6, "wall", "s", [0.2, 0.4, 0.6], **beside)
    line = (
        "T60 0.6 s: images | 3.00 [2.50, 3.50] ms | pyroomacoustics 400 ms, 100 [100, 150] times |"
    )
    said = page([own, peer], MACHINE)
    assert line in said
    assert "load average 0.1 to 2.0" in said
    assert own.row()["ratio"] is np.nan
    assert (peer.row()["ratio"], peer.row()["ratio_q3"]) == (
        pytest.approx(100.0),
        pytest.approx(150.0),
    )
