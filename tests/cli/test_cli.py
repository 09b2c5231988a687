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

import echolearn
from echolearn.checks import BadValue
from echolearn.cli.commands import COMMANDS, _plan_of
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.cli.keys import without_inputs
from echolearn.cli.main import main
from echolearn.cli.own import folder
from echolearn.dataset.generate import folder_of
from echolearn.storage import known, manifests

SMALL = (
    "plan=tiny plan.step=4.0 plan.height=3.0 plan.shard_rows=2 plan.room.t60=0.25 "
    "scene.probe.length=6000 localizer.azimuths=36"
).split()
"""Six rows in three shards."""

ALONE = "engine=serial"
"""Where no process but the command's own is wanted: starting one takes longer than the work."""

LEARN = (
    "plan=tiny_scattered plan.rows=60 plan.t60=[0.25,0.25] plan.size_high=[6,6,3] "
    "scene.probe.length=6000 localizer.azimuths=36"
).split()


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Work in an empty folder, and return it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def started(*words):
    """Start the command line in a process of its own."""
    command = [sys.executable, "-m", "echolearn", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def loaded(*words):
    """Return what a command line prints in a fresh process, and the modules that it loads."""
    code = f"import sys; from echolearn.cli.main import main; main({words}); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    said, _, modules = run.stdout.rstrip("\n").rpartition("\n")
    return said, set(modules.split())


def only_set(where):
    """Return the one set below `where`."""
    [found] = (where / "runs" / "data").iterdir()
    return found


def content(where, pattern="*"):
    """Return the bytes of every file in a folder."""
    return {f"{path}": path.read_bytes() for path in where.rglob(pattern) if path.is_file()}


def errors(text):
    return [line for line in text.splitlines() if line.startswith("error: ")]


# ---------------------------------------------------------------- help


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"]])
def test_help_names_every_command_and_what_it_does(words, capsys):
    assert main(words) == 0
    said = capsys.readouterr().out
    for name, function in COMMANDS.items():
        assert f"  {name:10}{function.__doc__}" in said


def test_help_and_version_load_nothing_heavy():
    heavy = {"numpy", "scipy", "torch", "sklearn", "hydra", "omegaconf", "yaml", "rich"}
    assert not loaded("--help")[1] & heavy
    said, modules = loaded("--version")
    assert said == echolearn.__version__
    assert not modules & heavy


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_help_of_a_command_shows_its_groups_and_keys(command, capsys):
    assert main([command, "--help"]) == 0
    said = capsys.readouterr().out
    assert f"usage: echolearn {command}" in said
    assert "\nruns: runs  # folder of everything generated\n" in said
    if command in ("generate", "train", "survey"):
        assert "  rir         images, pyroom" in said


def test_a_configuration_can_be_shown_instead_of_run(here, capsys):
    assert main(["generate", "--cfg", "plan=tiny", "plan.seed=41"]) == 0
    assert "\n  seed: 41\n" in capsys.readouterr().out
    assert list(here.iterdir()) == []


# ---------------------------------------------------------------- mistakes

MISTAKES = """
2 | genrate | genrate: there is no such command; did you mean generate?
2 | generate --mutlirun | --mutlirun: there is no such option
2 | generate -j 2 | -j: is for sweeps over several values; -m is missing
2 | generate hydra/launcher=joblib | hydra/launcher=joblib: is for sweeps over several values
2 | generate plan=tiny -- plan.seed=3 | --: is for sweeps over several values; -m is missing
2 | generate -m -- --mutlirun | --mutlirun: there is no such option
2 | generate -m -j two | -j: must be followed by the number of processes, from 1 to 1024
2 | generate -m -j 0 | -j: must be followed by the number of processes
2 | generate -m -j | -j: must be followed by the number of processes
2 | generate -m hydra/launcher=joblb | Could not find 'hydra/launcher/joblb' Available options in
2 | generate -m hydra/launcher=joblib hydra.launcher.jobs=2 | Could not override 'hydra.launcher
2 | generate -m hydra/sweeper=basic | hydra/sweeper=basic: hydra's own settings are fixed, but for
2 | generate plan=papr | plan=papr: plan has no option papr; did you mean paper?
2 | generate plan=tiny,paper | plan=tiny,paper: several values need -m
2 | generate stepp=1 | stepp=1: there is no key stepp; did you mean plan.step?
1 | generate plan.stepp=1 | plan.stepp=1: there is no such key; did you mean step?
2 | generate +surprise=1 | +surprise=1: there is no key surprise
2 | train lr=abc | lr=abc: there is no key lr
2 | train classifier=mlp_pair lr=abc | there is no key lr; did you mean classifier.lr?
1 | generate plan.step=0 | plan.step=0 m: must be a number from 0.01 to 100 m
1 | generate plan.step=wide | plan.step=wide m: must be a number from 0.01 to 100 m
1 | generate workers=0 | workers=0: must be a whole number from 1 to 1024
1 | generate plan.room.t60=0.2 | room.t60=0.2 s: must be over 0.206 s
1 | generate plan.margin=0.1 | pose.position=(0.1, 0.1, 0.1) m: the array of radius 0.2 m must be
1 | generate scene._target_=os.system | scene._target_=os.system: must be a class like echolearn.
1 | train plan=tiny | must be a set that exists under runs/data; run: echolearn generate plan=tiny$
1 | train plan=tiny seed=3 plan.seed=5 rir=pyroom | run: echolearn generate plan=tiny plan.seed=5 r
2 | train -m plan=glob(zz*) | error: plan=glob(zz*): matches nothing; known are offgrid_10x8x6,
2 | train -m seed=glob(*) | error: seed=glob(*): matches nothing$
2 | train -m seed=range(0) | error: seed=range(0): matches nothing$
2 | generate -m plan=tiny,papr | plan has no option papr
2 | generate plan=zzz | plan has no option zzz; known are offgrid_10x8x6,
2 | generate plan.room.size.x=1 | there is no key plan.room.size.x
2 | generate plann=paper | there is no key plann; did you mean plan?
2 | generate ++new=1 | there is no key new
2 | generate ~runs | keys are set, runs=value, not deleted$
2 | generate ~plan.sdnr_db | keys are set, plan.sdnr_db=value, not deleted$
2 | generate ~nothing | there is no key nothing
2 | generate runs=a,b | several values need -m
2 | generate plan=[ | cannot be read; are quotes or brackets missing?$
2 | generate choice.plan=x | there is no key choice.plan
2 | generate command=x | there is no key command
2 | generate hydra.run.dir=x | hydra's own settings are fixed
2 | generate hydra/sweeper=basic | hydra's own settings are fixed
2 | generate runs=${nowhere} | nowhere
2 | generate runs=??? | Missing mandatory value
2 | generate plan.room=null | plan.room=null: plan.room cannot be null
2 | generate window=null | window cannot be null
2 | generate plan=null | plan=null: plan cannot be left out; it must be one of
2 | bench plan@growing=null | error: plan@growing=null: plan@growing cannot be left out; it must be
2 | map runs=null | error: runs=null: runs cannot be null
2 | map resampel=1 | error: resampel=1: there is no key resampel; did you mean resample
2 | map survey | error: survey: cannot be read; it is no key=value
2 | map survey=[a | survey=[a: cannot be read; quote it twice: "survey='[a'"$
2 | map survey='a | cannot be read; are quotes or brackets missing?$
2 | check survey=my walk | it is no key=value; are quotes around blanks missing?$
1 | map survey=. | error: survey.yaml: cannot be read (No such file or directory); is this the fo
1 | generate plan=tiny_scattered plan.rows=1e5 | must be a whole number from 1 to 1000000000; type
2 | map survey=a,b | several values need -m, or is it one name? Then quote it twice: "survey='a,b'"$
2 | map ' | cannot be read; it is no key=value; are quotes around blanks missing?$
1 | map runs=[a] | error: runs=[a]: must be a path; quote it twice: "runs='[a]'"$
1 | map bundle={a:1} | error: bundle={a:1}: must be a path
1 | map name=[a] | error: name=[a]: must be a name
1 | survey rir.order=3 | error: rir.order=3: there is no such key; it has none$
1 | survey room.size=[8,6] | room.size=[8, 6]: must be three lengths in m
1 | compare | runs=runs: must be a folder with trained runs
1 | map | survey=None: must be a folder in the recorded-survey format; name it:
2 | verify | verify: name one or more folders
1 | verify nowhere | folder=nowhere: must be a folder that echolearn made; there is no such folder
1 | verify /dev/null | folder=/dev/null: must be a folder that echolearn made; it is a file
1 | verify . | .: not finished, or not made by echolearn: there is no manifest.json, metrics.json or
2 | verify --foo | --foo: there is no such option; verify takes folders, ./--foo if it is one
2 | verify . --foo | --foo: there is no such option
1 | export run=nope | run=nope: must be a folder that echolearn train wrote; there is no such folder
1 | export run=/dev/null | run=/dev/null: must be a folder that echolearn train wrote; it is a file
1 | export best=runs/compare/paper | there is no such folder; make paper makes runs/compare/paper
1 | survey runs=/dev/null | cannot be written (Not a directory); is the folder the right one?
1 | generate runs=/dev/null plan=tiny | (Not a directory); is the folder the right one?
1 | study scene/probe=mls | bursts=each: must be one, that of scene/probe; each position would draw
1 | survey scene/probe=file | probe.path=None: must be a WAV file; scene.probe.path=
1 | survey scene/probe=sweep scene.probe.seconds=2 | probe.length=20000 samples: must be a whole
"""


@pytest.mark.parametrize("row", MISTAKES.strip().splitlines())
def test_a_mistake_is_one_line_and_leaves_nothing_behind(row, here, capsys):
    status, line, said = row.split(" | ")
    assert main(line.split()) == int(status)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert said in err.replace("\n", "$")
    assert list(here.iterdir()) == []


def test_a_number_of_thousands_of_digits_is_refused_in_plain_words(capsys):
    for words in (["survey", f"seed={'9' * 5000}"], ["train", "-m", f"seed=1,{'9' * 5000}"]):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert said.startswith("error: seed=") and len(said) < 300 and "sys." not in said
        assert "cannot be read; Exceeds the limit (4300 digits)" in said


@pytest.mark.parametrize("command", [*sorted(COMMANDS), "verify"])
@pytest.mark.parametrize("name", ["", " "])
def test_an_empty_name_is_not_this_folder(command, name, here, capsys):
    """An empty variable of the shell, say."""
    words = ["verify", ""] if command == "verify" else [command, f"runs='{name}'", "--cfg"]
    assert main(words) != 0
    assert " must be " in capsys.readouterr().err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("lost", ["2>&-", "2>/dev/full", ">&- 2>&-"])
def test_work_goes_on_where_nobody_can_be_told(lost, here):
    """Nor does what is said get into a file that was opened in the place of stderr."""
    for words, status in ((["generate", *SMALL, ALONE], 0), (["verify", "nothing"], 1)):
        command = shlex.join([sys.executable, "-m", "echolearn", *words])
        done = subprocess.run(["sh", "-c", f"exec {command} {lost}"], capture_output=True)
        assert done.returncode == status and done.stderr == b"", done.stderr
        assert b"error" not in done.stdout
    manifests.verify(only_set(here))


def test_a_name_plays_no_tricks_with_the_terminal(here, capsys):
    folder = here / "a\x1b[2J"
    folder.mkdir()
    manifests.finish(folder, {}, files=[])
    assert main(["verify", folder.name]) == 0
    assert main(["verify", f"{folder.name}b"]) == main(["train", f"-{folder.name}"]) - 1 == 1
    said = capsys.readouterr()
    assert said.out == "a\\x1b[2J: whole, 0 files\n" and "\x1b" not in said.err


def test_a_traceback_is_shown_on_request(capsys):
    assert main(["generate", "plan.step=0", "--traceback"]) == 1
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert "in __post_init__" in err
    assert err.splitlines()[-1].startswith("error: plan.step=0")


# ---------------------------------------------------------------- work


def test_a_set_is_made_once_verified_and_mended(here, capsys):
    assert main(["generate", *SMALL, ALONE]) == 0
    made = only_set(here)
    before = content(made)
    times = [path.stat().st_mtime_ns for path in sorted(made.iterdir())]
    assert main(["generate", *SMALL, ALONE]) == 0
    assert [path.stat().st_mtime_ns for path in sorted(made.iterdir())] == times
    assert main(["verify", f"{made}"]) == 0
    assert capsys.readouterr().out.endswith(f"{made}: whole, 3 files\n")

    shard = made / "shard-00001.npy"
    shard.write_bytes(shard.read_bytes()[:-1] + b"\0")
    assert main(["verify", f"{made}"]) == 1
    said = "shard-00001.npy: damaged, its SHA-256 differs; run again: echolearn generate"
    assert said in capsys.readouterr().err
    assert main(["generate", *SMALL, ALONE]) == 0
    assert content(made) == before


@pytest.mark.parametrize(
    ("words", "lost", "there"),
    [
        ([], "poses.csv", "."),
        (["name=007"], "simulated.json", "elsewhere"),
        (["name='it\\'s (1)'", "runs='a, b'"], "observations/0001.wav", "elsewhere"),
    ],
)
def test_the_advice_against_damage_makes_the_same_again(words, lost, there, capsys, monkeypatch):
    """From whatever folder, and whatever `runs` is called."""
    usual = "room.size=[5,4.5,3] room.t60=0.25 poses=3 scene.probe.length=6000 snr_db=10".split()
    assert main(["survey", *usual, *words]) == 0
    made = Path(capsys.readouterr().out.strip()).resolve()
    before = content(made)
    (made / lost).unlink()
    Path(there).mkdir(exist_ok=True)
    monkeypatch.chdir(there)
    assert main(["verify", f"{made}"]) == 1
    advice = shlex.split(capsys.readouterr().err.strip().partition("run again: ")[2])
    assert advice[:2] == ["echolearn", "survey"]
    assert main(advice[1:]) == 0
    assert content(made) == before
    assert list(Path().iterdir()) == ([] if there != "." else [Path("runs")])


def test_an_interrupted_set_is_continued_to_the_same_bytes(here):
    # It takes longer than noticing its first shard.
    words = ["generate", *SMALL, "plan.step=2", "workers=1"]
    assert main([*words, ALONE]) == 0
    whole = content(only_set(here))
    shutil.rmtree("runs")
    with started(*words) as process:
        while process.poll() is None and not list(here.glob("runs/data/*/shard-*.json")):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=600)[1]
    assert process.returncode == 130
    hint = "the same command continues with what is finished"
    assert errors(err) == [f"error: interrupted; {hint}"]
    assert not (only_set(here) / manifests.MANIFEST).exists()
    assert main(words) == 0
    assert content(only_set(here)) == whole


