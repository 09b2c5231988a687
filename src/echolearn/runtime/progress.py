"""How far long work has come: a bar on a terminal, elsewhere a plain line now and then.

Both are written to stderr, so that stdout holds results alone.
"""

import sys
import time
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from typing import TypeVar

from echolearn.checks import printable

T = TypeVar("T")

PAUSE = 10.0
"""Seconds between plain lines."""


def track(
    items: Iterable[T], title: str, *, total: int | None = None, unit: str = "", done: int = 0
) -> Iterator[T]:
    """Yield the items, showing how many have been worked through.

    Args:
        items: what remains to be worked through; an item counts when the next one is asked for.
        title: what is being done.
        total: how many there are in all; needed where `items` has no length.
        unit: name of the items.
        done: number of them that were finished earlier.
    """
    total = done + len(items) if total is None else total  # type: ignore[arg-type]
    # It may hold the name of a stranger's folder.
    title = printable(title)
    show = _bar if sys.stderr.isatty() and find_spec("rich") else _lines
    return show(items, title, total=total, unit=unit, done=done)


def _bar(items: Iterable[T], title: str, *, total: int, unit: str, done: int) -> Iterator[T]:
    """Draw a bar that moves with every item.

    No thread redraws it, so that the process can be forked.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    with Progress(
        TextColumn(title),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        auto_refresh=False,
    ) as progress:
        task = progress.add_task(title, completed=done, total=total)
        progress.refresh()
        for item in items:
            yield item
            progress.advance(task)
            progress.refresh()


def _lines(items: Iterable[T], title: str, *, total: int, unit: str, done: int) -> Iterator[T]:
    """Write a line whenever `PAUSE` seconds have passed, and one at the end."""
    last = time.monotonic()
    for number, item in enumerate(items, done + 1):
        yield item
        if number == total or time.monotonic() - last >= PAUSE:
            last = time.monotonic()
            print(f"{title}: {number} of {total} {unit}".rstrip(), file=sys.stderr, flush=True)
