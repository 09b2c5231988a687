"""The robot that a run was trained for: array and probe of the command that made its set.

    run --set_folder--> its set --own_command--> scene, or survey --built--> array, probe

A manifest holds arrays as hashes alone, by which `export` proves what is found here.
"""

import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from echolearn.cli.keys import built, named, recorded_survey

if TYPE_CHECKING:
    from echolearn.cli.config import Config


def robot_of_set(config: "Config") -> "Config":
    """Return the array and the probe that the set of a run was made with, built.

    They are those of the command that made the set, unless a scene is typed, or nothing is known of
    that command.
    """
    from echolearn.storage.advice import anywhere, own_command
    from echolearn.storage.manifests import load_manifest
    from echolearn.training.export import find_run, set_folder

    usual: Config = config["scene"]
    words = shlex.split(config["command"])[2:]
    if not any(word.startswith("scene") for word in words):
        run = named(config, "run", place="train")
        place = set_folder(find_run(run, named(config, "best", place="compare")))
        made = own_command(load_manifest(place))
        usual = scene_of(anywhere(made, place), usual) if made else usual
    return built(usual, "array probe", prefix="scene.")


def scene_of(command: str, usual: "Config") -> "Config":
    """Return the scene of a command that made a set.

    Args:
        command: its command line.
        usual: what is returned if the scene cannot be told.
    """
    from echolearn.checks import BadValue
    from echolearn.cli.compose import compose
    from echolearn.cli.config import UsageError

    _, name, *words = [word for word in shlex.split(command) if not word.startswith("--")]
    with suppress(BadValue, UsageError, FileNotFoundError):
        [(_, made)] = compose(name, words)
        if "survey" not in made:
            return dict(made["scene"])
        # Of what was labelled, or fitted to, the robot is that of the survey, or of its own file.
        folder = recorded_survey(made) if made["survey"] else Path(str(made.get("robot")))
        if folder.exists():
            target = "echolearn.simulation.recorded_scene.recorded_"
            parts = ("array", "probe")
            return {key: {"_target_": target + key, "folder": str(folder)} for key in parts}
    return usual
