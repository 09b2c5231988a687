"""A configuration is a call written down: `_target_` names what to call, the other keys are its
arguments.

    conf/*.yaml + overrides --compose--> plain containers --build--> objects

Hydra joins the YAML files that a command line chooses; the values on the command line are then set
in copies of that, so a sweep over many of them costs little more than one.

`build` makes the call, innermost first. What it calls must be defined in one of `ALLOWED`: the name
is imported, never searched for by walking through attributes, so
`echolearn.storage.manifests.os.system` leads nowhere, and where an object was defined counts, not
where it was found. Errors of the called come through as they are.
"""

import copy
import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.checks import BadValue, suggest
from echolearn.cli.words import plain_value, texts

if TYPE_CHECKING:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

Config = dict[str, Any]

OPTIONAL = ("diffuse", "localizer@localizers.*")
"""Groups of which nothing may be chosen, group=null, with where their choice stands if it has
another name."""

TARGET = "_target_"

ALLOWED = ("echolearn.", "torch.nn.")
"""Where a target may be defined."""


class UsageError(Exception):
    """A command line that cannot be understood."""


def folder() -> Path:
    """Return the folder of the YAML files: the installed package's, or the repository's."""
    installed = Path(__file__).parents[1] / "conf"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "conf"


def build(config: Any, name: str = "config") -> Any:
    """Make the calls that a configuration writes down.

    Args:
        config: plain containers; every mapping with `_target_` becomes what its call returns.
        name: dotted name of this part, for errors.

    Raises:
        BadValue: a target that is not allowed or not there, a key that it does not know or lacks.
    """
    if isinstance(config, list):
        return [build(item, name) for item in config]
    if not isinstance(config, dict):
        return config
    arguments = {
        key: build(value, f"{name}.{key}") for key, value in config.items() if key != TARGET
    }
    return call(config[TARGET], arguments, name) if TARGET in config else arguments


def call(target: object, arguments: Config, name: str) -> Any:
    """Call what has that dotted name with keyword arguments."""
    function = find(target, name)
    parameters = inspect.signature(function).parameters
    for key in arguments.keys() - parameters.keys():
        raise BadValue(
            f"{name}.{key}={arguments[key]}: there is no such key; {suggest(key, list(parameters))}"
        )
    for key, parameter in parameters.items():
        if key not in arguments and parameter.default is parameter.empty:
            raise BadValue(f"{name}.{key}: is missing; {target} needs it")
    return function(**arguments)


def find(target: object, name: str) -> Callable[..., Any]:
    """Return the function or class of that dotted name, if it is defined where targets may be.

    Raises:
        BadValue: it is not, or does not exist.
    """
    module, _, leaf = str(target).rpartition(".")
    refusal = f"{name}._target_={target}: something defined in {' or '.join(place + '*' for place in ALLOWED)}"
    if not module.startswith(ALLOWED):
        raise BadValue(f"{refusal}; a configuration may call nothing else")
    try:
        found = getattr(import_module(module), leaf)
    except (ModuleNotFoundError, AttributeError) as error:
        raise BadValue(f"{refusal}; {error}") from None
    if not callable(found) or not f"{getattr(found, '__module__', '')}".startswith(ALLOWED):
        raise BadValue(f"{refusal}; this one is not")
    return found


def compose(
    command: str, words: Sequence[str], *, many: bool = False, resolve: bool = True
) -> list[tuple[str, Config]]:
    """Return every job of a command line: what was swept, in words, and its configuration as plain
    containers.

    Key `choice` of a configuration holds the option chosen in each group, `command` the command
    line of this job alone.

    All are composed before the first one runs, so a slip in the last stops them all.

    Args:
        command: names the primary configuration.
        words: overrides in Hydra's grammar.
        many: whether they may sweep.
        resolve: replace interpolations by what they stand for.

    Raises:
        UsageError: an override that cannot be understood, or a key or an option that does not
            exist.
    """
    if find_spec("hydra") is None:
        return [("", plainly(command, words))]
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    jobs: list[tuple[str, Any]] = []
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(folder())):
            join = partial(_join, command)
            for name, job, choosing, values in _expand(words, many=many):
                config = _configure(join, choosing, values)
                plain: Any = OmegaConf.to_container(
                    config, resolve=resolve, throw_on_missing=resolve
                )
                jobs.append(
                    (name, {**texts(plain), "command": shlex.join(["echolearn", command, *job])})
                )
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(str(error).split("\nSee http")[0]) from error
    return jobs


