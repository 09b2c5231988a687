"""What a configuration may call: whatever makes a thing of the kind that its place is for.

    _target_ --import--> class or function --same kind as its place?--> called --again?--> value

`KINDS` names the kind of each place: a class, a choice of classes, or a Protocol, of which a class
needs every method, with arguments that can be given as the Protocol has them. A function must say
by its annotation what it returns. So a target may be of anybody's package, but `os.system` is no
classifier and is refused before it is called. Targets come from the command line and the files of
`conf/` alone: what is read from sets, runs, surveys and bundles has short names.
"""

import inspect
from collections.abc import Callable
from importlib import import_module
from typing import Any, get_args, get_type_hints

from echolearn.checks import BadValue, check

TARGET = "_target_"

KINDS = {
    "array": "echolearn.acoustics.types.MicArray",
    "classifier": "echolearn.classifiers.classifier.Classifier",
    "diffuse": "echolearn.acoustics.types.Noise",
    "diffuse.source": "echolearn.simulation.noise.diffuse.Source",
    "engine": "echolearn.runtime.engine.Engine",
    "estimator": "sklearn.base.BaseEstimator",
    "growing": "echolearn.dataset.plans.Plan",
    "localizer": "echolearn.localization.localizer.Localizer",
    "logger": "lightning.pytorch.loggers.Logger",
    "loudspeaker": "echolearn.acoustics.types.Probe",
    "net": "echolearn.classifiers.architectures.Recipe",
    "noise": "echolearn.acoustics.types.Noise",
    "plan": "echolearn.dataset.generate.AnyPlan",
    "probe": "echolearn.acoustics.types.Probe",
    "realism": "echolearn.simulation.realism.Realism",
    "realistic": "echolearn.simulation.realism.Realism",
    "rir": "echolearn.simulation.scene.Responder",
    "room": "echolearn.acoustics.polygon_room.AnyRoom",
    "scene": "echolearn.simulation.scene.Scene",
    "source": "echolearn.survey.measured.MeasuredSource",
    "window": "echolearn.acoustics.geometry.SearchWindow",
}
"""Kind of what stands at a place, by the last part of its dotted name."""


def find(target: object, name: str) -> Callable[..., Any]:
    """Return the class or function of a dotted name that makes what its place is for.

    Args:
        target: dotted name.
        name: dotted name of the place in the configuration.

    Raises:
        BadValue: there is none, or it is of another kind.
    """
    kinds = _kinds_of(name)
    function = imported(target, name)
    made = function if inspect.isclass(function) else _returned(function)
    _check_kind(_is_kind(made, kinds), target, name=name)
    return function


def check_made(value: object, target: object, *, name: str) -> None:
    """Raise `BadValue` unless what a target has made is of its place's kind, to its attributes.

    Args:
        value: what was made.
        target: dotted name of what has made it.
        name: dotted name of the place in the configuration.
    """
    kinds = _kinds_of(name)
    kind = kinds[0]
    if _is_protocol(kind):
        names = [*vars(kind), *kind.__annotations__]
        whole = all(hasattr(value, key) for key in names if not key.startswith("_"))
    else:
        whole = isinstance(value, kinds)
    _check_kind(whole, target, name=name)


def _check_kind(fits: bool, target: object, *, name: str) -> None:
    """Refuse a target in one line unless it fits its place."""
    allowed = f"must be a class like {KINDS[_place(name)]}, or a function that says it returns one"
    check(fits, f"{name}.{TARGET}", target, allowed=allowed, hint="this is none")


def imported(target: object, name: str) -> Callable[..., Any]:
    """Return the class or function of a dotted name: imported, not sought within other objects.

    Raises:
        BadValue: there is none.
    """
    module, _, leaf = str(target).rpartition(".")
    place = f"{name}.{TARGET}"
    allowed = "must be the dotted name of a class or a function"
    try:
        found = getattr(import_module(module), leaf)
    except (ImportError, AttributeError, ValueError) as error:
        raise BadValue(f"{place}={target!s:.200}: {allowed}; {error}") from None
    check(callable(found), place, target, allowed=allowed)
    return found


def _place(name: str) -> str:
    """Return which place a dotted name is; of several, each has a name of its own."""
    *before, last = name.split(".")
    for many, one in (("localizers", "localizer"), ("scenes", "scene"), ("members", "classifier")):
        if before[-1:] == [many]:
            return one
    # What a field of noise consists of, and who has measured, share a name.
    return f"diffuse.{last}" if [*before[-1:], last] == ["diffuse", "source"] else last


def _kinds_of(name: str) -> tuple[type, ...]:
    """Return the kind of a place, as a choice of classes, or one Protocol."""
    place = _place(name)
    allowed = f"must not be here, but where there is one of {', '.join(KINDS)}"
    check(place in KINDS, name, TARGET, allowed=allowed)
    module, _, leaf = KINDS[place].rpartition(".")
    kind = getattr(import_module(module), leaf)
    return get_args(kind) or (kind,)


def _returned(function: Callable[..., Any]) -> Any:
    """Return what a function says it returns, or None."""
    try:
        return get_type_hints(function).get("return")
    except (TypeError, NameError):
        return None


def _is_kind(made: Any, kinds: tuple[type, ...]) -> bool:
    """Tell whether instances of a class will be of a kind, as far as that shows beforehand."""
    if not inspect.isclass(made):
        return False
    if not _is_protocol(kinds[0]):
        return issubclass(made, kinds)
    members = vars(kinds[0]).items()
    return all(
        _takes(made, name, wanted=method) for name, method in members if _is_method(name, method)
    )


def _is_protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))


def _is_method(name: str, member: object) -> bool:
    """Tell whether a member of a Protocol is a method that it asks for."""
    return inspect.isfunction(member) and (name == "__call__" or not name.startswith("_"))


def _takes(made: type, name: str, *, wanted: Callable[..., Any]) -> bool:
    """Tell whether a class has a method that can be called as another one."""
    # A class can be called itself, which says nothing of its instances.
    found = next((vars(base)[name] for base in made.__mro__ if name in vars(base)), None)
    parameters = inspect.signature(wanted).parameters.values()
    named = [each.name for each in parameters if each.kind is each.KEYWORD_ONLY]
    try:
        signature = inspect.signature(found)  # type: ignore[arg-type]
        signature.bind(*[None] * (len(parameters) - len(named)), **dict.fromkeys(named))
    except (TypeError, ValueError):
        return False
    return True
