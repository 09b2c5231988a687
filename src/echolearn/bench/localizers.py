"""Localizers: each in batches and one observation at a time, beside its equations in loops.

The peer is `literal`: what the paper prints, loop by loop, for one observation. EM-MC with one echo
repeats the same search in each iteration; its peer is charged for one. The paper's own times,
MATLAB on another machine, are named for scale only. Matched filters and the steered response, which
all of them share, are timed by torch, too, on a GPU where there is one.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Observation
from echolearn.bench import equations
from echolearn.bench.measurement import Measurement, Setting, observations
from echolearn.dataset.torch_filters import filters_of
from echolearn.localization.beamforming import Mpdr, azimuth_grid
from echolearn.localization.localizer import Localizer
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant, ratios
from echolearn.simulation.torch_device import cuda_is_there
from echolearn.storage.identity import kind_of

PAPER = {"peaks": 0.0063, "em": 63.25, "mclam": 60.65, "snls": 10.14}
"""Seconds per observation as the paper prints them (V-B), by method."""


def time_localizers(setting: Setting) -> Iterator[Measurement]:
    """Time every localizer beside its literal form, and over microphones and azimuths."""
    observation = observations(setting.plan, setting.batch)
    # Growth needs many times, none of them exact: fewer observations will do.
    few = min(setting.batch, 16)
    rings = {
        count: observations(setting.plan, few, scene=scene)
        for count, scene in setting.rings.items()
    }
    about = {"parameter": "batch", "value": setting.batch}
    for count in sorted({1, min(8, setting.batch), setting.batch}):
        some = replace(observation, samples=observation.samples[:count])
        engines = filtering(some, setting.plan.window)
        yield from setting.compare("localize", engines, parameter="batch", value=count)
    # The paper times its two searches together; apart they show which of them costs.
    forms = literal(setting.plan, observation)
    for name, search in searches(setting, observation).items():
        contestants = {name: search, f"{name}, literal": forms[name]}
        yield from setting.compare("localize", contestants, **about)
    for name, localizer in track(list(setting.localizers.items()), "bench localize"):
        contestants = {
            name: at_work(localizer, observation),
            f"{name}, one at a time": at_work(localizer, observation, count=1),
        }
        forms = literal(localizer, observation)
        if kind_of(localizer) in forms:
            contestants[f"{name}, literal"] = forms[kind_of(localizer)]
        found = setting.compare("localize", contestants, **about)
        yield from found
        yield from as_printed(name, found[0].repetitions, value=setting.batch)
        by_ring = {count: at_work(localizer, ring) for count, ring in rings.items()}
        yield from setting.grow("localize", name, parameter="microphones", contestants=by_ring)
        by_grid = {
            count: at_work(finer, observation, count=few)
            for count, finer in on_grids(localizer, setting.azimuths).items()
        }
        yield from setting.grow("localize", name, parameter="azimuths", contestants=by_grid)


def filtering(observation: Observation, window: SearchWindow) -> dict[str, Contestant]:
    """Return matched filters and steered response at work, compiled and by torch."""
    engines = {"matched filters and J": "compiled", "torch on the CPU": "cpu"}
    if cuda_is_there():
        engines["torch on the GPU"] = "cuda"

    def steered(name: str) -> object:
        """Compute both, as a view does once for all."""
        return MatchedFilter(observation, window, filters=filters_of(name)).steered

    units = len(observation.samples)
    return {said: Contestant(partial(steered, name), units) for said, name in engines.items()}


def searches(setting: Setting, observation: Observation) -> dict[str, Contestant]:
    """Return the paper's two searches at work, each by itself."""
    window = setting.plan.window
    units = len(observation.samples)
    return {
        "S-NLS, time only": Contestant(lambda: MatchedFilter(observation, window).strongest, units),
        "SRP-MPDR, direction only": Contestant(lambda: Mpdr()(observation), units),
    }


def as_printed(name: str, own: Sequence[float], *, value: int) -> Iterator[Measurement]:
    """Yield the time that the paper prints for a localizer, if any, beside the localizer's own.

    Args:
        name: of the localizer.
        own: its wall times, s.
        value: its batch.
    """
    seconds = PAPER.get(name.partition("_")[0])
    if seconds is not None:
        about = ("localize", f"{name}, as the paper prints", "batch", value, "wall", "s")
        printed = [seconds] * len(own)
        yield Measurement(*about, printed, reference=name, ratio=ratios(printed, own))


def at_work(
    localizer: Localizer, observation: Observation, *, count: int | None = None
) -> Contestant:
    """Return a localizer at work.

    Args:
        localizer: any.
        observation: samples (B, M, N).
        count: how many of them, the first; all unless given.
    """
    some = replace(observation, samples=observation.samples[:count])
    return Contestant(lambda: localizer(some), units=len(some.samples))


def on_grids(localizer: Any, azimuths: Sequence[int]) -> dict[int, Localizer]:
    """Return a localizer on several azimuth grids, by their size; none if it has no grid."""
    if not hasattr(localizer, "azimuths"):
        return {}
    return {count: replace(localizer, azimuths=count) for count in azimuths}


def literal(localizer: Any, observation: Observation) -> dict[str, Contestant]:
    """Return the literal forms at work on the first of observations (B, M, N).

    They go by the short names of localizers and the names of the paper's searches. A localizer, or
    whatever has a search window, gives that and, where it has them, azimuths and loading.
    """
    array = observation.array
    rate = observation.probe.sample_rate
    first, last = localizer.window.lags(array, rate, speed_of_sound=observation.speed_of_sound)
    known = equations.Recording(
        observation.samples[0],
        observation.probe.samples,
        array.positions,
        azimuth_grid(getattr(localizer, "azimuths", 180)),
        first,
        last,
        rate,
    )
    loading = getattr(localizer, "loading", 0.0)
    forms: dict[str, Callable[[Any], object]] = {
        "S-NLS, time only": equations.snls,
        "SRP-MPDR, direction only": equations.mpdr,
        "snls": lambda each: (equations.snls(each), equations.mpdr(each)),
        "gated": lambda each: equations.gated(each, equations.snls(each)[0]),
        "joint": equations.joint,
        # With one echo, an iteration of EM-MC is the joint search.
        "em": equations.joint,
        "mclam": equations.mclam,
        "peaks": lambda each: (equations.peaks(each, loading), equations.mpdr(each)),
    }
    return {name: Contestant(partial(form, known), warm=False) for name, form in forms.items()}
