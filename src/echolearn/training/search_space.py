"""What a search over a classifier's settings may try: ranges and choices by dotted key.

lr: {low: 0.0001, high: 0.01, log: true}        a number between two, log: in even ratios
depth: {low: 2, high: 8}                        a whole number, as both ends are
c_grid: {low: 0.1, high: 100, log: true, listed: true}     a list of that number alone
net.widths: {choices: [[32, 32], [64, 64]]}     one of several values
"""

import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, fields
from math import log
from typing import TYPE_CHECKING, Any

from echolearn.checks import check, check_list, check_number

if TYPE_CHECKING:
    from optuna.trial import Trial

EDGE = 0.02
"""Share of a range, at either end, in which a best value lies on its edge."""


@dataclass(frozen=True)
class Range:
    """Numbers between two, both of them included.

    Attributes:
        low, high: the least and the largest; a whole number is drawn if both are.
        log: whether equal ratios are as likely as each other, not equal differences.
        listed: whether a setting is a list of the number.
    """

    low: float
    high: float
    log: bool = False
    listed: bool = False

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            check_number(name, getattr(self, name), low=-1e9, high=1e9)
        allowed = "must be below high, and above 0 with log"
        sound = self.low < self.high and (self.low > 0 or not self.log)
        check(sound, "low", self.low, allowed=allowed)

    def suggest(self, trial: "Trial", key: str) -> Any:
        """Return a trial's value, drawn unless it is known."""
        whole = isinstance(self.low, int) and isinstance(self.high, int)
        draw: Any = trial.suggest_int if whole else trial.suggest_float
        value = draw(key, self.low, self.high, log=self.log)
        return [value] if self.listed else value

    def at_edge(self, value: float) -> bool:
        """Tell whether a value is so near an end that a better one may lie beyond."""
        scale = log if self.log else float
        share = (scale(value) - scale(self.low)) / (scale(self.high) - scale(self.low))
        return not EDGE < share < 1 - EDGE


@dataclass(frozen=True)
class Choices:
    """Values of any kind.

    Attributes:
        choices: at least two plain values.
    """

    choices: list[Any]

    def __post_init__(self) -> None:
        check_list("choices", self.choices)
        check(len(self.choices) > 1, "choices", self.choices, allowed="must be two values or more")

    def suggest(self, trial: "Trial", key: str) -> Any:
        """Return a trial's value, drawn unless it is known."""
        # Optuna's journal holds texts and numbers only.
        return json.loads(trial.suggest_categorical(key, [*map(json.dumps, self.choices)]))

    def at_edge(self, _value: object) -> bool:
        """Tell that choices have no edges."""
        return False


Space = dict[str, Range | Choices]


def read_space(plain: object, *, name: str) -> Space:
    """Return the search space that plain containers, as of a YAML file, describe.

    Raises:
        BadValue: a key or a value that no search space has; it is told with `name`, the file.
    """
    allowed = "must be a mapping of keys to {low, high} or {choices}"
    check(isinstance(plain, Mapping) and len(plain) > 0, name, plain, allowed=allowed)
    space: Space = {}
    for key, each in dict(plain).items():  # type: ignore[call-overload]
        kind = Choices if isinstance(each, Mapping) and "choices" in each else Range
        known = {field.name for field in fields(kind)}
        needed = {"choices"} if kind is Choices else {"low", "high"}
        sound = isinstance(each, Mapping) and needed <= {*each} <= known
        check(sound, f"{name} {key}", each, allowed=allowed)
        space[str(key)] = kind(**each)
    return space


def with_values(config: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration, plain containers, with other values at dotted keys.

    Raises:
        BadValue: a key that is not there.
    """
    changed = deepcopy(dict(config))
    for key, value in values.items():
        *groups, last = key.split(".")
        place: Any = changed
        for group in groups:
            place = place.get(group) if isinstance(place, dict) else None
        there = isinstance(place, dict) and last in place
        allowed = "must be a key of the classifier"
        check(there, "search space", key, allowed=allowed)
        place[last] = value
    return changed
