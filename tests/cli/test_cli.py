"""The command line as its user meets it: what it says, what it leaves behind, how it exits."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from echolearn.cli.commands import COMMANDS
from echolearn.cli.config import folder
from echolearn.cli.main import main
from echolearn.storage import manifests

SMALL = (
    "plan=tiny plan.step=4.0 plan.height=3.0 plan.shard_rows=2 plan.room.t60=0.25 "
    "scene.probe.length=6000 localizer.azimuths=36 workers=1"
).split()
"""Six rows in three shards."""

LEARN = (
    "plan=tiny_scattered plan.rows=60 plan.t60=[0.25,0.25] plan.size_high=[6,6,3] scene.probe.length=6000 "
    "localizer.azimuths=36 workers=1"
).split()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, and return it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def started(*words: str) -> subprocess.Popen[str]:
    """Start the command line in a process of its own."""
    command = [sys.executable, "-m", "echolearn", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def only_set(where: Path) -> Path:
    """Return the one set below `where`."""
    [found] = (where / "runs" / "data").iterdir()
    return found


def content(where: Path, pattern: str = "*") -> dict[str, bytes]:
    """Return the bytes of every file in a folder."""
    return {path.name: path.read_bytes() for path in where.glob(pattern)}


# ---------------------------------------------------------------- help


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"]])
def test_help_names_every_command_and_what_it_does(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 0
    said = capsys.readouterr().out
    for name, function in COMMANDS.items():
        assert f"  {name:10}{function.__doc__}" in said


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from echolearn.cli.main import main; main(['--help']); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(run.stdout.splitlines()[-1].split())
    assert not modules & {
        "numpy",
        "scipy",
        "torch",
        "sklearn",
        "hydra",
        "omegaconf",
        "lightning",
        "matplotlib",
        "rich",
    }


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_help_of_a_command_shows_its_groups_and_keys(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0
    said = capsys.readouterr().out
    assert f"usage: echolearn {command}" in said
    assert "\nruns: runs  # folder of everything generated\n" in said
    if command in ("generate", "train", "survey"):
        assert "  rir         images, pyroom" in said


def test_a_configuration_can_be_shown_instead_of_run(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", "--cfg", "plan=tiny", "plan.seed=41"]) == 0
    assert "\n  seed: 41\n" in capsys.readouterr().out
    assert list(elsewhere.iterdir()) == []


# ---------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("line", "status", "said"),
    [
        ("genrate", 2, "genrate: there is no such command; did you mean generate?"),
        ("generate --mutlirun", 2, "--mutlirun: there is no such option"),
        ("generate -j 2", 2, "-j: is for sweeps over several values; -m is missing"),
        (
            "generate hydra/launcher=joblib",
            2,
            "hydra/launcher=joblib: is for sweeps over several values",
        ),
        ("generate plan=tiny -- plan.seed=3", 2, "--: is for sweeps over several values; -m is missing"),
        ("generate -m -- --mutlirun", 2, "--mutlirun: there is no such option"),
        (
            "generate -m -j two",
            2,
            "-j: must be followed by the number of processes, from 1 to 1024",
        ),
        ("generate -m -j 0", 2, "-j: must be followed by the number of processes"),
        ("generate -m -j", 2, "-j: must be followed by the number of processes"),
        (
            "generate -m hydra/launcher=joblb",
            2,
            "Could not find 'hydra/launcher/joblb' Available options in",
        ),
        (
            "generate -m hydra/launcher=joblib hydra.launcher.jobs=2",
            2,
            "Could not override 'hydra.launcher.jobs'",
        ),
        (
            "generate -m hydra/sweeper=basic",
            2,
            "hydra/sweeper=basic: hydra's own settings are fixed, but for its",
        ),
        ("generate plan=papr", 2, "plan=papr: plan has no option papr; did you mean paper?"),
        ("generate plan=tiny,paper", 2, "plan=tiny,paper: several values need -m"),
        ("generate stepp=1", 2, "stepp=1: there is no key stepp; did you mean plan.step?"),
        ("generate plan.stepp=1", 1, "plan.stepp=1: there is no such key; did you mean step?"),
        ("generate +surprise=1", 2, "+surprise=1: there is no key surprise"),
        ("train lr=abc", 2, "lr=abc: there is no key lr"),
        (
            "train classifier=mlp_pair lr=abc",
            2,
            "lr=abc: there is no key lr; did you mean classifier.lr?",
        ),
        ("generate plan.step=0", 1, "plan.step=0 m: must be a number from 0.01 to 100 m"),
        ("generate plan.step=wide", 1, "plan.step=wide m: must be a number from 0.01 to 100 m"),
        ("generate workers=0", 1, "workers=0: must be a whole number from 1 to 1024"),
        (
            "generate plan.room.t60=0.2",
            1,
            "room.t60=0.2 s: at least 0.206 s in a 10 x 8 x 6 m room by Sabine's formula",
        ),
        (
            "generate plan.margin=0.1",
            1,
            "pose.position=(0.1, 0.1, 0.1) m: the whole array (radius 0.2 m) inside the",
        ),
        (
            "generate scene._target_=os.system",
            1,
            "_target_=os.system: must be a function or class defined in echolearn.*",
        ),
        (
            "train plan=tiny",
            1,
            "a set that exists under runs/data; run: echolearn generate plan=tiny",
        ),
        ("survey room.size=[8,6]", 1, "room.size=[8, 6]: three lengths in m"),
        ("compare", 1, "runs=runs: a folder with trained runs"),
        ("verify", 2, "verify: name one or more folders"),
        (
            "verify nowhere",
            1,
            "folder=nowhere: must be a folder that echolearn made; there is no such folder",
        ),
        (
            "verify /dev/null",
            1,
            "folder=/dev/null: must be a folder that echolearn made; it is a file",
        ),
        (
            "verify .",
            1,
            ".: not finished, or not made by echolearn: there is no manifest.json, metrics.json or bundle.json in it",
        ),
        (
            "verify --foo",
            2,
            "--foo: there is no such option; verify takes folders, ./--foo if it is one",
        ),
        ("verify . --foo", 2, "--foo: there is no such option"),
        (
            "export run=nope",
            1,
            "run=nope: a folder that echolearn train wrote; there is no such folder",
        ),
        (
            "export run=/dev/null",
            1,
            "run=/dev/null: a folder that echolearn train wrote; it is a file",
        ),
        (
            "export best=runs/compare/paper",
            1,
            "there is no such folder; make paper makes runs/compare/paper, or: echol",
        ),
        (
            "survey runs=/dev/null",
            1,
            "cannot be written (Not a directory); is the folder the right one?",
        ),
        ("generate runs=/dev/null plan=tiny", 1, "(Not a directory); is the folder the right one?"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing_behind(
    line: str, status: int, said: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert said in err
    assert list(elsewhere.iterdir()) == []


def test_an_empty_name_is_not_this_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", ""]) == 1
    assert (
        capsys.readouterr().err
        == "error: folder=: must be a folder that echolearn made; is a variable of the shell empty?\n"
    )


def test_a_traceback_leads_to_where_a_configuration_is_wrong() -> None:
    """Also in a process of its own, where a copy composes it."""
    _, said = started("generate", "plan=papr", "--traceback").communicate()
    assert "in compose" in said and "During handling" not in said
    assert said.endswith("\nerror: plan=papr: plan has no option papr; did you mean paper?\n")


def test_a_traceback_is_shown_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["generate", "plan.step=0", "--traceback"]) == 1
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert "in __post_init__" in err
    assert err.splitlines()[-1].startswith("error: plan.step=0")


def test_a_folder_that_cannot_be_written_is_one_line(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (elsewhere / "runs").write_text("a file where a folder should be")
    assert main(["generate", *SMALL]) == 1
    err = capsys.readouterr().err
    assert "cannot be written (Not a directory)" in err.splitlines()[-1]
    assert "Traceback" not in err


# ---------------------------------------------------------------- work


def test_a_sweep_goes_on_after_a_failure_and_names_it(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", "-m", *SMALL, "plan.step=0,4.0,-1"]) == 1
    out, err = capsys.readouterr()
    assert out == f"{only_set(elsewhere).relative_to(elsewhere)}\n"
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert errors[0].startswith("error: plan.step=0: plan.step=0 m: a number")
    assert errors[1].startswith("error: plan.step=-1: plan.step=-1 m: a number")
    assert errors[2:] == ["error: 2 of 3 jobs failed: plan.step=0; plan.step=-1"]
    assert [path.name for path in elsewhere.iterdir()] == ["runs"]


def test_a_set_is_made_once_verified_and_mended(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", *SMALL]) == 0
    made = only_set(elsewhere)
    before, times = content(made), {path: path.stat().st_mtime_ns for path in made.iterdir()}
    assert main(["generate", *SMALL]) == 0
    assert {path: path.stat().st_mtime_ns for path in made.iterdir()} == times
    assert main(["verify", str(made)]) == 0
    assert capsys.readouterr().out.endswith(f"{made}: whole, 3 files\n")
    damaged = bytearray(before["shard-00001.npy"])
    damaged[len(damaged) // 2] ^= 4
    (made / "shard-00001.npy").write_bytes(damaged)
    assert main(["verify", str(made)]) == 1
    assert (
        "shard-00001.npy: damaged, its SHA-256 differs; run again: echolearn generate"
        in capsys.readouterr().err
    )
    assert main(["generate", *SMALL]) == 0
    assert content(made) == before


@pytest.mark.parametrize("name", ["", "name=hall"])
def test_the_advice_against_damage_makes_the_same_again(
    name: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"room.size=[5,4.5,3] room.t60=0.25 poses=3 scene.probe.length=6000 snr_db=10 {name}".split()
    assert main(["survey", *words]) == 0
    folder = capsys.readouterr().out.strip()
    before = content(Path(folder) / "observations") | content(Path(folder), "*.*")
    (Path(folder) / "poses.csv").write_text("index")
    assert main(["verify", folder]) == 1
    advice = capsys.readouterr().err.strip().partition("run again: ")[2]
    assert shlex.split(advice) == ["echolearn", "survey", *words]
    assert main(shlex.split(advice)[1:]) == 0
    assert content(Path(folder) / "observations") | content(Path(folder), "*.*") == before


def test_an_interrupted_set_is_continued_to_the_same_bytes(elsewhere: Path) -> None:
    words = [
        "plan.step=1.5" if word == "plan.step=4.0" else word for word in SMALL
    ]  # it takes longer than noticing its first shard
    assert main(["generate", *words]) == 0
    whole = content(only_set(elsewhere))
    shutil.rmtree("runs")
    with started("generate", *words) as process:
        while process.poll() is None and not list(elsewhere.glob("runs/data/*/shard-*.json")):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=120)[1]
    assert process.returncode == 130
    assert (
        err.splitlines()[-1]
        == "error: interrupted; the same command continues with what is finished"
    )
    assert not (only_set(elsewhere) / manifests.MANIFEST).exists()
    assert main(["generate", *words]) == 0
    assert content(only_set(elsewhere)) == whole


def test_several_sweeps_share_what_stands_before_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            "train -m --cfg test_share=0.3 -- classifier=svm_toa seed=0,1 -- seed=2 folds=5".split()
        )
        == 0
    )
    commands = [
        line for line in capsys.readouterr().out.splitlines() if line.startswith("command: ")
    ]
    assert [line.removeprefix("command: echolearn train ") for line in commands] == [
        "test_share=0.3 classifier=svm_toa seed=0",
        "test_share=0.3 classifier=svm_toa seed=1",
        "test_share=0.3 seed=2 folds=5",
    ]


def test_a_sweep_leaves_the_same_wherever_its_jobs_run(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two thresholds, and two jobs that fail: one after another, then shared out by joblib."""
    words = ["train", "-m", *LEARN[:-1], "classifier=threshold_peak,threshold_score", "seed=0,-1"]
    assert main(["generate", *LEARN]) == 0
    capsys.readouterr()

    def left(out: str, err: str) -> tuple[list[str], dict[tuple[str, str], bytes]]:
        errors = [line for line in err.splitlines() if line.startswith("error: ")]
        names = ("metrics.json", "config.json", "model.onnx")
        return errors, {
            (line, name): (elsewhere / line / name).read_bytes()
            for line in out.splitlines()
            for name in names
        }

    assert main(words) == 1
    errors, files = left(*capsys.readouterr())
    shutil.rmtree("runs/train")
    with started(*words, "hydra/launcher=joblib", "hydra.launcher.n_jobs=2") as process:
        said = process.communicate(timeout=120)
    assert process.returncode == 1
    assert left(*said) == (errors, files)
    assert len(files) == 6
    assert errors[:2] == [
        f"error: classifier=threshold_{x} seed=-1: seed=-1: must be a whole number from 0 to 2147483647"
        for x in ("peak", "score")
    ]
    assert errors[2].startswith(
        "error: 2 of 4 jobs failed: classifier=threshold_peak seed=-1; classifier="
    )


