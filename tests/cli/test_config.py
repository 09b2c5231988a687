"""From YAML and overrides to plain containers, and from these to objects."""

import shlex
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue, suggest
from echolearn.cli.compose import compose, dotted
from echolearn.cli.config import UsageError, build
from echolearn.cli.own import folder
from echolearn.cli.set_robot import scene_of
from echolearn.cli.targets import KINDS
from echolearn.cli.words import plain_config
from echolearn.storage import identity
from echolearn.storage.advice import assignment

ROOM = {"_target_": "echolearn.acoustics.types.Room", "size": [5.0, 4.0, 3.0], "t60": 0.4}


def one(command, *words):
    """Return the configuration of a command's only job."""
    [(name, config)] = compose(command, words)
    assert name == ""
    return config


# ---------------------------------------------------------------- build


def test_a_configuration_is_a_call_written_down():
    assert build(ROOM, "room") == Room((5.0, 4.0, 3.0), 0.4)


def test_calls_inside_lists_and_mappings_are_made_and_all_else_stays():
    plain = {"room": [ROOM, 1], "b": {"room": ROOM}, "d": None}
    room = Room((5.0, 4.0, 3.0), 0.4)
    assert build(plain, "plan") == {"room": [room, 1], "b": {"room": room}, "d": None}


NOWHERE = """
echolearn echolearnx.types.Room echolearn.storage.manifests.os.system nowhere.at.all .Room
echolearn.acoustics.types.SPEED_OF_SOUND echolearn.acoustics.types.NoSuchThing
echolearn.nowhere.Room
"""


@pytest.mark.parametrize("target", [*NOWHERE.split(), "", None, 3])
def test_what_cannot_be_imported_is_refused(target):
    said = r"^room\._target_=.*: must be the dotted name of a class or a function"
    with pytest.raises(BadValue, match=said):
        build({"_target_": target}, "room")


MENACING = """
os.system os.abort builtins.eval builtins.exec builtins.open subprocess.run subprocess.Popen
subprocess.check_output shutil.rmtree pathlib.Path torch.load sys.exit
echolearn.storage.files.save_json echolearn.storage.files.write_atomic
echolearn.dataset.generate.generate echolearn.cli.main.main echolearn.robot.bundle.read_bundle
"""


@pytest.mark.parametrize("target", MENACING.split())
def test_what_is_not_of_its_places_kind_is_refused_before_it_is_called(target):
    for place in (*KINDS, "localizers.mine", "scene.diffuse"):
        said = rf"^{place}\._target_={target}: must be a class like (echolearn|sklearn|lightning)\."
        with pytest.raises(BadValue, match=said):
            build({"_target_": target, "path": "x", "plain": {}}, place)


def test_a_call_stands_where_there_is_a_kind_for_it():
    with pytest.raises(BadValue, match="^seed=_target_: must not be here"):
        build({"seed": ROOM}["seed"], "seed")


ABROAD = """
from dataclasses import dataclass
from echolearn.acoustics.types import Room

@dataclass(frozen=True)
class Hiss:
    level: float = 1.0
    def __call__(self, array, *, length, sample_rate, rng):
        return self.level * rng.normal(size=(len(array), length))

class Deaf:
    def __call__(self, array):
        raise RuntimeError

def hall(side: float) -> Room:
    return Room((side, side, 3.0), 0.4)

def liar(side: float) -> Room:
    return side

def silent(side: float):
    raise RuntimeError
"""


@pytest.fixture
def abroad(tmp_path, monkeypatch):
    """Let a package of somebody else's be importable."""
    (tmp_path / "abroad.py").write_text(ABROAD)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("abroad")
def test_classes_and_functions_of_anybody_can_be_called():
    assert build({"_target_": "abroad.hall", "side": 5.0}, "room") == Room((5.0, 5.0, 3.0), 0.4)
    words = ["noise._target_=abroad.Hiss", "noise.level=2.0"]
    plan = build(one("generate", "plan=tiny", *words)["plan"], "plan")
    assert plan.scene.noise.level == 2.0
    assert identity.plain(plan)["scene"]["noise"] == {"kind": "abroad.Hiss", "level": 2.0}


@pytest.mark.usefixtures("abroad")
@pytest.mark.parametrize(
    ("place", "leaf"), [("noise", "Deaf"), ("room", "liar"), ("room", "silent"), ("room", "Hiss")]
)
def test_what_only_seems_to_be_of_a_kind_is_refused(place, leaf):
    arguments = {"side": 5.0} if place == "room" and leaf != "Hiss" else {}
    with pytest.raises(BadValue, match=rf"^{place}\._target_=abroad.{leaf}: must be a class like"):
        build({"_target_": f"abroad.{leaf}", **arguments}, place)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"t6": 1}, r"^plan\.room\.t6=1: there is no such key; did you mean t60\?$"),
        ({"t60": 0.01}, "Sabine"),
    ],
)
def test_errors_name_the_key_or_are_those_of_the_called(change, said):
    with pytest.raises(BadValue, match=said):
        build({"room": ROOM | change}, "plan")