def test_several_sweeps_share_what_stands_before_them(capsys):
    line = "train -m --cfg test_share=0.3 -- classifier=svm_toa seed=0,1 -- seed=2 folds=5"
    assert main(line.split()) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("command: ")] == [
        "command: echolearn train test_share=0.3 classifier=svm_toa seed=0",
        "command: echolearn train test_share=0.3 classifier=svm_toa seed=1",
        "command: echolearn train test_share=0.3 seed=2 folds=5",
    ]


def test_a_sweep_goes_on_after_a_failure_and_leaves_the_same_wherever_its_jobs_run(here, capsys):
    """One after another, then shared out by joblib."""
    words = ["generate", "-m", *SMALL, ALONE, "plan.step=0,4.0,-1"]
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert out == f"{only_set(here).relative_to(here)}\n"
    first, second, last = errors(err)
    assert first.startswith("error: plan.step=0 m: must be a number")
    assert second.startswith("error: plan.step=-1 m: must be a number")
    assert last == "error: 2 of 3 jobs failed: plan.step=0; plan.step=-1"
    made = content(only_set(here))
    shutil.rmtree("runs")
    with started(*words, "hydra/launcher=joblib", "hydra.launcher.n_jobs=2") as process:
        said = process.communicate(timeout=600)
    assert (process.returncode, said[0], errors(said[1])) == (1, out, [first, second, last])
    assert content(only_set(here)) == made