def plainly(command: str, words: Sequence[str]) -> Config:
    """Return a command's configuration without Hydra, as on a robot: one file, and words that are
    plain `key=value`.

    Raises:
        UsageError: a command that is put together from several files, or a key that does not exist.
    """
    import yaml

    config: Config = yaml.safe_load((folder() / f"{command}.yaml").read_text())
    if "defaults" in config:
        raise UsageError(
            f"{command}: needs the whole laboratory; run: pip install 'echolearn[lab]'"
        )
    for word in words:
        key, _, value = word.partition("=")
        if key not in config:
            raise UsageError(f"{word}: there is no key {key}; {suggest(key, list(config))}")
        try:
            config[key], null = plain_value(value), isinstance(config[key], str)
        except yaml.YAMLError:
            raise UsageError(f"{word}: cannot be read; are quotes or brackets missing?") from None
        if config[key] is None and null:
            raise UsageError(f"{word}: {key} cannot be null")
    return {**texts(config), "choice": {}, "command": shlex.join(["echolearn", command, *words])}


def _expand(
    words: Sequence[str], *, many: bool
) -> Iterator[tuple[str, Sequence[str], list[str], list["Override"]]]:
    """Yield each combination of the swept values: what is swept, all words, the options chosen, the
    values set.
    """
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parser = OverridesParser.create(GlobalHydra.instance().config_loader())
    given = [_parsed(parser, word) for word in words]
    parse = cache(parser.parse_override)
    chooses = cache(lambda word: _chooses(parse(word)))
    for job in product(*(_spread(override, many=many) for override in given)):
        swept = [
            word for word, override in zip(job, given, strict=True) if override.is_sweep_override()
        ]
        yield (
            " ".join(swept),
            job,
            [_chosen(parse(word)) for word in job if chooses(word)],
            [parse(word) for word in job if not chooses(word)],
        )


def _parsed(parser: "OverridesParser", word: str) -> "Override":
    """Return an override; one that Hydra's grammar cannot read is refused with the quotes that it
    needs.
    """
    from hydra.errors import OverrideParseException

    try:
        return parser.parse_overrides([word])[0]
    except OverrideParseException as error:
        key, equal, value = word.partition("=")
        if equal and str(error).startswith(
            "Error parsing"
        ):  # a function, which says what it misses
            raise
        quoted = "{}='{}'".format(key, value.replace("'", "\\'"))
        plain = not {*value} & {*'[{"$`\\'}
        hint = f'quote it twice: "{quoted}"' if plain else "are quotes or brackets missing?"
        raise UsageError(
            f"{word}: cannot be read; {hint if equal else 'it is no key=value'}"
        ) from error


def _spread(override: "Override", *, many: bool) -> list[str]:
    """Return an override once for each of its values."""
    word = override.input_line or ""
    if not override.is_sweep_override():
        return [word]
    if not many:
        raise UsageError(
            f"{word}: several values need -m, or brackets if they are one list, key=[a,b]"
        )
    spread = [f"{override.get_key_element()}={value}" for value in override.sweep_string_iterator()]
    if not spread:
        options = _options(override.key_or_group)
        raise UsageError(
            f"{word}: matches nothing" + (f"; known are {', '.join(options)}" if options else "")
        )
    return spread


def _options(group: str) -> list[str]:
    """Return the names of a group's files; none if there is no such group."""
    from hydra.core.global_hydra import GlobalHydra

    return GlobalHydra.instance().config_loader().get_group_options(group)


