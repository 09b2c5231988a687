"""From a command line to configurations: Hydra joins files, and values are set in copies of that.

    words --expand--> the words of each job --join--> files, joined --set--> plain containers

Hydra takes about 0.3 s to join the files of a command. It does so once for each combination of
chosen files. Values, such as seeds, are then set in copies, for a tenth of the time, so that a
sweep over hundreds of jobs begins within seconds. Everything is composed before the first job runs,
so a slip in the last one stops them all.
"""

import copy
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from functools import cache
from importlib.util import find_spec
from io import StringIO
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.checks import BadValue, suggest
from echolearn.cli.config import Config, UsageError
from echolearn.cli.names import plan_of_folder, with_adapted
from echolearn.cli.own import folder, folders, teach_hydra
from echolearn.cli.searches import is_searched, space_of
from echolearn.cli.targets import TARGET
from echolearn.cli.words import NO_PAIR, NONE_ALLOWED, TEXTS, is_text, plain_config, quoted, split
from echolearn.storage.files import one_line
from echolearn.storage.named import folder_named

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

OPTIONAL = ("diffuse", "localizer@localizers.")
"""Beginnings of the groups of which nothing may be chosen, group=null."""


def compose(
    command: str,
    words: Sequence[str],
    *,
    many: bool = False,
    resolve: bool = True,
    primary: str | None = None,
) -> list[tuple[str, Config]]:
    """Return every job of a command line: what was swept, and its configuration.

    A configuration is plain containers. Its key `choice` holds the option chosen in each group,
    `command` the command line of this job alone.

    Args:
        command: names the primary configuration.
        words: overrides in Hydra's grammar.
        many: whether they may sweep.
        resolve: replace interpolations by what they stand for.
        primary: name of another primary configuration.

    Raises:
        UsageError: an override that cannot be understood, or a key or an option that does not
            exist.
        BadValue: a name or a path that is no text.
    """
    if find_spec("hydra") is None:
        return [("", plain_config(command, words))]
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        teach_hydra()
        with initialize_config_dir(version_base="1.3", config_dir=str(folder())):
            jobs = []
            # A search goes through the values itself.
            tuned = command == "tune" and not many
            searched = [word for word in words if tuned and is_searched(_parse(word))]
            others = [word for word in words if word not in searched]
            for swept, typed in _expand(others, many=many):
                job = with_adapted(plan_of_folder(typed))
                config = _configuration(primary or command, job, resolve=resolve)
                told: Config = {"command": command_of(command, [*job, *searched], primary=primary)}
                if searched:
                    told["space"] = space_of([_parse(word) for word in searched])
                jobs.append((swept, config | told))
            return jobs
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(str(error).split("\nSee http")[0]) from error


def _expand(words: Sequence[str], *, many: bool) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each combination of swept values: what is swept, and the words of this job."""
    overrides = [_parse(word) for word in words]
    for job in product(*[_spread(override, many=many) for override in overrides]):
        pairs = zip(job, overrides, strict=True)
        yield " ".join(word for word, override in pairs if override.is_sweep_override()), job


@cache
def _parse(word: str) -> "Override":
    """Return an override; what Hydra cannot read is refused with the quotes that it needs."""
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import OverrideParseException

    parser = OverridesParser.create(GlobalHydra.instance().config_loader())
    try:
        return parser.parse_overrides([word])[0]
    except OverrideParseException as error:
        key, equal, value = word.partition("=")
        text = key in TEXTS or key.endswith(".name")
        if equal and not text and str(error).startswith("Error parsing"):
            # It is about a function, such as glob(...), and says what is wrong with it.
            raise
        hint = quoted(word)
        if not equal:
            hint = NO_PAIR
        elif "=" in value and not text:
            blank = value.replace("=", " ")
            hint = f"is one = too many? {quoted(f'{key}={blank}')}"
        elif value[:1] in ("'", '"', "") or ({*value} & {*"[{"} and not text):
            hint = "are quotes or brackets missing?"
        raise UsageError(f"{word}: cannot be read; {hint}") from error
    except ValueError as error:
        raise UsageError(f"{word:.100}: cannot be read; {one_line(error)}") from error


def _spread(override: "Override", *, many: bool) -> list[str]:
    """Return an override once for each of its values."""
    word = override.input_line or ""
    if not override.is_sweep_override():
        return [word]
    if not many:
        hint = "or brackets if they are one list, key=[a,b]"
        if override.key_or_group in TEXTS:
            hint = f"or is it one name? Then {quoted(word)}"
        raise UsageError(f"{word}: several values need -m, {hint}")

    key, _, typed = word.partition("=")
    if override.is_interval_sweep():
        hint = "range(0,3) and choice(1,10) have some; or let echolearn tune search it"
        raise UsageError(f"{word}: an interval has no values to run through; {hint}")
    if getattr(override.value(), "simple_form", False):
        # As they were typed: Hydra would make 7 of 007.
        values = split(typed)
    else:
        values = list(override.sweep_string_iterator())
    if not values:
        options = ", ".join(_options(override.key_or_group))
        raise UsageError(f"{word}: matches nothing" + (options and f"; known are {options}"))
    return [f"{key}={value}" for value in values]


def _options(group: str) -> list[str]:
    """Return the names of a group's files; none if there is no such group."""
    return _options_in(group, tuple(folders()))


