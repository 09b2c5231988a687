"""Who may import whom: the layers of the project, read from the sources themselves."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

import echolearn

SOURCE = Path(echolearn.__file__).parent

ORDER = """
    types literal timing processes progress words config disk store engine markers geometry matching signals coverage
    stats audio description direct recording provenance noise localize rir features metrics mapping guard schema
    bundle deploy onboard lines mapfiles cartography simulate plans records dataset survey judge hearing classify task
    training trained tables figures report compare trials curves places study expected pages export bench launch
    commands cli
""".split()
"""A part imports only parts that stand before it; a folder is one part."""

ROBOT = {
    *"types disk store geometry matching signals coverage audio description recording localize features".split(),
    *"metrics mapping guard schema bundle deploy onboard timing provenance progress direct lines".split(),
    *"mapfiles cartography".split(),
}
"""Parts that run on a robot: numpy and scipy, YAML where surveys are read, onnxruntime where
bundles are loaded; rich for bars, soundfile for FLAC and rosbags for bags where they are installed.
"""

OWNERS = {
    "hydra": {"config", "launch"},
    "omegaconf": {"config", "launch"},
    "yaml": {"config", "words", "cli", "description", "recording"},
    "torch": {"classify"},
    "lightning": {"classify"},
    "sklearn": {"classify"},
    "onnx": {"bench", "classify"},
    "onnxruntime": {"classify", "deploy"},
    "pyroomacoustics": {"rir"},
    "soundfile": {"audio", "noise"},
    "rir_generator": {"bench"},
    "numba": {"rir"},
    "llvmlite": {"rir"},
    "matplotlib": {"figures", "curves"},
    "jinja2": {"report"},
    "rich": {"progress"},
    "dask": {"engine"},
    "distributed": {"engine"},
    "dask_jobqueue": {"engine"},
    "threadpoolctl": {"engine"},
    "rosbags": {"mapfiles"},
    "numpy": set(ORDER),
    "scipy": set(ORDER),
}
"""Which parts import each library."""

HEAVY = (
    "torch sklearn hydra omegaconf lightning pyroomacoustics numba matplotlib onnx onnxruntime yaml dask distributed "
    "rosbags soundfile"
).split()


def part(path: Path) -> str:
    """Return the part of the project that a file belongs to."""
    return path.relative_to(SOURCE).with_suffix("").parts[0]


def imports(path: Path, *, lazy: bool = True) -> Iterator[str]:
    """Yield the dotted names that a file imports, with those inside functions if `lazy`."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree) if lazy else tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            whole = f"{node.module}"
            yield from (
                (f"{whole}.{alias.name}" for alias in node.names)
                if whole == "echolearn"
                else (whole,)
            )


FILES = sorted(
    path for path in SOURCE.rglob("*.py") if path.name != "__init__.py" or path.parent != SOURCE
)
EDGES = {
    (part(path), part(SOURCE / name.split(".")[1]))
    for path in FILES
    for name in imports(path)
    if name.startswith("echolearn.")
}
LIBRARIES = {
    (part(path), name.split(".")[0])
    for path in FILES
    for name in imports(path)
    if not name.startswith("echolearn")
}


def test_every_part_has_its_place() -> None:
    assert {part(path) for path in FILES} == set(ORDER)


def test_the_package_itself_imports_nothing() -> None:
    assert list(imports(SOURCE / "__init__.py")) == []


def test_imports_go_downwards_only() -> None:
    upward = {(a, b) for a, b in EDGES if a != b and ORDER.index(b) >= ORDER.index(a)}
    assert upward == set()


def test_what_runs_on_a_robot_imports_only_what_runs_on_a_robot() -> None:
    assert {(a, b) for a, b in EDGES if a in ROBOT and b not in ROBOT} == set()
    libraries = {
        (a, name) for a, name in LIBRARIES if a in ROBOT and name not in sys.stdlib_module_names
    }
    assert {name for _, name in libraries} <= {
        "numpy",
        "scipy",
        "yaml",
        "onnxruntime",
        "rich",
        "rosbags",
        "soundfile",
    }


def test_classifiers_know_nothing_of_rooms_and_recordings() -> None:
    assert {b for a, b in EDGES if a == "classify"} <= {"classify", "types", "disk"}


def test_statistics_stand_alone() -> None:
    assert {b for a, b in EDGES if a == "stats"} <= {"types"}


def test_each_library_is_imported_by_its_owners_only() -> None:
    foreign = {(a, name) for a, name in LIBRARIES if name not in sys.stdlib_module_names}
    assert {(a, name) for a, name in foreign if a not in OWNERS.get(name, set())} == set()


def test_each_library_is_declared() -> None:
    """Not left to those that happen to need it, too."""
    project = tomllib.loads((SOURCE.parents[1] / "pyproject.toml").read_text())["project"]
    wanted = [
        *project["dependencies"],
        *chain.from_iterable(project["optional-dependencies"].values()),
    ]
    declared = {re.match(r"[\w-]+", line)[0].lower() for line in wanted}  # type: ignore[index]
    known = packages_distributions() | {
        "distributed": ["dask"],
        "omegaconf": ["hydra-core"],
    }  # parts of those
    foreign = {name for _, name in LIBRARIES if name not in sys.stdlib_module_names}
    given = {
        name: {each.lower().replace("_", "-") for each in known.get(name, [name])}
        for name in foreign
    }
    assert {name for name in foreign if not declared & given[name]} == set()


def test_nothing_reads_or_writes_pickles() -> None:
    assert {name for _, name in LIBRARIES} & {
        "pickle",
        "dill",
        "cloudpickle",
        "joblib",
        "shelve",
        "marshal",
    } == set()
    for path in FILES:
        text = path.read_text()
        assert "allow_pickle=True" not in text, path
        assert "weights_only=False" not in text, path


def loaded(code: str) -> set[str]:
    """Return which heavy libraries are loaded in a fresh process after `code`."""
    code += f"\nimport sys; print(*(name for name in {HEAVY} if name in sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.splitlines()[-1].split())


def test_the_robots_parts_load_no_heavy_library() -> None:
    light = ROBOT - {"deploy", "onboard", "description", "recording", "provenance", "cartography"}
    names = [
        ".".join(p.relative_to(SOURCE.parent).with_suffix("").parts)
        for p in FILES
        if part(p) in light
    ]
    assert loaded("import " + ", ".join(name.removesuffix(".__init__") for name in names)) == set()


def test_what_loads_bundles_loads_onnxruntime_alone() -> None:
    assert loaded("import echolearn.robot.scorer") == {"onnxruntime"}


@pytest.mark.parametrize(
    "name", ["training", "task", "trained", "dataset", "survey", "compare", "launch"]
)
def test_what_only_looks_whether_work_is_done_loads_no_heavy_library(name: str) -> None:
    assert loaded(f"import echolearn.{name}") <= {"yaml"}