def test_a_missing_key_is_named():
    with pytest.raises(BadValue, match=r"^room\.t60: is missing"):
        build({key: value for key, value in ROOM.items() if key != "t60"}, "room")


# ---------------------------------------------------------------- compose


def test_values_lists_and_options_are_set():
    words = "plan=tiny plan.seed=7 plan.room.size=[4,5,6] localizer=snls workers=1"
    config = one("generate", *words.split())
    plan = config["plan"]
    assert (plan["name"], plan["seed"], plan["room"]["size"]) == ("tiny", 7, [4, 5, 6])
    assert plan["localizer"]["_target_"] == "echolearn.localization.methods.snls.Snls"
    assert (config["workers"], config["choice"]["plan"]) == (1, "tiny")


def test_each_job_knows_the_command_line_that_makes_it_alone():
    words = ["plan=tiny,paper", "plan.room.size=[4,5,6]", "workers=1"]
    jobs = compose("generate", words, many=True)
    assert [shlex.split(config["command"]) for _, config in jobs] == [
        ["echolearn", "generate", f"plan={plan}", *words[1:]] for plan in ("tiny", "paper")
    ]
    assert "'plan.room.size=[4,5,6]'" in jobs[0][1]["command"]


def test_interpolations_follow_what_was_set():
    config = one("generate", "plan.window.nearest=0.7", "scene.speed_of_sound=340.0")
    assert config["window"] == config["plan"]["window"] == config["plan"]["localizer"]["window"]
    assert build(config["window"], "window") == SearchWindow(0.7, 2.0, "authors")
    assert config["plan"]["scene"]["speed_of_sound"] == 340.0


def test_the_later_of_two_values_holds():
    assert one("train", "seed=1", "seed=2")["seed"] == 2


def test_a_key_that_the_file_leaves_to_its_default_can_be_set():
    assert one("survey", "room.walls=[1,1,1,1,0,0]")["room"]["walls"] == [1, 1, 1, 1, 0, 0]


def test_a_sweep_gives_every_combination_and_says_what_is_swept():
    words = "classifier=svm_pair,svm_toa seed=0,1,2 test_share=0.3"
    expected = [
        f"classifier={name} seed={seed}" for name in ("svm_pair", "svm_toa") for seed in range(3)
    ]
    jobs = compose("train", words.split(), many=True)
    assert [name for name, _ in jobs] == expected
    for name, config in jobs:
        assert f"classifier={config['choice']['classifier']} seed={config['seed']}" == name
        assert config["name"] == config["choice"]["classifier"]
        assert config["test_share"] == 0.3


def test_jobs_of_a_sweep_share_nothing():
    first, second = (
        config for _, config in compose("generate", ["plan.room.t60=0.5,0.7"], many=True)
    )
    assert (first["plan"]["room"]["t60"], second["plan"]["room"]["t60"]) == (0.5, 0.7)


def test_a_pattern_sweeps_over_all_options():
    jobs = compose("generate", ["plan=glob(offgrid*)"], many=True)
    expected = sorted(path.stem for path in (folder() / "plan").glob("offgrid*.yaml"))
    assert [config["choice"]["plan"] for _, config in jobs] == expected


def test_unresolved_configurations_show_where_values_come_from():
    [(_, config)] = compose("generate", [], resolve=False)
    assert config["plan"]["scene"] == "${scene}"


# ---------------------------------------------------------------- helpers


def test_dotted_names_reach_everything():
    found = dotted({"a": {"b": [1, {"c": 2}]}, "d": 3})
    assert " ".join(found) == "a a.b a.b.0 a.b.1 a.b.1.c d"


def test_suggestions_look_at_the_whole_name_then_at_its_last_part():
    assert suggest("plan.stp", ["plan.step", "plan.seed"]) == "did you mean plan.step?"
    assert suggest("stpe", ["plan.step", "runs"]) == "did you mean plan.step?"
    assert suggest("qqq", ["plan", "plan.step", "runs"]) == "known are plan, runs"
    assert suggest("order", []) == "it has none"


def test_the_folder_of_configurations_is_absolute():
    assert folder().is_absolute()
    assert (Path(folder()) / "train.yaml").is_file()


def test_diffuse_noise_can_be_left_out_and_a_level_set_to_null():
    config = one("generate", "plan=scattered_rotor", "diffuse=null", "plan.sdnr_db=null")
    assert config["scene"]["diffuse"] is None
    assert config["plan"]["sdnr_db"] is None


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("study experiment=paper_snr", "em"),
        ("study experiment=rotor", "joint_spatial"),
        ("study experiment=attainable", "joint"),
        ("compare", "snls"),
    ],
)
def test_a_localizer_is_left_out_as_the_refusals_advise(words, name):
    command = words.split()
    key = f"localizers.{name}"
    expected = one(*command)["localizers"]
    del expected[name]
    for slip, said in (
        (f"~{key}", f"keys are set, {key}=value, not deleted"),
        (f"{key}=null", f"{key} cannot be null"),
    ):
        with pytest.raises(UsageError) as refused:
            one(*command, slip)
        assert str(refused.value).startswith(f"{slip}: {said}; leave it out by ")
        advised = str(refused.value).rpartition(" ")[2]
        config = one(*command, advised)
        assert config["localizers"] == expected
        assert advised in config["command"]


