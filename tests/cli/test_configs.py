"""Every YAML file: composed, built, and complete."""

import inspect
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.cli.own import folder
from echolearn.cli.targets import TARGET, imported
from echolearn.dataset.plans import ScatteredPlan
from echolearn.localization.columns import COLUMNS
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.survey import audio

COMMANDS = sorted(path.stem for path in folder().glob("*.yaml"))
FILES = sorted(path for path in folder().glob("*/*.yaml") if path.parent.name != "experiment")
PLANS = sorted(path.stem for path in (folder() / "plan").glob("*.yaml"))
USED_BY = {"room": "survey", "classifier": "train", "logger": "train", "source": "import"}
"""A command that has the group; `generate` has the others."""


HUM = Path(tempfile.mkdtemp()) / "hum.wav"
HUM.write_bytes(audio.wav_bytes(np.sin(np.arange(5000)), 22050.0))
ROOT = Path(__file__).parents[2]
NEEDED = {
    "scene=survey": [f"scene.folder={ROOT / 'examples' / 'survey' / 'short'}"],
    "diffuse=recorded": [f"diffuse.source.path={HUM}"],
    "scene=array": ["scene.array.positions=[[0.1,0,0],[0,0.1,0]]"],
}
"""What a file leaves to the user."""


def name(path):
    """Return a file's group and option."""
    return f"{path.parent.name}={path.stem}"


@cache
def composed(path):
    """Return what stands at a group when this file is chosen for it."""
    words = [name(path), *NEEDED.get(name(path), [])]
    [(_, config)] = compose(USED_BY.get(path.parent.name, "generate"), words)
    return config[path.parent.name]


def calls(config):
    """Return every call inside a configuration."""
    inner = (
        config.values() if isinstance(config, dict) else config if isinstance(config, list) else ()
    )
    own = [config] if isinstance(config, dict) and TARGET in config else []
    return own + [call for item in inner for call in calls(item)]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_composes_from_its_defaults(command):
    [(_, config)] = compose(command, [])
    assert config["runs"] == "runs"


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_begins_with_what_it_calls(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    package = "lightning" if path.parent.name == "logger" else "echolearn"
    assert lines[0].startswith(f"{TARGET}: {package}.")


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_can_be_built(path):
    assert build(composed(path), path.parent.name) is not None


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_shows_all_keys_of_what_it_calls(path):
    """So the file is the manual, and an override is checked before anything runs.

    Another package's class may be exchanged for one with other keys.
    """
    ours = [call for call in calls(composed(path)) if call[TARGET].startswith("echolearn.")]
    for call in ours:
        known = inspect.signature(imported(call[TARGET], "")).parameters
        assert call.keys() - {TARGET} == known.keys(), call[TARGET]


@cache
def plan(option):
    """Return a plan, built."""
    return build(composed(folder() / "plan" / f"{option}.yaml"), "plan")


@pytest.mark.parametrize("option", PLANS)
def test_a_plan_is_named_after_its_file(option):
    assert plan(option).name == option


def test_plans_draw_from_different_seeds_unless_they_are_small_copies():
    seeds = {
        option: plan(option).seed
        for option in PLANS
        if not option.startswith("tiny") and option != "paper_planar"
    }
    assert len(set(seeds.values())) == len(seeds)


def test_both_readings_of_the_paper_have_its_1989_points():
    paper, planar = plan("paper"), plan("paper_planar")
    assert (len(paper), len(planar)) == (1989, 1989)
    assert (len(paper.positions), len(planar.positions)) == (1989, 221)
    assert paper.room.size == (10.0, 8.0, 6.0)
    assert planar.room.walls == (1, 1, 1, 1, 0, 0)
    assert paper.window.lags(paper.scene.array, 22050) == (116, 244)


def test_the_scattered_set_is_as_wide_as_specified():
    scattered = plan("scattered")
    assert len(scattered) >= 4000
    assert (tuple(scattered.size_low), tuple(scattered.size_high)) == ((5, 5, 3), (14, 12, 7))
    assert tuple(scattered.t60) == (0.3, 0.9)
    assert tuple(scattered.snr_db) == (-40, 40)
    assert scattered.window.rule == "general"


def test_the_scattered_set_with_rotor_noise_is_scattered_but_for_the_rotors():
    plain, rotor = plan("scattered"), plan("scattered_rotor")
    assert isinstance(rotor.scene.diffuse, Diffuse)
    assert isinstance(rotor.scene.diffuse.source, Rotor)
    assert tuple(rotor.sdnr_db or ()) == (-40, 40)
    assert replace(
        rotor, name=plain.name, seed=plain.seed, sdnr_db=None, scene=plain.scene
    ) == replace(plain, scene=plain.scene)


def test_a_plan_with_rotors_takes_another_field_where_one_is_chosen():
    [(_, config)] = compose("generate", ["plan=scattered_rotor", "diffuse=recorded"])
    assert (
        config["plan"]["scene"]["diffuse"]["source"]["_target_"]
        == "echolearn.simulation.noise.recorded.recorded"
    )


def test_the_varied_set_is_realistic_and_has_what_invariant_classifiers_see() -> None:
    varied = plan("varied")
    assert isinstance(varied, ScatteredPlan)
    assert not varied.realism.clean and varied.name == "varied"
    assert tuple(varied.snr_db or ()) == (-20, 40)
    columns = yaml.safe_load((folder() / "classifier/columns/invariant.yaml").read_text())
    assert {*columns["inputs"]} <= {*COLUMNS, *varied.further}


@pytest.mark.parametrize("option", [option for option in PLANS if option.startswith("offgrid")])
def test_off_grid_sets_are_random_positions_in_the_room_of_their_name(option):
    fixed = plan(option)
    size = tuple(float(length) for length in option.removeprefix("offgrid_").split("x"))
    assert tuple(fixed.size_low) == tuple(fixed.size_high) == size
    assert tuple(fixed.gain_db) == (0, 0)


def test_the_comparison_asks_for_sets_that_have_plans_and_surveys_that_have_names():
    config = yaml.safe_load((folder() / "compare.yaml").read_text())
    assert set(config["tested"]) <= set(PLANS)
    rooms = {path.stem for path in (folder() / "room").glob("*.yaml")}
    levels = ["snr_db=-10,-5,0,10,40", f"room={','.join(sorted(rooms))}"]
    assert set(config["surveys"]) <= {
        job["name"] for _, job in compose("survey", levels, many=True)
    }
