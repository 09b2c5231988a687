"""Who may import whom: the rooms of the house, read from the imports themselves."""

import re
import runpy
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HOUSE = runpy.run_path(str(ROOT / "docs" / "draw_architecture.py"))

ROOMS = """
    cli bench studies comparison training dataset robot simulation walls mapping survey evaluation
    classifiers localization runtime storage acoustics checks
""".split()
"""The rooms, from the street to the ground: each imports only rooms below it."""

ROBOT = (
    "robot walls mapping survey evaluation localization runtime storage acoustics checks".split()
)
"""Rooms that run on a robot, where the libraries of the others are not installed."""

OWNERS = {
    "numpy scipy": ROOMS,
    "hydra omegaconf": ["cli"],
    "yaml": ["cli", "survey"],
    "lightning safetensors": ["classifiers"],
    "sklearn": ["classifiers", "training"],
    # Room impulse responses and the matched filters of sets are computed on a GPU, if asked.
    "torch": ["classifiers", "training", "simulation", "dataset"],
    "onnx": ["bench", "classifiers"],
    "onnxruntime": ["classifiers", "robot"],
    "pyroomacoustics": ["simulation"],
    # In `acoustics` by what compiled loops alone import.
    "llvmlite": ["acoustics", "simulation"],
    "numba": ["acoustics", "localization", "simulation", "walls"],
    "soundfile": ["survey", "simulation"],
    "rir_generator": ["bench"],
    "optuna": ["training"],
    "matplotlib": ["comparison", "studies", "training"],
    "jinja2": ["comparison"],
    "rich dask distributed threadpoolctl": ["runtime"],
    "rosbags": ["mapping"],
    "foxglove cyclonedds": ["robot"],
    "filelock": ["storage"],
}
"""Rooms that may import each library."""

DISTRIBUTIONS = {
    "distributed": "dask",
    "foxglove": "foxglove-sdk",
    "omegaconf": "hydra-core",
    "hydra": "hydra-core",
    "sklearn": "scikit-learn",
    "yaml": "pyyaml",
}
"""Names under which libraries are installed, where they differ."""

IMPLEMENTATIONS = {
    "classifiers.methods": ["classifier"],
    "localization.methods": ["localizer"],
    "runtime.engines": ["engine"],
    "simulation.noise": ["noise", "diffuse"],
    "simulation.rir": ["rir"],
    "survey.sources": ["source"],
}
"""Folders of implementations of one interface, with the groups of `conf` that offer them."""


FILES = HOUSE["modules"]()


@pytest.fixture(scope="module")
def arrows():
    """Return who imports whom."""
    return [(a, b) for a, others in HOUSE["rooms"]().items() for b in others]


@pytest.fixture(scope="module")
def foreign():
    """Return who imports which library."""
    return {
        (HOUSE["room"](name), library)
        for name, path in FILES.items()
        for library in {each.partition(".")[0] for each in HOUSE["imports"](path)}
        if library not in sys.stdlib_module_names | {"echolearn"}
    }


def test_the_drawing_shows_the_imports_as_they_are():
    """If not: make architecture."""
    assert (ROOT / "docs" / "architecture.svg").read_text() == HOUSE["draw"]()


def test_imports_go_down_only(arrows):
    assert {(a, b) for a, b in arrows if ROOMS.index(a) > ROOMS.index(b)} == set()


def test_the_house_is_low_and_has_few_stairs(arrows):
    graph = HOUSE["rooms"]()
    assert len(arrows) <= 100
    assert max(HOUSE["floor"](graph, name) for name in graph) <= 10


def test_no_circle_of_files():
    TopologicalSorter(HOUSE["files"]()).prepare()


def test_what_runs_on_a_robot_imports_nothing_else(arrows):
    assert {(a, b) for a, b in arrows if a in ROBOT and b not in ROBOT} == set()


def test_each_library_is_imported_by_its_owners_only(foreign):
    owned = {(a, name) for names, rooms in OWNERS.items() for name in names.split() for a in rooms}
    assert foreign - owned == set()


def test_each_library_is_declared(foreign):
    """Not left to those that happen to need it, too."""
    text = (ROOT / "pyproject.toml").read_text()
    project = tomllib.loads(text)["project"]
    extras = project["optional-dependencies"].values()
    wanted = " ".join(sum(extras, project["dependencies"]))
    for _, name in foreign:
        assert DISTRIBUTIONS.get(name, name.replace("_", "-")) in wanted


def test_nothing_reads_or_writes_pickles():
    unsafe = r"import (pickle|shelve|marshal)\b|allow_pickle=True|weights_only=False"
    assert [path for path in FILES.values() if re.search(unsafe, path.read_text())] == []


@pytest.mark.parametrize(("folder", "groups"), IMPLEMENTATIONS.items())
def test_what_a_glob_finds_is_what_can_be_chosen(folder, groups):
    configs = [path.read_text() for each in groups for path in ROOT.glob(f"conf/{each}/*.yaml")]
    chosen = re.findall(rf"echolearn\.({folder}\.\w+)\.", " ".join(configs))
    assert {name for name in FILES if name.startswith(folder)} == set(chosen)


@pytest.mark.parametrize(
    ("name", "libraries"),
    [
        ("robot.scorer", {"onnxruntime"}),
        ("robot.check", {"yaml"}),
        ("robot.live.following", {"onnxruntime", "yaml"}),
        ("dataset.generate", set()),
        ("localization.localize, echolearn.mapping.echo_map, echolearn.evaluation.metrics", set()),
        ("simulation.survey, echolearn.training.runs, echolearn.comparison.compare", {"yaml"}),
    ],
)
def test_robots_and_finished_work_wait_for_no_heavy_library(name, libraries, foreign):
    heavy = {library for _, library in foreign} - {"numpy", "scipy", "filelock", "threadpoolctl"}
    # Of SciPy, what takes as long to import as all the rest.
    heavy.add("scipy.signal")
    code = f"import sys, echolearn.{name}; print(*{heavy} & sys.modules.keys())"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) <= libraries
