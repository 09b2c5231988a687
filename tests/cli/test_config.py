"""From YAML and overrides to plain containers, and from these to objects."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue, suggest
from echolearn.cli.compose import compose, dotted
from echolearn.cli.config import UsageError, build, folder
from echolearn.cli.words import plain_config

ROOM = {"_target_": "echolearn.acoustics.types.Room", "size": [5.0, 4.0, 3.0], "t60": 0.4}


def one(command: str, *words: str) -> dict[str, Any]:
    """Return the configuration of a command's only job."""
    [(name, config)] = compose(command, words)
    assert name == ""
    return config


# ---------------------------------------------------------------- build


def test_a_configuration_is_a_call_written_down() -> None:
    assert build(ROOM) == Room((5.0, 4.0, 3.0), 0.4)


def test_calls_inside_lists_and_mappings_are_made_and_all_else_stays() -> None:
    plain = {"a": [ROOM, 1], "b": {"c": ROOM}, "d": None}
    assert build(plain) == {"a": [build(ROOM), 1], "b": {"c": build(ROOM)}, "d": None}


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "builtins.eval",
        "subprocess.run",
        "pathlib.Path",
        "torch.load",
        "echolearn",
        "echolearnx.types.Room",
        "echolearn.storage.manifests.os.system",
        "echolearn.storage.manifests.Path",
        "echolearn.cli.config.import_module",
        "echolearn.acoustics.types.SPEED_OF_SOUND",
        "echolearn.acoustics.types.NoSuchThing",
        "echolearn.nowhere.Room",
        "",
        None,
        3,
    ],
)
def test_nothing_else_can_be_called(target: object) -> None:
    with pytest.raises(BadValue, match="_target_"):
        build({"_target_": target})


def test_an_unknown_key_is_named_with_the_one_that_was_meant() -> None:
    with pytest.raises(
        BadValue, match=r"^plan\.room\.t6=1: there is no such key; did you mean t60\?$"
    ):
        build({"room": {**ROOM, "t6": 1}}, "plan")


def test_a_missing_key_is_named() -> None:
    with pytest.raises(BadValue, match=r"^room\.t60: is missing"):
        build({"_target_": "echolearn.acoustics.types.Room", "size": [1, 1, 1]}, "room")


def test_errors_of_the_called_come_through_as_they_are() -> None:
    with pytest.raises(BadValue, match="Sabine"):
        build({**ROOM, "t60": 0.01})


# ---------------------------------------------------------------- compose


def test_values_lists_and_options_are_set() -> None:
    config = one(
        "generate",
        "plan=tiny",
        "plan.seed=7",
        "plan.room.size=[4,5,6]",
        "localizer=snls",
        "workers=1",
    )
    assert config["plan"]["name"] == "tiny"
    assert config["plan"]["seed"] == 7
    assert config["plan"]["room"]["size"] == [4, 5, 6]
    assert config["plan"]["localizer"]["_target_"] == "echolearn.localization.methods.snls.Snls"
    assert config["workers"] == 1
    assert config["choice"]["plan"] == "tiny"


def test_each_job_knows_the_command_line_that_makes_it_alone() -> None:
    words = ["plan=tiny,paper", "plan.room.size=[4,5,6]", "workers=1"]
    jobs = compose("generate", words, many=True)
    assert [shlex.split(config["command"]) for _, config in jobs] == [
        ["echolearn", "generate", f"plan={plan}", *words[1:]] for plan in ("tiny", "paper")
    ]
    assert "'plan.room.size=[4,5,6]'" in jobs[0][1]["command"]


def test_interpolations_follow_what_was_set() -> None:
    config = one("generate", "plan.window.nearest=0.7", "scene.speed_of_sound=340.0")
    assert config["window"] == config["plan"]["window"] == config["plan"]["localizer"]["window"]
    assert build(config["window"]) == SearchWindow(0.7, 2.0, "authors")
    assert config["plan"]["scene"]["speed_of_sound"] == 340.0