@cache
def _options_in(group: str, places: tuple[Path, ...]) -> list[str]:
    """Return `_options` of a group; what is remembered is that of these folders."""
    from hydra.core.global_hydra import GlobalHydra

    return GlobalHydra.instance().config_loader().get_group_options(group)


def _configuration(command: str, job: Sequence[str], *, resolve: bool) -> Config:
    """Return the configuration of one job: the files that its options choose, then its values."""
    from omegaconf import OmegaConf

    overrides = [_parse(word) for word in job]
    choosing = [override for override in overrides if _chooses(override)]
    values = [override for override in overrides if override not in choosing]
    config = _join(command, *map(_choice, choosing), places=tuple(folders()))
    if values:
        # What is joined stays as it is for the next job; copying it takes half of all the time.
        config = copy.deepcopy(config)
        keys = dotted(OmegaConf.to_container(config))
        known = [key for key in keys if not key.startswith("choice")]
        for override in values:
            _set(config, override, known=known)

    _name_robot(config)
    plain: Any = OmegaConf.to_container(config, resolve=resolve, throw_on_missing=resolve)
    return dict(plain)


def _name_robot(config: Any) -> None:
    """Let the scene of a recorded robot name its place: that of a survey, or `robot` of `fit`."""
    from omegaconf import OmegaConf

    survey = OmegaConf.select(config, "scene.folder", default=None)
    robot = OmegaConf.select(config, "robot", default=None)
    if isinstance(survey, str):
        place = folder_named(survey, "survey", runs=Path(config.runs), key="scene.folder")
        config.scene.folder = str(place)
    elif isinstance(robot, str):
        config.scene.folder = robot


def command_of(command: str, words: Sequence[str], *, primary: str | None) -> str:
    """Return the command line of one job, with the options without which it would mean another.

    Args:
        command: what is done.
        words: overrides.
        primary: name of the primary configuration that was typed, if any.
    """
    options = [f"--config-name={primary}"] if primary else []
    options += [f"--config-dir={place}" for place in folders()[1:]]
    return shlex.join(["echolearn", command, *words, *options])


def show_info(wish: str, primary: str, *, words: Sequence[str]) -> str:
    """Return what Hydra tells of how a configuration is put together.

    Args:
        wish: what to tell, as `--info` has it.
        primary: name of the primary configuration.
        words: overrides.

    Raises:
        UsageError: an override that Hydra cannot understand.
    """
    return _told(lambda hydra: hydra.show_info(wish, config_name=primary, overrides=list(words)))


def show_hydra(wish: str, primary: str, *, words: Sequence[str], package: str | None) -> str:
    """Return Hydra's own configuration of a command, or with wish=all the command's beside it.

    Args:
        wish: hydra or all.
        primary: name of the primary configuration.
        words: overrides.
        package: dotted name of the part that is wanted, or None.

    Raises:
        UsageError: an override that Hydra cannot understand.
    """
    return _told(lambda hydra: hydra.show_cfg(primary, list(words), wish, package))


def _told(telling: Callable[[Any], None]) -> str:
    """Return what Hydra prints when it is asked for something."""
    if find_spec("hydra") is None:
        raise UsageError("this is told by Hydra, which is not here; pip install 'echolearn[lab]'")
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    teach_hydra()
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(folder())):
            # Hydra logs it line by line, and would complain at each that nobody reads any more.
            with redirect_stdout(StringIO()) as told:
                telling(GlobalHydra.instance().hydra)
            return told.getvalue().strip()
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(str(error).split("\nSee http")[0]) from error


