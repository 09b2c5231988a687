"""Recorded surveys as a comparison takes them: examined as `map` examines them, and mended.

What can be mended is mended and told, what cannot is refused with the line of `map`. Simulated
walks are sound as they were made, and published recordings that were imported as they are
(`protocol=none`) are judged as they are: nobody examines them.
"""

import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from echolearn.comparison.localized import is_measured
from echolearn.survey.examining import examine
from echolearn.survey.health import Health, mended
from echolearn.survey.reader import read_survey


def is_examined(folder: Path) -> bool:
    """Tell whether a survey's recordings are examined before they are judged."""
    return is_measured(folder) and read_survey(folder).conditions.get("protocol") != "none"


def health_of(folder: Path) -> Health:
    """Return what the recordings of a survey say about themselves.

    Raises:
        BadValue: they cannot be read, or `map` would refuse them.
    """
    survey = read_survey(folder)
    health = examine(survey)
    mended(survey, health)
    return health


def healths_of(folders: Iterable[Path], pool: ProcessPoolExecutor) -> dict[Path, Health]:
    """Return what recorded surveys say about themselves, by their folders, and tell it."""
    walked = [folder for folder in folders if is_examined(folder)]
    healths = dict(zip(walked, pool.map(health_of, walked), strict=True))
    for line in lines_of(healths.items()):
        print(line, file=sys.stderr, flush=True)
    return healths


def lines_of(healths: Iterable[tuple[Path, Health]]) -> list[str]:
    """Return what is to be said of recordings: what is mended, and what was noticed."""
    return [
        f"{folder.name}: {kind}: {line}"
        for folder, health in healths
        for kind, lines in (("mended", health.mended), ("noticed", health.noticed))
        for line in lines
    ]