def test_the_later_of_two_values_holds() -> None:
    assert one("train", "seed=1", "seed=2")["seed"] == 2


def test_a_key_that_the_file_leaves_to_its_default_can_be_set() -> None:
    assert one("survey", "room.walls=[1,1,1,1,0,0]")["room"]["walls"] == [1, 1, 1, 1, 0, 0]


def test_a_sweep_gives_every_combination_and_says_what_is_swept() -> None:
    jobs = compose(
        "train", ["classifier=svm_pair,svm_toa", "seed=0,1,2", "test_share=0.3"], many=True
    )
    assert len(jobs) == 6
    assert [name for name, _ in jobs][:2] == [
        "classifier=svm_pair seed=0",
        "classifier=svm_pair seed=1",
    ]
    assert [(c["choice"]["classifier"], c["seed"]) for _, c in jobs][3:] == [
        ("svm_toa", n) for n in range(3)
    ]
    assert all(config["name"] == config["choice"]["classifier"] for _, config in jobs)
    assert all(config["test_share"] == 0.3 for _, config in jobs)


def test_jobs_of_a_sweep_share_nothing() -> None:
    first, second = (
        config for _, config in compose("generate", ["plan.room.t60=0.5,0.7"], many=True)
    )
    assert (first["plan"]["room"]["t60"], second["plan"]["room"]["t60"]) == (0.5, 0.7)


def test_a_pattern_sweeps_over_all_options() -> None:
    jobs = compose("generate", ["plan=glob(offgrid*)"], many=True)
    expected = sorted(path.stem for path in (folder() / "plan").glob("offgrid*.yaml"))
    assert [config["choice"]["plan"] for _, config in jobs] == expected


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (
            "plan=glob(zz*)",
            r"plan=glob\(zz\*\): matches nothing; known are offgrid_10x8x6, .*, tiny_scattered",
        ),
        ("seed=glob(*)", r"seed=glob\(\*\): matches nothing"),
        ("seed=range(0)", r"seed=range\(0\): matches nothing"),
    ],
)
def test_a_pattern_that_matches_nothing_is_refused(word: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"^{said}$"):
        compose("train", [word], many=True)


def test_unresolved_configurations_show_where_values_come_from() -> None:
    [(_, config)] = compose("generate", [], resolve=False)
    assert config["plan"]["scene"] == "${scene}"


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("plan.room.size.x=1", "there is no key plan.room.size.x"),
        ("plann=paper", "there is no key plann; did you mean plan?"),
        ("stepp=1", "there is no key stepp; did you mean plan.step?"),
        ("plan=papr", "plan has no option papr; did you mean paper?"),
        ("plan=zzz", "known are .*tiny"),
        ("+new=1", "there is no key new"),
        ("++new=1", "there is no key new"),
        ("~runs", "keys are set, runs=value, not deleted$"),
        ("~plan.sdnr_db", "keys are set, plan.sdnr_db=value, not deleted$"),
        ("~nothing", "there is no key nothing"),
        ("runs=a,b", "several values need -m"),
        ("plan=[", "cannot be read; are quotes or brackets missing?"),
        ("runs", "runs: cannot be read; it is no key=value"),
        ("choice.plan=x", "there is no key choice.plan"),
        ("command=x", "there is no key command"),
        ("hydra.run.dir=x", "hydra's own settings are fixed"),
        ("hydra/sweeper=basic", "hydra's own settings are fixed"),
        ("runs=${nowhere}", "nowhere"),
        ("runs=???", "Missing mandatory value"),
    ],
)
def test_slips_are_refused(word: str, said: str) -> None:
    with pytest.raises(UsageError, match=said.replace("?", r"\?").replace("${", r"\${")):
        compose("generate", [word])


def test_a_slip_in_the_last_job_stops_them_all() -> None:
    with pytest.raises(UsageError, match="plan has no option papr"):
        compose("generate", ["plan=tiny,papr"], many=True)