def shown(config: Config, package: str | None) -> str:
    """Return a configuration as YAML, or the part of it that a dotted name tells.

    Raises:
        UsageError: no such part.
    """
    import yaml

    part: Any = config
    for key in package.split(".") if package else []:
        if not isinstance(part, dict) or key not in part:
            advice = suggest(str(package), list(dotted(config)))
            raise UsageError(f"--package={package}: there is no such key; {advice}")
        part = part[key]
    return yaml.safe_dump(part, sort_keys=False).removesuffix("...\n")


def _chooses(override: "Override") -> bool:
    """Tell whether an override chooses a file rather than setting a value.

    Raises:
        UsageError: an option that does not exist.
    """
    word = override.input_line
    key = override.key_or_group
    if key.startswith("hydra"):
        raise UsageError(f"{word}: hydra's own settings are fixed, but for its launcher's")
    options = _options(key)
    option = override.value()
    if options and isinstance(option, str) and option not in options:
        raise UsageError(f"{word}: {key} has no option {option}; {suggest(option, options)}")
    group = _group(override)
    if options and option is None and not group.startswith(OPTIONAL):
        known = ", ".join(options)
        raise UsageError(f"{word}: {group} cannot be left out; it must be one of {known}")
    return bool(options)


def _group(override: "Override") -> str:
    """Return the group of an override, with its place if that is named: localizer@localizers.em."""
    return "@".join(filter(None, (override.key_or_group, override.package)))


def _choice(override: "Override") -> str:
    """Return how Hydra says what an override chooses, which may be nothing."""
    return f"~{_group(override)}" if override.value() is None else override.input_line or ""


@cache
def _join(command: str, *choices: str, places: tuple[Path, ...]) -> "DictConfig":
    """Let Hydra join a command's files; `choice` holds the name of each chosen file.

    Args:
        command: names the primary configuration.
        choices: words that choose files.
        places: folders of the files, by which what was joined before is known.
    """
    from hydra import compose as join
    from omegaconf import OmegaConf, open_dict

    config = join(command, list(choices), return_hydra_config=True)
    chosen = config.hydra.runtime.choices.items()
    with open_dict(config):
        del config["hydra"]
        config.choice = {key: name for key, name in chosen if not key.startswith("hydra/")}
        for choice in choices:
            if choice.startswith("~") and "@" in choice:
                # An experiment may have set keys of what is left out.
                parent, _, name = choice.partition("@")[2].rpartition(".")
                OmegaConf.select(config, parent).pop(name, None)
    return config


def _set(config: "DictConfig", override: "Override", *, known: Sequence[str]) -> None:
    """Set one value.

    Its key must exist, or belong to a call, which knows its own keys and refuses others.
    """
    from hydra.core.override_parser.types import OverrideType
    from omegaconf import DictConfig, OmegaConf

    key = override.key_or_group
    word = override.input_line or ""
    if key not in known and f"{key.rpartition('.')[0]}.{TARGET}" not in known:
        raise UsageError(f"{word}: there is no key {key}; {suggest(key, known)}")

    default = OmegaConf.select(config, key)
    value = override.value()
    refusal = ""
    if override.type == OverrideType.DEL:
        refusal = f"keys are set, {key}=value, not deleted"
    elif value is None and isinstance(default, str | DictConfig) and key not in NONE_ALLOWED:
        refusal = f"{key} cannot be null"
    if refusal:
        group = f"localizer@{key}"
        advice = f"; leave it out by {group}=null" if group in config.choice else ""
        raise UsageError(f"{word}: {refusal}{advice}")

    # A name that looks like a number stays what was typed, in a list of names, too.
    typed = word.partition("=")[2].strip()
    if is_text(key, default):
        if isinstance(value, list | dict):
            allowed = f"must be a {'path' if key in TEXTS - {'name'} else 'name'}"
            raise BadValue(f"{word}: {allowed}; {quoted(word)}")
        value = typed if isinstance(value, int | float) else value
    elif isinstance(value, list) and default and all(isinstance(name, str) for name in default):
        pairs = zip(value, split(typed[1:-1]) if value else [], strict=True)
        value = [item if isinstance(item, str) else name for item, name in pairs]
    OmegaConf.update(config, key, value, merge=True, force_add=True)


def dotted(config: Any, name: str = "") -> Iterator[str]:
    """Yield the dotted name of everything inside plain containers."""
    if isinstance(config, list):
        config = dict(enumerate(config))
    if isinstance(config, dict):
        for key, value in config.items():
            yield f"{name}{key}"
            yield from dotted(value, f"{name}{key}.")
