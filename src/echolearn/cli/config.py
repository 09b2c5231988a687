"""A configuration is a call written down: `_target_` names what to call, other keys are arguments.

    conf/*.yaml + command line --compose--> plain containers --build--> objects

`build` makes the call, innermost first. What it calls must be defined in one of `ALLOWED`. The name
is imported, never searched for by walking through attributes, so
`echolearn.storage.manifests.os.system` leads nowhere; and where an object was defined counts, not
where it was found. Errors of what is called come through as they are.
"""

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, suggest

Config = dict[str, Any]

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

    arguments = {key: build(value, f"{name}.{key}") for key, value in config.items()}
    if TARGET not in config:
        return arguments

    function = find(arguments.pop(TARGET), name)
    parameters = inspect.signature(function).parameters
    for key, value in arguments.items():
        if key not in parameters:
            advice = suggest(key, list(parameters))
            raise BadValue(f"{name}.{key}={value}: there is no such key; {advice}")
    for key, parameter in parameters.items():
        if key not in arguments and parameter.default is parameter.empty:
            raise BadValue(f"{name}.{key}: is missing; {config[TARGET]} needs it")
    return function(**arguments)


def find(target: object, name: str) -> Callable[..., Any]:
    """Return the function or class of a dotted name, if it is defined where targets may be.

    Raises:
        BadValue: it is not, or does not exist.
    """
    module, _, leaf = str(target).rpartition(".")
    places = " or ".join(f"{place}*" for place in ALLOWED)
    refusal = f"{name}.{TARGET}={target}: must be a function or class defined in {places}"
    if not module.startswith(ALLOWED):
        raise BadValue(f"{refusal}; a configuration may call nothing else")
    try:
        found = getattr(import_module(module), leaf)
    except (ModuleNotFoundError, AttributeError) as error:
        raise BadValue(f"{refusal}; {error}") from None
    if not callable(found) or not f"{getattr(found, '__module__', '')}".startswith(ALLOWED):
        raise BadValue(f"{refusal}; this one is not")
    return found
