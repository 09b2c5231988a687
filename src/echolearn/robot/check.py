"""`check`: what a recorded survey says about itself, before anything is trusted.

    survey --examine--> Health --> one screen of text, and runs/check/<name>/check.html

The page shows the waterfall besides (`waterfall.py`). Everything is measured anew each time, since
whoever asks stands beside the robot and has changed something.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.checks import BadValue, check, check_name
from echolearn.robot.check_facts import HEADINGS, UNSEEN, Facts, survey_facts
from echolearn.robot.check_page import page_of
from echolearn.robot.choices import OF_THE_SURVEY, open_survey, with_gains
from echolearn.robot.waterfall import waterfall
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.once import locked
from echolearn.survey.examining import examine
from echolearn.survey.health import mended
from echolearn.survey.proof import read_proved
from echolearn.survey.survey import Survey

PAGE = "check.html"

ROWS = 12
"""Microphones that the terminal shows."""


def check_survey(
    *,
    survey: Path,
    runs: Path,
    bundle: Path | None = None,
    name: str | None = None,
    resample: bool = False,
    direct: str | None = None,
    played: str | None = None,
    without: Sequence[int] | None = None,
    gains: Sequence[float] | None = None,
    command: str | None = None,
) -> Path:
    """Examine a recorded survey, print what there is to say, and return the page.

    Args:
        survey: folder in the recorded-survey format.
        runs: folder of everything generated; the page goes to `runs/check`.
        bundle: folder of the bundle that shall map it: whether they fit is told, and its search
            window is drawn; None draws that of walls 1 to 2 m away.
        name: name of the page's folder; that of the survey's unless given.
        resample, direct, played, without, gains: as for `map_survey`.
        command: what makes the page again; None says nothing about it.

    Raises:
        BadValue: a survey that cannot be read; or, the page written, one that `map` would refuse.
    """
    hint = "a path is no name" if name else OF_THE_SURVEY
    name = name or Path(survey).resolve().name
    check_name("name", name, hint=hint)
    folder = Path(runs) / "check" / name
    _check_free(folder)
    walk, _ = read_proved(Path(survey))
    walk = with_gains(walk, None, without=without, gains=gains)
    walk, unfit = _fit(walk, bundle, resample=resample, direct=direct, played=played)
    health = examine(walk)
    sound = not (unfit or health.refused)
    domain = _domain(bundle, mended(walk, health), resample=resample) if sound else None
    facts = survey_facts(walk, health, refused=unfit, domain=domain)
    fall = waterfall(walk, health, window=walk.window)
    content = page_of(walk, health, facts=facts, fall=fall)
    about = {"kind": "check", "verdict": facts.verdict} | manifests.command_entry(command)
    _write(folder, content, about=about)
    print("\n".join(screen(facts)))
    if health.refused or unfit:
        print(folder / PAGE, flush=True)
        raise _refusal(survey, health.refused, unfit=unfit)
    return folder / PAGE


def _refusal(survey: Path, refused: Sequence[str], *, unfit: Sequence[str]) -> BadValue:
    """Return what to raise about a survey that `map` would refuse.

    Args:
        survey: its folder.
        refused: what its recordings say.
        unfit: why the bundle does not take it.
    """
    first, *others = [*refused, *unfit]
    # What is wrong with a survey or its files begins with its folder, as this line does.
    first = first.removeprefix(f"{survey}: ").removeprefix(f"{survey}/")
    more = f" (and {len(others)} more)" if others else ""
    alone = "" if refused else "; bundle=null asks about the recordings alone"
    return BadValue(f"{survey}: map would refuse it: {first}{more}{alone}")


def _fit(
    walk: Survey,
    bundle: Path | None,
    *,
    resample: bool,
    direct: str | None,
    played: str | None,
) -> tuple[Survey, list[str]]:
    """Return a survey as a bundle would take it, and why it does not fit, if so.

    Args:
        walk: what was recorded.
        bundle: folder of the bundle; every survey fits None.
        resample, direct, played: as for `map_survey`.
    """
    if bundle is None:
        return walk, []
    # Only who names a bundle needs what reads its model.
    from echolearn.robot.bundle import read_bundle

    found = read_bundle(Path(bundle))
    left_out = [] if walk.gains is None else (np.flatnonzero(walk.gains == 0) + 1).tolist()
    walk = replace(walk, window=found.localizer.window)
    try:
        opened = open_survey(walk.folder, found, resample=resample, direct=direct, played=played)
        with_gains(walk, found, without=left_out or None)
    except BadValue as error:
        return walk, [str(error)]
    return replace(walk, direct=opened.direct, played=opened.played), []


def _domain(bundle: Path | None, walk: Survey, *, resample: bool) -> str | None:
    """Return what there is to say of a survey beside those that a bundle knows.

    Args:
        bundle: its folder; None knows nothing.
        walk: the survey, mended; it fits the bundle.
        resample: bring recordings of another sample rate to the bundle's.
    """
    if bundle is None:
        return None
    from echolearn.robot.bundle import read_bundle
    from echolearn.robot.domain import domain_line

    found = read_bundle(Path(bundle))
    return domain_line(found, replace(walk, rate=found.probe.sample_rate if resample else None))


def _write(folder: Path, content: bytes, *, about: Mapping[str, Any]) -> None:
    """Write the page, in place of the one before, and then its manifest."""
    with locked(folder):
        clean(folder)
        write_atomic(folder / PAGE, content)
        manifests.finish(folder, about, files=[PAGE])


def _check_free(folder: Path) -> None:
    """Raise `BadValue` if something else than a page of `check` is there."""
    names = {path.name for path in folder.glob("[!.]*")} if folder.is_dir() else set()
    foreign = (names and PAGE not in names) or (folder.exists() and not folder.is_dir())
    allowed = "must be a new name, or that of a check"
    check(not foreign, "name", folder.name, allowed=allowed, hint=f"{folder} is something else")


def screen(facts: Facts) -> list[str]:
    """Return what the terminal shows, as lines."""
    lines = [facts.verdict, facts.because]
    lines += [f"{kind}: {line}" for _, kind, line in facts.lines]
    lines += ["", *_table([HEADINGS, *_shown(facts)])]
    lines += ["", *(f"{name:18}{value:>14}  {remark}" for name, value, remark in facts.figures)]
    return [*lines, UNSEEN]


def _shown(facts: Facts) -> list[Sequence[str]]:
    """Return the rows of some microphones, those with something to say first."""
    ordered = sorted(facts.channels, key=lambda channel: channel[0] == "fine")
    return [row for _, row in ordered[:ROWS]]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of texts as lines, their columns aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
