"""How far long work has come: a bar on a terminal, a plain line now and then elsewhere; always on stderr."""

import sys
import time
from collections.abc import Iterator, Sequence
from typing import TypeVar


T = TypeVar("T")

PAUSE = 10.0
"""Seconds between plain lines."""


def track(items: Sequence[T], title: str, *, unit: str = "", done: int = 0) -> Iterator[T]:
    """Yield the items, showing how many have been worked through.

    Args:
        items: what remains to be worked through; an item counts when the next one is asked for.
        title: what is being done.
        unit: what the items are called.
        done: how many more were finished earlier.
    """
    show = bar if sys.stderr.isatty() else lines
    return show(items, title, unit=unit, done=done)


def bar(items: Sequence[T], title: str, *, unit: str, done: int) -> Iterator[T]:
    """Draw a bar that moves."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TextColumn(unit), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(title, completed=done, total=done + len(items))
        for item in items:
            yield item
            progress.advance(task)


def lines(items: Sequence[T], title: str, *, unit: str, done: int) -> Iterator[T]:
    """Write a line at the first item, every `PAUSE` seconds, and at the end."""
    total, last = done + len(items), -PAUSE
    for number, item in enumerate(items, done):
        if time.monotonic() - last >= PAUSE:
            last = time.monotonic()
            print(f"{title}: {number} of {total} {unit}".rstrip(), file=sys.stderr, flush=True)
        yield item
    if items:
        print(f"{title}: {total} of {total} {unit}".rstrip(), file=sys.stderr, flush=True)