def test_a_finished_run_is_found_without_loading_what_trains(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*LEARN[:-1], "classifier=threshold_peak"]
    assert main(["generate", *LEARN]) == 0
    assert main(["train", *words]) == 0
    capsys.readouterr()
    code = f"import sys; from echolearn.cli.main import main; main({['train', *words]}); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    path, modules = run.stdout.splitlines()
    assert (elsewhere / path / "metrics.json").is_file()
    assert not set(modules.split()) & {"torch", "sklearn", "lightning", "onnxruntime", "matplotlib"}


def test_commands_work_from_any_folder_without_leaving_anything_there(elsewhere: Path) -> None:
    assert main(["generate", *SMALL, f"runs={elsewhere / 'deep' / 'runs'}"]) == 0
    assert [path.name for path in elsewhere.iterdir()] == ["deep"]
    assert not (folder() / "runs").exists()
    assert os.listdir(elsewhere / "deep" / "runs") == ["data"]


@pytest.mark.parametrize("command", sorted(COMMANDS))
@pytest.mark.parametrize("runs", ["", "' '"])
def test_a_folder_without_a_name_is_refused_by_every_command(
    command: str, runs: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, f"runs={runs}", "--cfg"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: runs=") and said.endswith(
        ": must be the name of a folder; the current one is runs=.\n"
    )
    assert list(elsewhere.iterdir()) == []
