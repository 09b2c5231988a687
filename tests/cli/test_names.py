"""Multiruns: each job has a folder of its own, named after what the sweep varies; or none runs."""

import shlex
from pathlib import Path

import pytest

from echolearn.cli.commands import COMMANDS
from echolearn.cli.config import UsageError
from echolearn.cli.main import composed, main, parse
from echolearn.cli.names import chosen_runs
from echolearn.storage.advice import PLACES
from echolearn.training.variants import variant_text


def named(line):
    """Return the names of the jobs of a command line."""
    command, *words = shlex.split(line)
    options, _, sweeps = parse(words)
    jobs = composed(command, sweeps, options=options)
    for swept, config in jobs:
        # The command of a job alone makes the same folder, in one run.
        program, name, *alone = shlex.split(config["command"])
        assert program == "echolearn"
        [(_, again)] = composed(name, [alone], options=parse([])[0])
        assert again["name"] == config["name"], swept
    return [config["name"] for _, config in jobs]


APART = """
map -m survey=w bundle=b resolution=0.02,0.1 | w-b-resolution_0.02 w-b-resolution_0.1
map -m survey=mon/w,tue/w bundle=b | w-b-survey_mon-w w-b-survey_tue-w
map -m survey=mon/w,tue/v bundle=b | None None
map -m survey=mon/w,tue/w,v bundle=b | w-b-survey_mon-w w-b-survey_tue-w None
map -m survey=w,v bundle=b direct=fitted,null | \
    w-b-direct_fitted w-b-direct_null v-b-direct_fitted v-b-direct_null
map -m survey=w bundle=b -- resolution=0.02 -- ros=true | w-b-resolution_0.02 w-b-ros_true
map -m survey=w bundle=b name=x,007 | x 007
map -m survey=w bundle=b runs=a,b | None None
map -m "survey='room (1)','room (2)'" bundle=b | None None
map -m "survey='w (1)'" bundle=b resample=true,false | \
    w-(1)-b-resample_true w-(1)-b-resample_false
check -m survey=mon/w,tue/w,v | w-survey_mon-w w-survey_tue-w None
check -m survey=w direct=fitted,analytic | w-direct_fitted w-direct_analytic
survey -m seed=0,1 | 8x6x5_0dB-seed_0 8x6x5_0dB-seed_1
survey -m snr_db=0,-5 room=8x6x5,13x11x5 | 8x6x5_0dB 13x11x5_0dB 8x6x5_-5dB 13x11x5_-5dB
survey -m snr_db=0,-5 room.t60=0.5,0.25 | \
    8x6x5_0dB-t60_0.5 8x6x5_0dB-t60_0.25 8x6x5_-5dB-t60_0.5 8x6x5_-5dB-t60_0.25
survey -m seed=0,1 "name='w-${seed}'" | w-0 w-1
train -m seed=0,1 | svm_pair svm_pair
study -m experiment=rotor,attainable | rotor attainable_8x6x5
"""


@pytest.mark.parametrize("row", APART.replace("\\\n", "").strip().splitlines())
def test_jobs_are_named_after_what_the_sweep_varies(row):
    line, names = row.split(" | ")
    found = [f"{name}".replace(" ", "-") for name in named(line)]
    assert found == names.split()


VARIED = """
train -m seed=0,1 | - -
train -m classifier=svm_pair classifier.c_grid=[1],[10] | c1 c10
train -m classifier=svm_pair classifier.c_grid=[1],[10] seed=0,1 | c1 c1 c10 c10
train -m classifier=svm_pair,mlp_pair aim=balanced | - -
train -m classifier=mlp_pair classifier.net.widths=[32,32],[64] classifier.lr=0.01 | \
    widths32_32 widths64
train -m classifier=mlp_pair -- classifier.lr=0.01 -- seed=1 | lr0.01 -
train -m aim=balanced,"precision 0.8" | aim_balanced aim_precision_0.8
"""