def test_all_localizers_can_be_left_out():
    names = one("compare")["localizers"]
    config = one("compare", *[f"localizer@localizers.{name}=null" for name in names])
    assert not config["localizers"]


# ---------------------------------------------------------------- names, and a robot without Hydra


def without_hydra(command, *words):
    return plain_config(command, words)


BOTH = pytest.mark.parametrize("read", [one, without_hydra])


@BOTH
@pytest.mark.parametrize(
    "text", ["2024_01_15", "007", "1e3", "-5", "1.50", "true", "nan", "a b", ""]
)
def test_a_name_is_what_was_typed(read, text):
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
def test_other_values_are_typed_by_their_default(read, word, value):
    found = read("map", word)[word.partition("=")[0]]
    assert (found, type(found)) == (value, type(value))


UNREADABLE = """
map runs=null | runs=null: runs cannot be null
map resampel=1 | resampel=1: there is no key resampel; did you mean resample?
map survey | survey: cannot be read; it is no key=value; are quotes around blanks missing?
map resolution=wide | resolution=wide: must be a number
map resolution=[1] | resolution=[1]: must be a number
map ros=1 | ros=1: must be true or false
train | train: needs more than a robot has; pip install 'echolearn[lab]'
"""


@pytest.mark.parametrize("row", UNREADABLE.strip().splitlines())
def test_slips_are_refused_without_hydra_too(row):
    words, said = row.split(" | ")
    with pytest.raises(UsageError) as refused:
        without_hydra(*words.split())
    assert str(refused.value) == said


def test_swept_names_are_what_was_typed_and_so_are_names_of_plans():
    jobs = compose("generate", ["plan.name=2024_01_15,007, 1e3", "plan.seed=1,2"], many=True)
    assert [config["plan"]["name"] for _, config in jobs[::2]] == ["2024_01_15", "007", "1e3"]
    assert jobs[2][0] == "plan.name=007 plan.seed=1"
    assert jobs[2][1]["command"] == "echolearn generate plan.name=007 plan.seed=1"


NAMES = """
s/küche|s/x'y|s/a=b|s/(a)|~/x|a;b|a#b|room (1)|room(1)|room[1]|[room]|{a}|(a)|glob(x)|range(3)|a,b
a, b|x {1}|a"b|it's|a\\'b|a\\|a$b|a`b|!a|a & b|日本 😀|a:b|50%|a*|a?|ä=(1), [2]|null|NULL
a${b}|${a}|<a>
"""


def advised(path):
    """Return how a path is to be written, by the refusal if it is refused as it stands."""
    try:
        if "${" not in path:  # which is another key's value
            assert one("map", f"survey={path}")["survey"] in (path, None)
        return assignment("survey", path)
    except (UsageError, BadValue) as refused:
        said, _, advice = str(refused).partition("quote it twice: ")
        assert said.startswith(f"survey={path}: ")
        [word] = shlex.split(advice)
        return word


@pytest.mark.parametrize("path", NAMES.strip().replace("\n", "|").split("|"))
def test_what_hydra_reads_otherwise_is_quoted_twice(path):
    """And what it takes may be quoted, too; a robot without it reads both."""
    word = advised(path)
    assert one("map", word)["survey"] == path
    [(_, swept)] = compose("map", [word], many=True)
    assert swept["survey"] == path
    assert without_hydra("map", word)["survey"] == path
    if path.lower() != "null":
        assert without_hydra("map", f"survey={path}")["survey"] == path


@given(st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1))
@settings(max_examples=50)
def test_any_name_that_is_quoted_is_read_as_it_is(name):
    word = assignment("name", name)
    assert one("map", word)["name"] == without_hydra("map", word)["name"] == name


def test_names_in_lists_and_among_quoted_ones_are_what_was_typed():
    found = one("compare", "surveys=[2024_01_15, 007,'a, (b)',1e3,null]", "tested=[1_000]")
    assert found["surveys"] == ["2024_01_15", "007", "a, (b)", "1e3", "null"]
    assert one("compare", "surveys=[]")["surveys"] == []
    assert found["tested"] == ["1_000"]
    swept = compose("map", ["survey='a (1)',007,'b, c'"], many=True)
    assert [config["survey"] for _, config in swept] == ["a (1)", "007", "b, c"]


@pytest.mark.parametrize(
    ("command", "microphones"),
    [
        ("generate plan=tiny scene=octahedron", "octahedron"),
        ("generate plan=tiny --config-dir=gone", "ring"),
        # What cannot be told is the command's own: a survey that is gone, a plan that never was.
        ("label survey=gone/walk", None),
        ("generate plan=gone", None),
    ],
)
def test_the_robot_of_a_set_is_that_of_the_command_that_made_it(command, microphones):
    usual = {"array": None}
    found = scene_of(f"echolearn {command}", usual)
    if microphones is None:
        assert found is usual
    else:
        [(_, there)] = compose("generate", [f"scene={microphones}"])
        assert found["array"] == there["scene"]["array"]
