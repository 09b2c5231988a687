"""What the words of a command line stand for: texts, numbers, truth values, as Hydra's grammar has
them.
"""

import re
from collections.abc import Mapping
from typing import Any

from echolearn.checks import check

TEXTS = "name runs survey bundle run best readme scaling page".split()
"""Keys of names and paths, which are texts though they may look like numbers."""

WORDS = {"": "", "null": None, "true": True, "false": False}
"""Words of any case that Hydra takes for something else than text."""

NUMBER = re.compile(
    r"[+-]?((0|[1-9](_?\d)*)(\.\d*)?|\.\d+)(e[+-]?\d+)?|[+-]?(inf|nan)", re.ASCII | re.IGNORECASE
)


def plain_value(word: str) -> Any:
    """Return what Hydra takes a word for: YAML would read yes as true, 1e-1 as text, 010 as 8 and
    12:30 as 750.
    """
    import yaml

    word = word.strip()
    if word.lower() in WORDS:
        return WORDS[word.lower()]
    if NUMBER.fullmatch(word):
        return float(word) if {*".einEIN"} & {*word} else int(word)
    return yaml.safe_load(word) if word[0] in "'\"[{" else word


def texts(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration whose names and paths are texts, whole numbers among them.

    Raises:
        BadValue: a name or a path that is a list, say.
    """
    named = {key: config[key] for key in TEXTS if config.get(key) is not None}
    for key, value in named.items():
        plain = isinstance(value, str) or type(value) is int
        check(
            plain,
            key,
            value,
            allowed="a name" if key == "name" else "a path",
            hint="quote it twice: \"'...'\"",
        )
    return {**config} | {key: str(value) for key, value in named.items()}
