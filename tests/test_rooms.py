"""Who may import whom: the rooms of the house, read from the imports themselves."""

import ast
import re
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import echolearn

SOURCE = Path(echolearn.__file__).parent
ROOT = SOURCE.parents[1]

ROOMS = """
    cli bench studies comparison training dataset robot simulation walls mapping survey evaluation
    classifiers localization runtime storage acoustics checks
""".split()
"""The rooms, from the street to the ground: each imports only rooms below it."""

ROBOT = "robot mapping survey evaluation localization runtime storage acoustics checks".split()
"""Rooms that run on a robot, where the libraries of the others are not installed."""

OWNERS = {
    "numpy scipy": ROOMS,
    "hydra omegaconf": ["cli"],
    "yaml": ["cli", "survey"],
    "lightning sklearn": ["classifiers"],
    "torch": ["classifiers", "training"],
    "onnx": ["bench", "classifiers"],
    "onnxruntime": ["classifiers", "robot"],
    "pyroomacoustics numba llvmlite": ["simulation"],
    "soundfile": ["survey", "simulation"],
    "rir_generator": ["bench"],
    "matplotlib": ["comparison", "studies"],
    "jinja2": ["comparison"],
    "rich dask distributed dask_jobqueue threadpoolctl": ["runtime"],
    "rosbags": ["mapping"],
    "filelock": ["storage"],
}
"""Rooms that may import each library."""

DISTRIBUTIONS = {
    "distributed": "dask",
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
}
"""Folders of implementations of one interface, with the groups of `conf` that offer them."""


def imports(path: Path) -> set[str]:
    """Return the modules that a file names, at its top and inside its functions."""
    named = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            named |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return named


FILES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts): path
    for path in SOURCE.rglob("*.py")
    if path.stem not in {"__init__", "__main__"}
}
NAMED = {name: imports(path) for name, path in FILES.items()}
INSIDE = {name: {each[10:] for each in NAMED[name]} & FILES.keys() for name in FILES}


def room(name: str) -> str:
    """Return the first part of a dotted name."""
    return name.partition(".")[0]


ARROWS = {(room(a), room(b)) for a in INSIDE for b in INSIDE[a] if room(a) != room(b)}
LIBRARIES = {(room(a), room(b)) for a in NAMED for b in NAMED[a]}
FOREIGN = {pair for pair in LIBRARIES if pair[1] not in sys.stdlib_module_names | {"echolearn"}}


def floor(name: str) -> int:
    """Return how many rooms lie on the longest way down from one."""
    return 1 + max((floor(b) for a, b in ARROWS if a == name), default=0)


def test_imports_go_down_only() -> None:
    assert {(a, b) for a, b in ARROWS if ROOMS.index(a) > ROOMS.index(b)} == set()


def test_the_house_is_low_and_has_few_stairs() -> None:
    assert len(ARROWS) <= 100 and max(map(floor, ROOMS)) <= 10


def test_no_circle_of_files() -> None:
    TopologicalSorter(INSIDE).prepare()


def test_what_runs_on_a_robot_imports_nothing_else() -> None:
    assert {(a, b) for a, b in ARROWS if a in ROBOT and b not in ROBOT} == set()


def test_each_library_is_imported_by_its_owners_only() -> None:
    owned = {(a, name) for names, rooms in OWNERS.items() for name in names.split() for a in rooms}
    assert FOREIGN - owned == set()


def test_each_library_is_declared() -> None:
    """Not left to those that happen to need it, too."""
    text = (ROOT / "pyproject.toml").read_text()
    project = tomllib.loads(text)["project"]
    extras = project["optional-dependencies"].values()
    wanted = " ".join(sum(extras, project["dependencies"]))
    for _, name in FOREIGN:
        assert DISTRIBUTIONS.get(name, name.replace("_", "-")) in wanted


def test_nothing_reads_or_writes_pickles() -> None:
    unsafe = r"import (pickle|shelve|marshal)\b|allow_pickle=True|weights_only=False"
    assert [path for path in FILES.values() if re.search(unsafe, path.read_text())] == []


@pytest.mark.parametrize(("folder", "groups"), IMPLEMENTATIONS.items())
def test_what_a_glob_finds_is_what_can_be_chosen(folder: str, groups: list[str]) -> None:
    configs = [path.read_text() for each in groups for path in ROOT.glob(f"conf/{each}/*.yaml")]
    chosen = re.findall(rf"echolearn\.({folder}\.\w+)\.", " ".join(configs))
    assert {name for name in FILES if name.startswith(folder)} == set(chosen)


@pytest.mark.parametrize(
    ("name", "libraries"),
    [
        ("robot.scorer", {"onnxruntime"}),
        ("localization.localize, echolearn.mapping.echo_map, echolearn.evaluation.metrics", set()),
        ("simulation.survey, echolearn.training.runs, echolearn.comparison.compare", {"yaml"}),
    ],
)
def test_robots_and_finished_work_wait_for_no_heavy_library(name: str, libraries: set[str]) -> None:
    heavy = {library for _, library in FOREIGN} - {"numpy", "scipy", "filelock", "threadpoolctl"}
    code = f"import sys, echolearn.{name}; print(*{heavy} & sys.modules.keys())"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) <= libraries
