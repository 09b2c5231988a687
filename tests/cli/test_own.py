"""A user's own parts, in a folder of the user's own; what the tab key and `--info` say of all."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from echolearn.cli.completion import SCRIPTS
from echolearn.cli.main import main
from echolearn.cli.own import VARIABLE

MODULE = '''"""A column itself."""

from echolearn.classifiers.methods.threshold import Threshold


class Plain(Threshold):
    """A threshold under another name."""
'''


class Done(NamedTuple):
    """What became of a command line."""

    returncode: int
    stdout: str
    stderr: str


OPTION = """_target_: plain.Plain
inputs: [score]  # the column
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return a folder with a module, an option and a command's own file."""
    (tmp_path / "mine" / "classifier").mkdir(parents=True)
    (tmp_path / "mine" / "plain.py").write_text(MODULE)
    (tmp_path / "mine" / "classifier" / "plain_score.yaml").write_text(OPTION)
    (tmp_path / "mine" / "quick.yaml").write_text("defaults: [train, _self_]\nseed: 5\n")
    return tmp_path


LINES = """
import json, os, sys
import hydra, numpy
from echolearn.cli.main import main
for line in sys.stdin:
    words, folder, variables = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        os.environ.update(variables)
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{folder}/.{name}", os.O_CREAT | os.O_TRUNC | os.O_WRONLY), number)
        sys.exit(main(words))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""A program whose copies run a command line each: what takes time is to load the libraries."""


@pytest.fixture(scope="module")
def lines() -> Iterator[subprocess.Popen[str]]:
    """Return the process that runs command lines in copies of itself."""
    command = [sys.executable, "-c", LINES]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def echolearn(lines: subprocess.Popen[str]) -> Callable[..., Done]:
    """Return what runs a command line in a folder, with some variables in its environment."""

    def run(*words: str, folder: Path, **variables: str) -> Done:
        lines.stdin.write(f"{json.dumps([words, str(folder), {'COLUMNS': '200'} | variables])}\n")
        lines.stdin.flush()
        status = int(lines.stdout.readline())
        out, err = ((folder / f".{name}").read_text() for name in ("out", "err"))
        return Done(status, out, err)

    return run


def test_a_classifier_of_ones_own_is_trained_and_its_run_says_where_it_comes_from(
    own, monkeypatch, capsys
):
    monkeypatch.chdir(own)
    # What the command leaves of the folder in this process goes with the test.
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.setattr(sys, "path", [*sys.path])
    words = [
        "plan=tiny_scattered",
        "plan.rows=64",
        "plan.name=few",
        "plan.t60=[0.25,0.25]",
        "plan.size_high=[6,6,3]",
    ]
    words += ["scene.probe.length=6000", "localizer.azimuths=36"]
    assert main(["generate", *words, "engine=serial"]) == 0
    # Asked before the folder is named, which an earlier answer must not hide.
    assert main(["train", *words, "classifier=plain_score"]) == 2
    assert main(["train", *words, "classifier=plain_score", "--config-dir", "mine"]) == 0
    monkeypatch.delitem(sys.modules, "plain")
    runs = list((own / "runs" / "train").iterdir())
    assert [run.name[:19] for run in runs] == ["plain_score-few-s0-"]
    assert f"--config-dir={own / 'mine'}" in (runs[0] / "metrics.json").read_text()
    assert '"plain.Plain"' in (runs[0] / "config.json").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["train", "--config-dir=mine", "-m", "classifier=glob(plain*)", "--cfg"], "plain.Plain"),
        (["train", "--config-dir=mine", "--config-name=quick", "--cfg", "job"], "seed: 5"),
        (["train", "--multirun", "seed=1,2", "--cfg", "--resolve"], "seed: 2"),
        (["train", "--config-dir=mine", "--help", "classifier=plain_score"], "# the column"),
        (["train", "--help"], "keys of plan=paper"),
        (["train", "--config-dir=mine", "--info", "searchpath"], "/mine"),
        (["train", "--info", "defaults-tree"], "classifier: svm_pair"),
        (["train", "-i", "searchpath", "-cd", "mine"], "/mine"),
        (["train", "-cd", "mine", "-cn", "quick", "-c", "job", "-p", "seed"], "5"),
        (["train", "--cfg", "--package=classifier.inputs"], "- toa\n- power\n"),
        (["train", "--cfg", "hydra", "-p", "hydra.sweeper"], "BasicSweeper"),
        (["train", "seed=7", "--cfg=all"], "seed: 7"),
        (["train", "--version"], "."),
    ],
)
def test_what_hydra_offers_is_there(words, said, own, echolearn):
    done = echolearn(*words, folder=own)
    assert done.returncode == 0
    assert said in done.stdout
    assert done.stderr == ""


def test_the_folder_may_be_named_by_a_variable(own, echolearn):
    done = echolearn("train", "classifier=plain_score", "--cfg", folder=own, **{VARIABLE: "mine"})
    assert "plain.Plain" in done.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--config-dir", "nowhere"], "config-dir=nowhere: must be a folder"),
        (["--config-dir", "double"], "config-dir=double with classifier/svm_pair.yaml: must have"),
        (["--config-dir"], "--config-dir: must be followed by a folder"),
        (["--config-name", "none"], "none"),
        (["--info", "nothing"], "--info: must be followed by all or config"),
        (["--cfg", "nothing"], "--cfg: must be followed by job or hydra or all"),
        (["--cfg", "-p", "sed"], "--package=sed: there is no such key; did you mean seed?"),
        (["--package", "seed"], "--package=seed: is a part of what --cfg shows"),
        (["-m", "seed=interval(0,3)"], "seed=interval(0,3): an interval has no values"),
    ],
)
def test_a_slip_ends_in_one_line(words, said, own, echolearn):
    (own / "double" / "classifier").mkdir(parents=True)
    shutil.copy(
        own / "mine" / "classifier" / "plain_score.yaml",
        own / "double" / "classifier" / "svm_pair.yaml",
    )
    done = echolearn("train", *words, folder=own)
    assert done.returncode in (1, 2)
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("echolearn tr", ["train"]),
        ("echolearn train classi", ["classifier.", "classifier="]),
        ("echolearn train classifier=pl", ["classifier=plain_score"]),
        ("echolearn train classifier=trees_features classifier.it", ["classifier.iterations="]),
        ("echolearn train --config-n", ["--config-name"]),
        ("echolearn map survey=mi", ["survey=mine/"]),
        ("echolearn verify mi", ["mine/"]),
        ("echolearn nothing x", []),
    ],
)
def test_the_tab_key_completes(line, words, own, echolearn):
    variables = {VARIABLE: "mine", "COMP_LINE": line}
    done = echolearn("-sc", "query=bash", folder=own, **variables)
    assert done.stdout.split() == words


@pytest.mark.parametrize("shell", SCRIPTS)
def test_a_shell_can_read_what_it_is_to_evaluate(shell, own, echolearn):
    script = echolearn("-sc", f"install={shell}", folder=own).stdout
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    done = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_bash_completes_a_line(own):
    """The function that bash calls, called by bash itself."""
    program = own / "echolearn"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m echolearn "$@"\n')
    program.chmod(0o755)
    script = """eval "$(echolearn -sc install=bash)"
COMP_LINE="echolearn survey room=l"; COMP_POINT=${#COMP_LINE}; _echolearn
echo "${COMPREPLY[@]}" """
    path = f"{own}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], env=os.environ | {"PATH": path}, capture_output=True, text=True
    )
    assert done.stdout.strip() == "room=l_shape", done.stderr
