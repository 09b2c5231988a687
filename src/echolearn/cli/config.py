"""A configuration is a call written down: `_target_` names what to call, other keys are arguments.

    conf/*.yaml + command line --compose--> plain containers --build--> objects

`build` makes the call, innermost first; `targets` tells what may be called where. Errors of what is
called come through, with the keys that were typed: who is called knows that it is an `array`, not
that this one stands in `scene`.
"""

import inspect
import re
from collections.abc import Callable
from typing import Any

from echolearn.checks import BadValue, suggest
from echolearn.cli.targets import TARGET, check_made, find

Config = dict[str, Any]


SHARED = frozenset("scene realism localizer noise diffuse rir".split())
"""Groups that others refer to as a whole, `plan.scene: ${scene}`: their keys are typed as those of
the group."""


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

    arguments = {
        key: build(value, key if key in SHARED else f"{name}.{key}")
        for key, value in config.items()
    }
    if TARGET not in config:
        return arguments

    target = arguments.pop(TARGET)
    function = find(target, name)
    _check_keys(arguments, function, name=name)
    try:
        value = function(**arguments)
    except BadValue as error:
        raise BadValue(_typed(str(error), name, keys=list(arguments))) from error
    check_made(value, target, name=name)
    return value


def _typed(message: str, name: str, *, keys: list[str]) -> str:
    """Return a message in which the keys of a place are those that can be typed.

    Args:
        message: of what was called there, which says `array.radius`.
        name: dotted name of the place, such as `scene.array`.
        keys: arguments of the call.
    """
    last = name.rpartition(".")[2]
    key = "|".join(map(re.escape, keys)) or "(?!)"
    return re.sub(rf"(?<![\w./'\"]){last}(?=\.(?:{key})\b)|\A{last}(?==)", name, message)


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
