"""What pip installs works without a clone: from the wheel and the sdist, on old and new libraries.

The own classifier is the one that docs/extend.md shows, in a folder of its own.
"""

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WALK = ROOT / "examples" / "survey" / "short"

pytestmark = pytest.mark.release


def oldest(*extras):
    """Return the lower bounds of the metadata as versions to be installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = [*project["dependencies"]]
    for extra in extras:
        needed += project["optional-dependencies"][extra]
    found = [re.fullmatch(r"([\w-]+)>=([\d.]+).*", each) for each in needed]
    return [f"{each[1]}=={each[2]}" + ".*" * (each[2].count(".") < 2) for each in found if each]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return the files of a release by their kind; the wheel is made from the sdist."""
    place = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(place), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    [wheel] = place.glob("*.whl")
    [sdist] = place.glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


def environment(place, *wanted):
    """Return the programs of a fresh environment with what is wanted."""
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    words = [place / "bin" / "pip", "install", "--quiet", *map(str, wanted)]
    subprocess.run(words, check=True)
    return place / "bin"


def said(programs, *words, folder, status=0):
    """Run a command line of an environment in a folder; return what it says."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(
        [programs / "echolearn", *map(str, words)],
        cwd=folder,
        env=clean,
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("versions", ["oldest", "newest"])
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_alone_it_helps_checks_and_names_the_extra(kind, versions, built, tmp_path):
    more = oldest() if versions == "oldest" else []
    programs = environment(tmp_path / "venv", built[kind], *more)
    for words in ([], ["--help"], ["train", "--help"], ["--version"]):
        assert said(programs, *words, folder=tmp_path)
    assert "map would take it" in said(programs, "check", f"survey={WALK}", folder=tmp_path)
    hints = {"train": "lab", "tune": "lab,tune", f"map survey={WALK}": "maps"}
    for line, extra in hints.items():
        told = said(
            programs, *line.split(), folder=tmp_path, status=2 if line != [*hints][2] else 1
        )
        assert told.endswith(f"pip install 'echolearn[{extra}]'\n") and told.count("\n") == 1

    # The extra that is named is enough.
    extras = oldest("maps")[-2:] if versions == "oldest" else ["onnxruntime", "soundfile"]
    subprocess.run([programs / "pip", "install", "--quiet", *extras, *more], check=True)
    told = said(programs, "map", f"survey={WALK}", "name=m", folder=tmp_path)
    assert "points in the map" in told
    assert "whole" in said(programs, "verify", "m", folder=tmp_path)


def test_an_own_classifier_from_an_own_folder_goes_all_the_way(built, tmp_path):
    """docs/extend.md, by who has installed the wheel and nothing else."""
    page = (ROOT / "docs" / "extend.md").read_text()
    shown = dict(re.findall(r"^`(\S*logistic\S*)`:\n\n```\w+\n(.*?)^```", page, re.M | re.S))
    module, option = shown.values()
    (tmp_path / "mine" / "classifier").mkdir(parents=True)
    (tmp_path / "mine" / "logistic.py").write_text(module)
    option = option.replace("echolearn.classifiers.methods.logistic", "logistic")
    (tmp_path / "mine" / "classifier" / "logistic_features.yaml").write_text(option)

    # The torch that these tests run on: the newest of PyPI brings gigabytes of CUDA, unused here.
    torch = f"torch=={version('torch').partition('+')[0]}"
    programs = environment(tmp_path / "venv", f"{built['wheel']}[lab]", torch)
    lines = """
        generate plan=tiny_scattered
        survey room=8x6x5 snr_db=0 poses=12
        train --config-dir=mine classifier=logistic_features plan=tiny_scattered
        train classifier=threshold_peak plan=tiny_scattered
        compare name=own tested=[tiny_scattered] surveys=[8x6x5_0dB] resamples=20
        export run=logistic_features name=own
        map survey=8x6x5_0dB bundle=own
        verify own
    """
    told = [said(programs, *line.split(), folder=tmp_path) for line in lines.strip().splitlines()]
    assert "| logistic_features" in told[4]
    assert "golden confidences reproduced" in told[7]
    installed = next((tmp_path / "venv").glob("lib/*/site-packages/echolearn"))
    assert not list(installed.rglob("*logistic*"))
