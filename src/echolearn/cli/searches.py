"""What `tune` shall search, typed in Hydra's grammar of sweeps.

    classifier.lr=tag(log,interval(1e-4,1e-2))  -->  lr: {low: 0.0001, high: 0.01, log: true}
    classifier.batch_size=choice(64,128)        -->  batch_size: {choices: [64, 128]}

What is typed is all that is searched; other settings stay as they are. Without anything typed, the
space is that of the classifier (`own.search_space`).
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from echolearn.checks import check

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

GROUP = "classifier."
"""Beginning of the keys that can be searched."""


ENDS = ("low", "high")
"""Keys of an interval."""


def is_searched(override: "Override") -> bool:
    """Tell whether an override is a part of a search space."""
    return override.is_sweep_override() and override.key_or_group.startswith(GROUP)


def space_of(overrides: Sequence["Override"]) -> dict[str, Any]:
    """Return the search space that overrides type, as a YAML file would have it."""
    return {each.key_or_group.removeprefix(GROUP): _values(each) for each in overrides}


def _values(override: "Override") -> dict[str, Any]:
    sweep: Any = override.value()
    if not override.is_interval_sweep():
        return {"choices": list(override.sweep_iterator())}
    ends = {"low": sweep.start, "high": sweep.end}
    return ends | ({"log": True} if "log" in sweep.tags else {})


def fitted_to(space: Any, classifier: Mapping[str, Any]) -> Any:
    """Return a typed space whose intervals give what the classifier has at their keys.

    A whole number is searched where it has one, and a list of one number where it has a list.

    Raises:
        BadValue: ends that are no whole numbers, of a setting that is one.
    """
    if not isinstance(space, Mapping):
        return space
    fitted = {}
    for key, each in space.items():
        fitted[key] = each
        ends: list[Any] = [each.get(end) for end in ENDS] if isinstance(each, Mapping) else []
        # What is malformed is refused by whoever reads the space.
        if not all(isinstance(end, int | float) for end in ends) or not ends:
            continue
        value: Any = classifier
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        if isinstance(value, list):
            fitted[key] = {**each, "listed": True}
        elif isinstance(value, int) and not isinstance(value, bool):
            whole = all(float(end).is_integer() for end in ends)
            check(whole, f"{GROUP}{key}", ends, allowed="must be whole numbers")
            fitted[key] = {**each, **dict(zip(ENDS, map(int, ends), strict=True))}
    return fitted