# ---------------------------------------------------------------- helpers


def test_dotted_names_reach_everything() -> None:
    assert list(dotted({"a": {"b": [1, {"c": 2}]}, "d": 3})) == [
        "a",
        "a.b",
        "a.b.0",
        "a.b.1",
        "a.b.1.c",
        "d",
    ]


def test_suggestions_look_at_the_whole_name_then_at_its_last_part() -> None:
    assert suggest("plan.stp", ["plan.step", "plan.seed"]) == "did you mean plan.step?"
    assert suggest("stpe", ["plan.step", "runs"]) == "did you mean plan.step?"
    assert suggest("qqq", ["plan", "plan.step", "runs"]) == "known are plan, runs"
    assert suggest("order", []) == "it has none"


def test_the_folder_of_configurations_is_absolute() -> None:
    assert folder().is_absolute()
    assert (Path(folder()) / "train.yaml").is_file()


@pytest.mark.parametrize(
    ("command", "word", "message"),
    [
        ("generate", "plan.room=null", "plan.room=null: plan.room cannot be null"),
        ("generate", "window=null", "window cannot be null"),
        ("generate", "runs=null", "runs cannot be null"),
        ("generate", "plan=null", "plan=null: plan cannot be left out; it must be one of"),
    ],
)
def test_what_must_be_there_is_not_set_to_null(command: str, word: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        compose(command, [word])


def test_diffuse_noise_can_be_left_out_and_a_level_set_to_null() -> None:
    [(_, config)] = compose(
        "generate", ["plan=scattered_rotor", "diffuse=null", "plan.sdnr_db=null"]
    )
    assert config["scene"]["diffuse"] is None
    assert config["plan"]["sdnr_db"] is None


@pytest.mark.parametrize(
    ("command", "key", "experiment"),
    [
        ("study", "localizers.em", "paper_snr"),
        ("study", "localizers.joint_spatial", "rotor"),
        ("study", "localizers.joint", "attainable"),
        ("compare", "localizers.snls", None),
    ],
)
def test_a_localizer_is_left_out_as_the_refusals_advise(
    command: str, key: str, experiment: str | None
) -> None:
    words, name = [f"experiment={experiment}"] if experiment else [], key.partition(".")[2]
    for slip, said in (
        (f"~{key}", f"keys are set, {key}=value, not deleted"),
        (f"{key}=null", f"{key} cannot be null"),
    ):
        with pytest.raises(UsageError) as refused:
            compose(command, [*words, slip])
        assert str(refused.value).startswith(f"{slip}: {said}; leave it out by ")
        advised = str(refused.value).rpartition(" ")[2]
        (_, before), (_, after) = *compose(command, words), *compose(command, [*words, advised])
        assert after["localizers"] == {
            other: value for other, value in before["localizers"].items() if other != name
        }
        assert advised in after["command"]


def test_all_localizers_can_be_left_out_but_no_plan() -> None:
    names = compose("compare", [])[0][1]["localizers"]
    [(_, config)] = compose("compare", [f"localizer@localizers.{name}=null" for name in names])
    assert not config["localizers"]
    with pytest.raises(
        UsageError,
        match="^plan@growing=null: plan@growing cannot be left out; it must be one of .*tiny",
    ):
        compose("bench", ["plan@growing=null"])


def test_a_call_without_keys_says_so() -> None:
    [(_, config)] = compose("survey", ["rir.order=3"])
    with pytest.raises(BadValue, match=r"^rir\.order=3: there is no such key; it has none$"):
        build(config["rir"], "rir")


# ---------------------------------------------------------------- names, and a robot without Hydra


def with_hydra(command: str, *words: str) -> dict[str, Any]:
    return one(command, *words)


def without_hydra(command: str, *words: str) -> dict[str, Any]:
    return plain_config(command, words)


BOTH = pytest.mark.parametrize("read", [with_hydra, without_hydra])
Read = Callable[..., dict[str, Any]]


@BOTH
@pytest.mark.parametrize(
    "text", ["2024_01_15", "007", "1e3", "-5", "1.50", "true", "nan", "a b", ""]
)
def test_a_name_is_what_was_typed(read: Read, text: str) -> None:
    found = read("map", *[f"{key}={text}" for key in ("survey", "bundle", "name", "runs")])
    assert {found[key] for key in ("survey", "bundle", "name", "runs")} == {text}


@BOTH
@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("resolution=5", 5),
        ("resolution=1e-1", 0.1),
        ("resolution=.5", 0.5),
        ("resolution=-1_000", -1000),
        ("resolution=inf", float("inf")),
        ("resample=TRUE", True),
        ("ros=false", False),
        ("direct=fitted", "fitted"),
        ("direct=null", None),
        ("name=null", None),
        ("name='null'", "null"),
        ("survey='(a), b'", "(a), b"),
        ('survey="007"', "007"),
    ],
)
def test_other_values_are_typed_by_their_default(read: Read, word: str, value: object) -> None:
    found = read("map", word)[word.partition("=")[0]]
    assert (found, type(found)) == (value, type(value))


