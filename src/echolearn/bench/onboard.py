"""How a bundle does on this machine: seconds per recording and per echo, and memory at its peak.

    python -m echolearn.bench.onboard runs/bundles/best runs/survey/8x6x5_0dB [joint ...]

loads the bundle as a robot does, takes the survey's recordings one at a time, observation in,
accepted points out, and prints one line of JSON. Localizers of other names than the bundle's take
its place in turns, in the bundle's window.

First the walk is taken once with each, a recording read when it is needed and then forgotten, as on
a robot: the most memory that the process has until then is what a robot needs. Then all recordings
are read, so that the seconds of the laps are without reading; they are those of one core if
OMP_NUM_THREADS=1.
"""

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from echolearn.acoustics.types import Observation, Pose
from echolearn.bench.memory import peak_memory
from echolearn.checks import check
from echolearn.robot import bundle
from echolearn.robot.scorer import Scorer, load
from echolearn.runtime.timing import Contestant, race
from echolearn.survey import reader

LAPS = 15
"""How often the walk is taken."""


def measure(
    folder: Path, survey: Path, *, localizers: Sequence[str] = (), laps: int = LAPS
) -> dict[str, Any]:
    """Return the laps of a bundle on a survey, and the memory that it needs.

    Args:
        folder: of the bundle.
        survey: in the recorded-survey format.
        localizers: by their names in a bundle, as `joint`; that of the bundle if there are
            none.
        laps: how often the walk is taken with each of them.

    Returns:
        `laps`, for each localizer and for `classifier` a list of wall and CPU seconds per recording
        and per input; `memory` in bytes, if this process has done nothing else.
    """
    scorer = load(folder)
    walk = reader.read_survey(survey)
    names = [*localizers] or [scorer.bundle.about["localizer"]["name"]]
    scorers = {name: _with(scorer, name) for name in names}

    def steps() -> Iterable[tuple[Observation, Pose]]:
        """Yield each recording with its pose, read when it is asked for."""
        for number, pose in enumerate(walk.poses):
            observation = walk.observe([number])
            yield replace(observation, samples=observation.samples[0]), pose

    # As on a robot: read, used, forgotten, so that the peak is what a robot needs.
    for step in steps():
        for each in scorers.values():
            each.update(*step)
    memory = peak_memory()

    # Now without reading, which is the disk's time and not the bundle's.
    recordings = list(steps())

    def take(each: Scorer) -> None:
        """Take the walk once."""
        for step in recordings:
            each.update(*step)

    contestants = {
        name: Contestant(partial(take, each), units=len(recordings))
        for name, each in scorers.items()
    }
    one = scorer.bundle.golden[0][:1]
    contestants["classifier"] = Contestant(lambda: scorer(one))
    return {"laps": race(contestants, laps=laps, seconds=1.5), "memory": memory}


def _with(scorer: Scorer, name: str) -> Scorer:
    """Return a scorer with the localizer of that name; the bundle's own keeps its arguments."""
    if name == scorer.bundle.about["localizer"]["name"]:
        return scorer
    window = scorer.bundle.localizer.window
    localizer = bundle.localizer_of(name=name, arguments={}, window=window)
    return replace(scorer, bundle=replace(scorer.bundle, localizer=localizer))


def main(words: Sequence[str]) -> None:
    """Measure what the command line names, and print it."""
    usage = "must be a bundle and a survey: python -m echolearn.bench.onboard <bundle> <survey>"
    check(len(words) >= 2, "onboard", " ".join(words), allowed=usage)
    print(json.dumps(measure(Path(words[0]), Path(words[1]), localizers=words[2:])))


if __name__ == "__main__":
    main(sys.argv[1:])
