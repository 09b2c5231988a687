"""The pages as a site, and the notebooks among them: built strictly, executed as they stand."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))

EXECUTE = """
import sys, nbformat
from nbclient import NotebookClient
book = nbformat.read(sys.argv[1], 4)
NotebookClient(book, timeout=300, resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(book, sys.argv[1])
"""


def texts(path):
    """Return what a notebook's cells print, but for figures that depend on the machine."""
    cells = json.loads(path.read_text())["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    assert not any(output["output_type"] == "error" for output in outputs)
    kinds = [sorted(output.get("data", ())) for output in outputs]
    return [kind for kind in kinds if kind]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_executed_whole_and_small(path):
    cells = json.loads(path.read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == [*range(1, len(code) + 1)]
    assert texts(path) and path.stat().st_size <= 300_000


def test_the_table_of_contents_has_every_page_once():
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "cards").glob("*.md"), *NOTEBOOKS]
    names = [str(page.relative_to(ROOT / "docs").with_suffix("")) for page in pages]
    lines = (ROOT / "docs" / "index.md").read_text().splitlines()
    assert all(lines.count(name) == (name != "index") for name in names)


@pytest.fixture(scope="module")
def tools(tmp_path_factory):
    """Return `make` with an environment for the site of its own, made from its lock."""
    place = tmp_path_factory.mktemp("docs")
    bin_folder = Path(sys.executable).parent
    words = [f"DOCS={place}", "READY=", f"BIN={bin_folder}", f"PYTHON={sys.executable}"]
    subprocess.run(["make", "-s", *words, f"{place}/.ready"], cwd=ROOT, check=True)
    return place, ["make", "-s", *words]


@pytest.mark.release
def test_the_site_is_built_without_a_warning_and_opens_from_a_file(tools, tmp_path):
    """A link to a page, a heading or a name that is not there is a warning, hence an error."""
    run = subprocess.run(
        [*tools[1], f"RUNS={tmp_path}", "docs"], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr[-3000:]
    index = (tmp_path / "docs" / "index.html").read_text()
    for page in (*(ROOT / "docs").glob("*.md"), *NOTEBOOKS):
        name = page.relative_to(ROOT / "docs").with_suffix(".html")
        assert (tmp_path / "docs" / name).exists(), name
        assert name.name == "index.html" or f'href="{name}"' in index, name
    # Nothing is fetched from elsewhere, so it is whole without a network.
    assert 'src="http' not in index and 'rel="stylesheet" href="http' not in index
    reference = (tmp_path / "docs" / "reference.html").read_text()
    assert "received probe over white noise" in reference


@pytest.mark.release
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run_and_show_what_they_show(path, tools, tmp_path):
    folder = tmp_path / "docs" / "tutorials"
    folder.mkdir(parents=True)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    copy = Path(shutil.copy(path, folder))
    # `echolearn` as a user has it on the path.
    command = tmp_path / "bin" / "echolearn"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m echolearn "$@"\n')
    command.chmod(0o755)
    words = {"PATH": f"{command.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT / "src")}
    python = tools[0] / "bin" / "python"
    subprocess.run(
        [python, "-c", EXECUTE, str(copy), str(folder)], env=os.environ | words, check=True
    )
    assert texts(copy) == texts(path)