def _chooses(override: "Override") -> bool:
    """Tell whether an override chooses among files rather than setting a value; refuse options that
    do not exist.
    """
    group, word, option = override.key_or_group, override.input_line, override.value()
    if group.replace("/", ".").partition(".")[0] == "hydra":
        raise UsageError(f"{word}: hydra's own settings are fixed, but for its launcher's")
    options = _options(group)
    if options and isinstance(option, str) and option not in options:
        raise UsageError(f"{word}: {group} has no option {option}; {suggest(option, options)}")
    if (
        options
        and option is None
        and not any(fnmatchcase(_group(override), name) for name in OPTIONAL)
    ):
        raise UsageError(
            f"{word}: {_group(override)} cannot be left out; it is one of {', '.join(options)}"
        )
    return bool(options)


def _group(override: "Override") -> str:
    """Return the group of an override, with where its choice stands if that is named:
    localizer@localizers.em.
    """
    return "@".join(filter(None, (override.key_or_group, override.package)))


def _chosen(override: "Override") -> str:
    """Return how Hydra says what an override chooses, which may be nothing."""
    return f"~{_group(override)}" if override.value() is None else override.input_line or ""


def _configure(
    join: Callable[..., "DictConfig"], choosing: Sequence[str], values: Sequence["Override"]
) -> "DictConfig":
    """Return the configuration of one job: the files that its options choose, then its values."""
    from omegaconf import OmegaConf

    config = copy.deepcopy(join(*choosing))
    known = [key for key in dotted(OmegaConf.to_container(config)) if not key.startswith("choice")]
    for override in values:
        _set(config, override, known)
    return config


def _set(config: "DictConfig", override: "Override", known: Sequence[str]) -> None:
    """Set one value. Its key must exist, or belong to a call, which knows its own keys and refuses
    others.
    """
    from hydra.core.override_parser.types import OverrideType
    from omegaconf import DictConfig, OmegaConf

    key, word, parent = (
        override.key_or_group,
        override.input_line,
        override.key_or_group.rpartition(".")[0],
    )
    if key not in known and f"{parent}.{TARGET}" not in known:
        raise UsageError(f"{word}: there is no key {key}; {suggest(key, known)}")
    needed = isinstance(OmegaConf.select(config, key), str | DictConfig)
    if override.type == OverrideType.DEL:
        advice = _left_out(config, key) or (
            f"{key} cannot be null either" if needed else "set it to null"
        )
        raise UsageError(f"{word}: keys are set, not deleted; {advice}")
    if override.value() is None and needed:
        raise UsageError(
            "; ".join(filter(None, (f"{word}: {key} cannot be null", _left_out(config, key))))
        )
    OmegaConf.update(config, key, override.value(), merge=True, force_add=True)


def _left_out(config: "DictConfig", key: str) -> str:
    """Say how what a group has put at a key is left out; nothing if it cannot be."""
    groups = [str(group) for group in config.choice if str(group).partition("@")[2] == key]
    able = [group for group in groups if any(fnmatchcase(group, name) for name in OPTIONAL)]
    return f"leave it out by {able[0]}=null" if able else ""


@cache
def _join(command: str, *words: str) -> "DictConfig":
    """Let Hydra join a command's files as `words` choose; `choice` holds the name of each chosen
    file.
    """
    from hydra import compose as join
    from omegaconf import OmegaConf, open_dict

    config = join(command, list(words), return_hydra_config=True)
    chosen = {
        group: name
        for group, name in config.hydra.runtime.choices.items()
        if not group.startswith("hydra/")
    }
    with open_dict(config):
        del config["hydra"]
        config.choice = chosen
        for word in words:
            if word.startswith("~") and "@" in word:
                parent, _, name = word.partition("@")[2].rpartition(".")
                OmegaConf.select(config, parent).pop(name, None)  # what an experiment set of it
    return config


def dotted(config: Any, name: str = "") -> Iterator[str]:
    """Yield the dotted name of everything inside plain containers."""
    items = (
        config.items()
        if isinstance(config, dict)
        else enumerate(config)
        if isinstance(config, list)
        else ()
    )
    for key, value in items:
        yield f"{name}{key}"
        yield from dotted(value, f"{name}{key}.")


def without(config: Mapping[str, Any], names: str) -> Config:
    """Return what remains of a mapping without the keys in `names`, separated by blanks."""
    return {key: value for key, value in config.items() if key not in names.split()}
