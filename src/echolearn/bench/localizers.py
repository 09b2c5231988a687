"""Localizers: every one in `conf/localizer`, in batches and one observation at a time, beside its
equations in loops.

The peer is `literal`: what the paper prints, loop by loop, for one observation. EM-MC with one echo
    repeats the same
search in each iteration; its peer is charged for one. The paper's own times, MATLAB on another
machine, are named for scale only.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.types import Array, Observation
from echolearn.bench import equations as literal
from echolearn.bench.measurement import Measurement, Setting, heard, times
from echolearn.localization.beamforming import Mpdr, azimuth_grid
from echolearn.localization.localizer import Localizer
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant

STAGE = "localize"
PAPER = {"peaks": 0.0063, "em": 63.25, "mclam": 60.65, "snls": 10.14}
"""Seconds per observation as the paper prints them, by method."""

Literal = Callable[[Array, Any], object]


def localizers(setting: Setting) -> Iterator[Measurement]:
    """Time every localizer per observation, beside its literal form, and over microphones and
    azimuths.
    """
    whole = heard(setting.plan, setting.batch)
    some = min(setting.batch, 16)
    scenes = {
        m: replace(setting.plan.scene, array=circular_array(microphones=m))
        for m in setting.microphones
    }
    rings = {m: heard(setting.plan, some, scene) for m, scene in scenes.items()}
    yield from parts(setting, whole)
    for name, localizer in track(
        list(setting.localizers.items()), "bench localize", unit="localizers"
    ):
        one = {f"{name}, one at a time": batch(localizer, first(whole, 1))}
        contestants = (
            {name: batch(localizer, whole)} | one | {f"{name}, literal": loops(localizer, whole)}
        )
        laps = setting.race({key: value for key, value in contestants.items() if value})
        yield from times(STAGE, laps, reference=name, parameter="batch", value=setting.batch)
        yield from printed(name, [lap.wall for lap in laps[name]], value=setting.batch)
        yield from over(
            setting, name, "microphones", {m: batch(localizer, ring) for m, ring in rings.items()}
        )
        grids = {
            a: batch(grid, first(whole, some))
            for a, grid in finer(localizer, setting.azimuths).items()
        }
        yield from over(setting, name, "azimuths", grids)


def printed(name: str, own: Sequence[float], *, value: int) -> Iterator[Measurement]:
    """Yield the time that the paper prints for a localizer, if any, beside the localizer's own
    laps, s.
    """
    method = name.partition("_")[0]
    if method in PAPER:
        about = (STAGE, f"{name}, as the paper prints", "batch", value, "wall", "s")
        yield Measurement(*about, [PAPER[method]] * len(own), reference=name, beside=own)


def parts(setting: Setting, whole: Observation) -> Iterator[Measurement]:
    """Time the paper's two searches one by one, per observation, beside their literal forms."""
    window, equations = setting.plan.window, Equations(setting.plan, first(whole, 1))
    searches: dict[str, tuple[Callable[[], object], Callable[[Equations], object]]] = {
        "S-NLS, time only": (lambda: MatchedFilter(whole, window).strongest, earliest),
        "SRP-MPDR, direction only": (lambda: Mpdr()(whole), loudest),
    }
    for name, (search, work) in searches.items():
        own = Contestant(search, units=len(whole.samples))
        laps = setting.race(
            {name: own, f"{name}, literal": Contestant(partial(work, equations), warm=False)}
        )
        yield from times(STAGE, laps, reference=name, parameter="batch", value=setting.batch)


def over(
    setting: Setting, name: str, parameter: str, contestants: dict[int, Contestant]
) -> Iterator[Measurement]:
    """Time a localizer at several values of a parameter, in turns."""
    for value, laps in setting.race({str(key): one for key, one in contestants.items()}).items():
        yield from times(STAGE, {name: laps}, parameter=parameter, value=int(value))


def batch(localizer: Localizer, observation: Observation) -> Contestant:
    """Return a localizer at work on observations (B, M, N); an observation is a unit."""
    return Contestant(lambda: localizer(observation), units=len(observation.samples))


def first(observation: Observation, count: int) -> Observation:
    """Return the first `count` of observations (B, M, N)."""
    return replace(observation, samples=observation.samples[:count])


def finer(localizer: Any, azimuths: Sequence[int]) -> dict[int, Localizer]:
    """Return a localizer on several azimuth grids, if it has one."""
    return (
        {a: replace(localizer, azimuths=a) for a in azimuths}
        if hasattr(localizer, "azimuths")
        else {}
    )


def method(localizer: Localizer) -> str:
    """Return the name of the method behind a localizer: that of its module."""
    return type(localizer).__module__.rpartition(".")[2]


def loops(localizer: Localizer, observation: Observation) -> Contestant | None:
    """Return the literal form of a localizer at work on one observation, or None if there is none."""
    known = {"snls": snls, "gated": gated, "joint": joint, "em": em, "mclam": mclam, "peaks": peaks}
    work = known.get(method(localizer))
    equations = Equations(localizer, first(observation, 1))
    return None if work is None else Contestant(partial(work, equations), warm=False)


class Equations:
    """What the literal functions need to know of a localizer (or whatever has a window) and its one
    observation.
    """

    def __init__(self, localizer: Any, observation: Observation) -> None:
        rate, self.loading = observation.probe.sample_rate, getattr(localizer, "loading", 0.0)
        limits = localizer.window.lags(
            observation.array, rate, speed_of_sound=observation.speed_of_sound
        )
        self.recording, self.burst = observation.samples[0], observation.probe.samples
        self.positions, self.azimuths = (
            observation.array.positions,
            azimuth_grid(getattr(localizer, "azimuths", 180)),
        )
        self.rate, self.lags = rate, dict(zip(("first", "last"), limits, strict=True))
        self.microphones = (self.recording, self.burst, self.positions, self.azimuths)


def earliest(e: Equations) -> int:
    """Run S-NLS, and return its lag."""
    return literal.snls(e.recording[0], e.burst, **e.lags)[0]


def loudest(e: Equations) -> None:
    """Run whole-recording SRP-MPDR."""
    literal.mpdr(e.recording, e.positions, e.azimuths, rate=e.rate)


def snls(e: Equations) -> None:
    """Run S-NLS and whole-recording SRP-MPDR."""
    earliest(e)
    loudest(e)


def gated(e: Equations) -> None:
    """Run S-NLS and the echo-gated direction."""
    literal.gated(*e.microphones, lag=earliest(e), rate=e.rate)


def joint(e: Equations) -> None:
    """Run the search over times and directions."""
    literal.joint(*e.microphones, **e.lags, rate=e.rate)


def em(e: Equations) -> None:
    """Run one iteration of EM-MC."""
    literal.em(*e.microphones, **e.lags, rate=e.rate, iterations=1)


def mclam(e: Equations) -> None:
    """Run McLAM."""
    literal.mclam(*e.microphones, **e.lags, rate=e.rate)


def peaks(e: Equations) -> None:
    """Run RIR peak picking, and whole-recording SRP-MPDR for the direction."""
    literal.peaks(e.recording[0], e.burst, **e.lags, loading=e.loading)
    loudest(e)
