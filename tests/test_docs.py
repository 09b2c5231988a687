"""What the pages show is there, runs, and does what they say."""

import ast
import re
import shutil
import subprocess
import sys
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from runpy import run_path

import pytest

from echolearn.cli import compose, own

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
SHOWN = re.compile(r"^`((?:src|conf|tests)/\S+)`:\n\n```(?:python|yaml)\n(.*?)^```", re.M | re.S)
FILES = dict(found for page in PAGES for found in SHOWN.findall(page.read_text()))
"""Files that pages show, by their path."""


def code(page):
    """Return the Python on a page that is no file of its own."""
    [block] = re.findall(r"(?<!`:\n\n)```python\n(.*?)^```", page.read_text(), re.M | re.S)
    return str(block)


def test_every_yaml_file_on_a_page_has_a_name():
    """So that it is tested: what follows covers all that have."""
    fences = [fence for page in PAGES for fence in re.findall("^```yaml", page.read_text(), re.M)]
    assert len(fences) == sum(name.endswith(".yaml") for name in FILES)


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """Return a copy of the project to which the files on the pages have been added."""
    place = tmp_path_factory.mktemp("extended")
    for folder in ("src", "conf", "tests"):
        shutil.copytree(ROOT / folder, place / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", place)
    for name, text in FILES.items():
        assert not (place / name).exists(), name
        (place / name).write_text(text)
    return place


def checked(place, *tests):
    """Run tests of the copy on what the pages add to it, and return how many have passed."""
    names = " or ".join(Path(name).stem for name in FILES)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-k", names]
    environment = {"PYTHONPATH": str(place / "src"), "PATH": "/usr/bin", "OMP_NUM_THREADS": "1"}
    run = subprocess.run([*command, *tests], cwd=place, env=environment, capture_output=True)
    assert run.returncode == 0, run.stdout.decode()[-3000:]
    return int(re.findall(r"(\d+) passed", run.stdout.decode())[-1])


def test_shown_configurations_compose_build_and_have_all_keys(extended, monkeypatch):
    """As those do that are there already, among which they are found."""
    found_by = extended / "src" / "echolearn" / "cli" / "own.py"
    monkeypatch.setitem(own.folder.__globals__, "__file__", str(found_by))
    # What tests before have read is remembered by the folder of the others.
    compose._parse.cache_clear()
    for name in FILES:
        room = Path(name).parent
        if room.parts[0] == "src":
            package = import_module(".".join(room.parts[1:]))
            monkeypatch.setattr(package, "__path__", [*package.__path__, str(extended / room)])
    checks = run_path(str(ROOT / "tests" / "cli" / "test_configs.py"))
    shown = [extended / name for name in FILES if name.endswith(".yaml")]
    for path in shown:
        assert path in checks["FILES"]
        checks["test_every_file_begins_with_what_it_calls"](path)
        checks["test_every_file_can_be_built"](path)
        checks["test_every_file_shows_all_keys_of_what_it_calls"](path)
        if path.parent.name == "plan":
            checks["test_a_plan_is_named_after_its_file"](path.stem)


@pytest.mark.release
def test_shown_parts_keep_the_contracts(extended):
    rooms = "classifiers localization simulation runtime dataset"
    assert checked(extended, *(f"tests/{room}" for room in rooms.split())) > 50


def test_the_readme_is_one_page_and_its_code_runs(packed, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert (ROOT / "README.md").read_text().count("\n") <= 120
    exec(code(ROOT / "README.md").replace("runs/bundles/best", str(packed)), {})
    assert capsys.readouterr().out.startswith("[[")


# ---------------------------------------------------------------- the house on one page

ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text()
PATHS = {
    title: re.findall(r"^\d\. `([\w/]+\.py):([\w.]+)`(?: \(as `(\w+)`\))?", text, re.M)
    for title, text in re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", ARCHITECTURE, re.M | re.S)
}
"""For each command its functions, with the name by which the former calls it."""


def source(path, name):
    """Return the text of a function or method."""
    text = (ROOT / "src" / "echolearn" / path).read_text()
    node = ast.parse(text)
    for part in name.split("."):
        inside = [n for n in ast.iter_child_nodes(node) if getattr(n, "name", "") == part]
        assert inside, f"{path} has no {name}"
        node = inside[-1]
    return str(ast.get_source_segment(text, node))


def test_the_page_follows_the_commands_that_make_something():
    assert set(PATHS) == {
        *"generate train compare survey import export check map live fit".split(),
        "localize",
    }


@pytest.mark.parametrize("title", PATHS)
def test_each_step_from_a_command_to_the_arithmetic_names_the_next(title):
    steps = PATHS[title]
    if title != "localize":
        assert steps[0][:2] == ("cli/commands.py", f"_{title}") and len(steps) <= 6
    for (path, name, _), (_, after, alias) in pairwise(steps):
        called = alias or after.removesuffix(".__call__").rpartition(".")[2]
        assert re.search(rf"\b{called}\b", source(path, name)), f"{path}:{name} names no {called}"
    assert re.search(r"\b(np|fft)\.", source(*steps[-1][:2]))


def test_what_one_looks_for_stands_where_the_page_says():
    [table] = re.findall(r"^## Where do I find \.\.\.\n(.*?)^## ", ARCHITECTURE, re.M | re.S)
    places = re.findall(r"`([\w/]+\.py):([\w.]+)`", table)
    assert len(places) > 20
    assert all(source(path, name) for path, name in places)


def test_every_room_has_its_line():
    package = ROOT / "src" / "echolearn"
    rooms = {path.parent.name for path in package.glob("*/__init__.py")} | {"checks"}
    assert rooms == set(re.findall(r"^\| `([a-z]+)` \|", ARCHITECTURE, re.M))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_file_that_a_page_names_is_there(page):
    known = [ROOT, ROOT / "src" / "echolearn"]
    for name in re.findall(r"`([\w./]+/\w+\.(?:py|yaml|md))\b", page.read_text()):
        assert name in FILES or any((place / name).exists() for place in known), name