@BOTH
@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("runs=null", "runs=null: runs cannot be null"),
        ("resampel=1", "resampel=1: there is no key resampel; did you mean resample"),
        ("survey", "survey: cannot be read; it is no key=value"),
    ],
)
def test_slips_are_the_same_with_hydra_and_without(read: Read, word: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"^{said}"):
        read("map", word)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("resolution=wide", "resolution=wide: must be a number"),
        ("resolution=[1]", r"resolution=\[1\]: must be a number"),
        ("ros=1", "ros=1: must be true or false"),
    ],
)
def test_a_value_of_another_type_is_refused_without_hydra(word: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"^{said}$"):
        plain_config("map", [word])


def test_without_hydra_only_commands_of_one_file_work() -> None:
    with pytest.raises(UsageError, match=r"^train: needs more than .*echolearn\[lab\]"):
        plain_config("train", [])


def test_swept_names_are_what_was_typed_and_so_are_names_of_plans() -> None:
    jobs = compose("generate", ["plan.name=2024_01_15,007, 1e3", "plan.seed=1,2"], many=True)
    assert [config["plan"]["name"] for _, config in jobs[::2]] == ["2024_01_15", "007", "1e3"]
    assert jobs[2][0] == "plan.name=007 plan.seed=1"
    assert jobs[2][1]["command"] == "echolearn generate plan.name=007 plan.seed=1"


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("runs=[a]", r"runs=\['a'\]: must be a path; quote it twice"),
        ("bundle={a:1}", r"bundle=\{'a': 1\}: must be a path"),
        ("name=[a]", r"name=\['a'\]: must be a name"),
    ],
)
def test_what_is_no_text_is_no_name(word: str, said: str) -> None:
    with pytest.raises(BadValue, match=f"^{said}"):
        compose("map", [word])


@pytest.mark.parametrize("path", ["s/küche", "s/x'y", "s/a=b", "s/(a)", "~/x", "a;b", "a#b"])
def test_paths_that_hydra_cannot_read_are_quoted_twice(path: str) -> None:
    with pytest.raises(UsageError) as refused:
        compose("map", [f"survey={path}"])
    said, _, advice = str(refused.value).partition("; quote it twice: ")
    assert said == f"survey={path}: cannot be read"
    assert one("map", *shlex.split(advice))["survey"] == path
    assert without_hydra("map", f"survey={path}")["survey"] == path


@pytest.mark.parametrize("word", ["survey=[a", "survey={a", 'survey=a"b', "'"])
def test_words_that_hydra_cannot_read_are_one_plain_line(word: str) -> None:
    said = r": cannot be read; (are quotes or brackets missing\?|it is no key=value)$"
    with pytest.raises(UsageError, match=said):
        compose("map", [word])
