"""How a bundle does on this machine: seconds per recording and per echo, and memory at its peak.

    python -m echolearn.bench.onboard runs/bundles/best runs/survey/8x6x5_0dB [joint ...]

loads the bundle as a robot does, takes the survey's recordings one at a time, observation in,
accepted points out, and prints one line of JSON. Localizers of other names than the bundle's take
its place in turns, in the bundle's window.
First the walk is taken once with each, a recording read when it is heard and then forgotten, as on
    a robot: the most
memory that the process has until then is what a robot needs. Then all recordings are read, so that
the seconds of the laps are without reading; they are those of one core if OMP_NUM_THREADS=1.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import Any

from echolearn.acoustics.types import Observation, Pose
from echolearn.checks import check
from echolearn.robot import bundle
from echolearn.robot.scorer import Scorer, load
from echolearn.runtime.timing import Contestant, race
from echolearn.survey import reader
from echolearn.survey.reader import Survey

LAPS = 15
"""How often the walk is taken."""

CLASSIFIER = "classifier"
"""What the model alone is called among the localizers."""


def measure(
    folder: Path,
    survey: Path,
    localizers: Sequence[str] = (),
    *,
    laps: int = LAPS,
    seconds: float = 1.5,
) -> dict[str, Any]:
    """Return the laps of a bundle on a survey, and the memory that it needs if this process has
    done nothing else.

    Args:
        folder: of the bundle.
        survey: in the recorded-survey format.
        localizers: by their names in a bundle, as `joint`; that of the bundle if there are
            none.
        laps: how often the walk is taken with each of them.
        seconds: after which no further lap begins.

    Returns:
        `laps`, for each localizer and for `classifier` a list of wall and CPU seconds per recording
        and per input; `memory` in bytes.
    """
    scorer, walk = load(folder), reader.read_survey(survey)
    names = [*localizers] or [scorer.bundle.about["localizer"]["name"]]
    scorers = {name: _with(scorer, name) for name in names}
    for pose in range(len(walk.poses)):
        for each in scorers.values():
            each.update(*_step(walk, pose))
    memory = peak_memory()
    steps = [_step(walk, pose) for pose in range(len(walk.poses))]
    contestants = {name: _streaming(each, steps) for name, each in scorers.items()}
    one = scorer.bundle.golden[0][:1]
    contestants[CLASSIFIER] = Contestant(lambda: scorer(one))
    return {"laps": race(contestants, laps=laps, seconds=seconds), "memory": memory}


def _step(walk: Survey, pose: int) -> tuple[Observation, Pose]:
    """Return the recording of a numbered pose, samples (M, N), and the pose."""
    heard = walk.observe([pose])
    return replace(heard, samples=heard.samples[0]), walk.poses[pose]


def _with(scorer: Scorer, name: str) -> Scorer:
    """Return a scorer with the localizer of that name; the bundle's own keeps its arguments."""
    about, window = scorer.bundle.about["localizer"], scorer.bundle.localizer.window
    if name == about["name"]:
        return scorer
    other = bundle.localizer_of(name=name, arguments={}, window=window)
    return replace(scorer, bundle=replace(scorer.bundle, localizer=other))


def _streaming(scorer: Scorer, steps: Sequence[tuple[Observation, Pose]]) -> Contestant:
    """Return a walk through recordings one at a time; a recording is a unit."""

    def walk() -> None:
        for observation, pose in steps:
            scorer.update(observation, pose)

    return Contestant(walk, units=len(steps))


def peak_memory() -> int:
    """Return the most memory that this process has had, in bytes."""
    status = Path("/proc/self/status")
    if status.is_file():  # getrusage remembers the process that started this one
        [line] = [line for line in status.read_text().splitlines() if line.startswith("VmHWM")]
        return int(line.split()[1]) << 10
    return getrusage(RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def main(words: Sequence[str]) -> None:
    """Measure what the command line names, and print it."""
    check(
        len(words) >= 2,
        "onboard",
        " ".join(words),
        allowed="python -m echolearn.bench.onboard <bundle> <survey>",
    )
    print(json.dumps(measure(Path(words[0]), Path(words[1]), words[2:])))


if __name__ == "__main__":
    main(sys.argv[1:])
