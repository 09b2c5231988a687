"""A configuration is a call written down: `_target_` names what to call, other keys are arguments.

    conf/*.yaml + command line --compose--> plain containers --build--> objects

`build` makes the call, innermost first; `targets` tells what may be called where. Errors of what is
called come through as they are.
"""

import inspect
from collections.abc import Callable
from typing import Any

from echolearn.checks import BadValue, suggest
from echolearn.cli.targets import TARGET, check_made, find

Config = dict[str, Any]


class UsageError(Exception):
    """A command line that cannot be understood."""


def build(config: Any, name: str) -> Any:
    """Make the calls that a configuration writes down.

    Args:
        config: plain containers; every mapping with `_target_` becomes what its call returns.
        name: dotted name of this part, whose last word decides what may be called.

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

    target = arguments.pop(TARGET)
    function = find(target, name)
    _check_keys(arguments, function, name=name)
    value = function(**arguments)
    check_made(value, target, name=name)
    return value


def _check_keys(arguments: Config, function: Callable[..., Any], *, name: str) -> None:
    """Raise `BadValue` for a key that a function does not know, or one that it lacks.

    Args:
        arguments: by name.
        function: what is to be called.
        name: dotted name of the place.
    """
    parameters = inspect.signature(function).parameters
    if any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
        return  # it knows for itself
    for key, value in arguments.items():
        if key not in parameters:
            advice = suggest(key, list(parameters))
            raise BadValue(f"{name}.{key}={value}: there is no such key; {advice}")
    for key, parameter in parameters.items():
        required = parameter.default is parameter.empty
        if key not in arguments and required:
            raise BadValue(f"{name}.{key}: is missing; {function.__qualname__} needs it")