@pytest.mark.parametrize("row", VARIED.replace("\\\n", "").strip().splitlines())
def test_trainings_tell_what_a_sweep_varies_of_the_model(row):
    line, expected = row.split(" | ")
    options, _, sweeps = parse(shlex.split(line)[1:])
    jobs = composed("train", sweeps, options=options)
    assert [variant_text(job["varied"]) or "-" for _, job in jobs] == expected.split()


CHOSEN = [
    ("runs", ("runs", [])),
    ("trees_*,mlp_*", ("runs", ["trees_*", "mlp_*"])),
    ("a,b", ("runs", ["a", "b"])),
    ("else/trees_*", ("else", ["trees_*"])),
    ("else/train/trees_*,else/x", ("else", ["trees_*", "x"])),
]


@pytest.mark.parametrize(("typed", "expected"), CHOSEN)
def test_runs_of_a_comparison_are_a_folder_or_names_in_it(typed, expected):
    """As they are typed, without -m and without quotes of Hydra's."""
    options, _, sweeps = parse([f"runs={typed}", "select=best"])
    [(_, job)] = composed("compare", sweeps, options=options)
    place, names = chosen_runs(job["runs"])
    assert (str(place), names) == expected


def test_a_run_may_be_named_without_a_pattern_and_by_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = tmp_path / "runs" / "train" / "svm_pair-few-s0-0123456789ab"
    run.mkdir(parents=True)
    (run / "metrics.json").touch()
    (tmp_path / "mine").mkdir()
    for typed in (run.name, "svm_pair", "svm_pair-few", f"runs/train/{run.name}", f"{run}/"):
        place, [name] = chosen_runs(typed)
        assert (run.parents[1] / "train" / run.name).match(f"{place}/train/{name}*")
    assert chosen_runs("mine") == (Path("mine"), [])


def test_names_of_runs_in_several_folders_are_refused():
    with pytest.raises(UsageError, match=r"^runs=a/x,b/y: must be names of runs in one folder"):
        chosen_runs("a/x,b/y")


def test_names_that_would_be_too_long_end_in_a_digest():
    names = named(f"map -m survey=w bundle=b direct={'a' * 120},{'b' * 120}")
    assert len({*names}) == 2 and all(len(name) == len("w-b-0123456789ab") for name in names)


TOGETHER = """
map -m survey=w bundle=b runs=./a,a/ name=x | both would write | a/maps/x
map -m survey=w bundle=b name=x resolution=0.1,0.2 | resolution=0.1 and resolution=0.2: both | \
    runs/maps/x; leave name= out
map -m survey=w,w bundle=b | survey=w: both would write | runs/maps/w-b; do they differ but in how
map -m survey=w,w/ bundle=b | survey=w and survey=w/: both | w-b-survey_w; do they differ but in how
map -m bundle=b -- survey=w -- survey=w | two of them: both would write | runs/maps/w-b; do they
survey -m seed=0,1 name=x | seed=0 and seed=1: both would write | runs/survey/x; leave name= out
compare -m resamples=20,30 | resamples=20 and resamples=30: both would write | \
    runs/compare/paper; give each a name, as by 'name='"'"'paper-${resamples}'"'"''
export -m run=r resamples=20,30 | both would write | runs/bundles/r; give each a name, as by
study -m resamples=20,30 | both would write | ; give each a name
bench -m rows=10,20 | both would write | runs/bench; run echolearn bench once for each
"""


def test_every_command_has_a_place_for_its_folders():
    assert {*PLACES} == {*COMMANDS}


@pytest.mark.parametrize("row", TOGETHER.replace("\\\n", "").strip().splitlines())
def test_two_jobs_of_one_folder_are_refused_before_the_first(row, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    line, *said = [part.strip() for part in row.split(" | ")]
    assert main(shlex.split(line)) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    for part in said:
        assert part in told
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError):
        named(line)