def test_a_finished_run_is_found_without_loading_what_trains(here, capsys):
    assert main(["generate", *LEARN, ALONE]) == 0
    words = ["train", *LEARN, "classifier=threshold_peak"]
    assert main(words) == 0
    path, modules = loaded(*words)
    assert capsys.readouterr().out.splitlines()[-1] == path
    assert (here / path / "metrics.json").is_file()
    assert not modules & {"torch", "sklearn", "lightning", "onnxruntime", "matplotlib"}


def test_commands_work_from_any_folder_without_leaving_anything_there(here):
    assert main(["generate", *SMALL, ALONE, f"runs={here / 'deep' / 'runs'}"]) == 0
    assert [path.name for path in here.iterdir()] == ["deep"]
    assert not (folder() / "runs").exists()
    assert os.listdir(here / "deep" / "runs") == ["data"]


@pytest.mark.parametrize("words", [["--version"], ["generate", "--cfg"]])
def test_output_that_nobody_reads_is_no_success(words):
    process = started(*words)
    process.stdout.close()
    assert process.wait(60) == 141
    assert process.stderr.read() == ""
    process.stderr.close()


def test_columns_are_left_out_of_a_classifiers_configuration():
    given = {"_target_": "x", "inputs": ["score", "joint", "toa"]}
    assert without_inputs(given, []) == given
    assert without_inputs(given, ["joint"]) == given | {"inputs": ["score", "toa"]}
    for columns, message in (
        (["power"], r"^without=\['power'\]: must be some of score, joint, toa"),
        (["toa", "joint", "score"], "must leave one at least of score"),
    ):
        with pytest.raises(BadValue, match=message):
            without_inputs(given, columns)


def test_a_plan_is_composed_again_for_a_set_that_was_made_here(tmp_path, monkeypatch):
    """Not for one whose command a stranger may have written, nor one of another plan."""

    class Made:
        def __init__(self, command, name):
            self.manifest = {"command": command, "sha256": "0" * 64}
            self.folder = tmp_path / name

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    command = "echolearn generate plan=tiny plan.seed=3"
    config = dict(compose("generate", ["plan=tiny", "plan.seed=3"]))[""]
    name = folder_of(build(config["plan"], "plan"), tmp_path).name
    assert _plan_of(Made(command, name)) is None
    known.remember("0" * 64, known.MADE)
    assert _plan_of(Made(command, name)).seed == 3
    assert _plan_of(Made("echolearn generate plan=tiny", name)) is None
    assert _plan_of(Made("echolearn generate plan=nowhere", name)) is None
