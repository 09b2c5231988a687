"""Words of a command line, typed by the key they set: never by guessing what they look like.

    default of the key     what was typed is read as
    text, or null          the same text; null is none where the default is, or `NONE_ALLOWED`
    true or false          true or false
    a number               a number, whole where the default is whole

So `name=2024_01_15`, `name=007` and `name=1e3` are names. Keys whose default is null may also take
numbers or lists, `without=[3]`; `TEXTS` are those that do not. Without Hydra, as on a robot, a
command whose configuration is one file is read by `plain_config`, and every value by this table.
"""

import shlex
from collections.abc import Sequence
from contextlib import suppress
from copy import deepcopy
from typing import Any

from echolearn.checks import suggest
from echolearn.cli.config import Config, UsageError
from echolearn.cli.own import folder
from echolearn.storage.advice import assignment, shell, text_of

TEXTS = frozenset("name runs init survey bundle run best readme page scaling folder card".split())
"""Keys of names and paths, which take text even where their default is null."""

NO_PAIR = "it is no key=value; are quotes around blanks missing?"

NUMBERS = frozenset({"dds", "foxglove", "until"})
"""Keys that take a number though their default is null."""

NONE_ALLOWED = frozenset({"bundle", "port"})
"""Keys that may be null though their default is a text or a number."""


def plain_config(command: str, words: Sequence[str]) -> Config:
    """Return a command's configuration without Hydra: one file, and words `key=value`.

    Raises:
        UsageError: a command that is put together from several files, a key that does not exist, or
            a value of another type than its default.
    """
    import yaml

    defaults: Config = yaml.safe_load((folder() / f"{command}.yaml").read_text())
    if "defaults" in defaults:
        extras = "lab,tune" if command == "tune" else "lab"
        hint = f"pip install 'echolearn[{extras}]'"
        raise UsageError(f"{command}: needs more than a robot has; {hint}")
    config = deepcopy(defaults)
    for word in words:
        key, equal, _ = word.partition("=")
        if not equal:
            raise UsageError(f"{word}: cannot be read; {NO_PAIR}")
        *groups, last = key.split(".")
        place: Any = config
        for group in groups:
            place = place.get(group) if isinstance(place, dict) else None
        if not isinstance(place, dict) or isinstance(place.get(last, {}), dict):
            raise UsageError(f"{word}: there is no key {key}; {suggest(key, list(defaults))}")
        place[last] = read_value(word, place[last])
    return {**config, "choice": {}, "command": shlex.join(["echolearn", command, *words])}


def read_value(word: str, default: Any) -> Any:
    """Return what `key=value` sets, typed by the key's default.

    Raises:
        UsageError: a value of another type.
    """
    key, _, value = word.partition("=")
    value = value.strip()
    if value.lower() == "null":
        if default is not None and key not in NONE_ALLOWED:
            raise UsageError(f"{word}: {key} cannot be null")
        return None
    if isinstance(default, bool):
        if value.lower() not in ("true", "false"):
            raise UsageError(f"{word}: must be true or false")
        return value.lower() == "true"
    if isinstance(default, int | float) or key in NUMBERS:
        with suppress(ValueError):
            return int(value)
        with suppress(ValueError):
            return float(value)
        raise UsageError(f"{word}: must be a number")
    if default is None and key not in TEXTS and value.startswith("["):
        return _read_list(word, value)
    # Quotes around a text are not part of it, as with Hydra.
    return text_of(value)


def _read_list(word: str, value: str) -> list[Any]:
    """Return a list that was typed in brackets."""
    import yaml

    with suppress(yaml.YAMLError):
        found = yaml.safe_load(value)
        if isinstance(found, list):
            return found
    raise UsageError(f"{word}: must be a list, [1,2]")


def quoted(word: str) -> str:
    """Return how to write a word whose value is meant as it stands, for Hydra and for a shell."""
    key, _, value = word.partition("=")
    return f"quote it twice: {shell(assignment(key, value))}"


def is_text(key: str, default: Any) -> bool:
    """Tell whether a key takes a text: a name, a path, or what has a text for its default."""
    return key in TEXTS or isinstance(default, str)


def split(typed: str) -> list[str]:
    """Return what stands between commas, but for those within quotes or brackets."""
    parts = [""]
    mark = ""
    depth = 0
    for character in typed:
        if mark:
            mark = "" if character == mark and not parts[-1].endswith("\\") else mark
        elif character in "'\"":
            mark = character
        else:
            depth += (character in "[{(") - (character in "]})")
        if character == "," and not mark and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]
