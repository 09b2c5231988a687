"""What the recordings of a growing walk say about themselves, and what is mended in them.

`map` examines all recordings before it judges one; here the last ones judge the next. Each of the
first `FIRST` is measured, then one in `EVERY`, which costs as much as localizing; the last `WINDOW`
that were measured are judged together, after the first `FIRST` less and less often. Where what is
mended is not the same in all of them, as where each recording begins at another time, every one is
measured, and takes what it needs itself.
"""

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from echolearn.checks import BadValue
from echolearn.survey.examining import concluded, stored
from echolearn.survey.growing import sharing
from echolearn.survey.health import Health, as_found
from echolearn.survey.measuring import Measured, measure_recording, walk_of
from echolearn.survey.mending import Mending
from echolearn.survey.survey import Survey

FIRST = 8
EVERY = 16
WINDOW = 16
"""Recordings that are all measured, of which one is later, and that are judged together."""

CONCLUDE = 64
"""Recordings after which the window is judged anew."""


@dataclass
class LiveHealth:
    """The health of the last recordings.

    Attributes:
        count: recordings that came.
        health: what the window says; None before the first.
        window: surveys of one pose each, with what was measured of them.
    """

    count: int = 0
    health: Health | None = None
    window: deque[tuple[Survey, Measured]] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def take(self, survey: Survey) -> Survey:
        """Return the survey of one pose as it should have been recorded.

        Raises:
            BadValue: the recording cannot be read.
        """
        if self.health is not None:
            survey = sharing(replace(survey, containers=self.health.containers), survey)
        changing = self.health is not None and not _steady(self.health.mending)
        if self.count < FIRST or changing or self.count % EVERY == 0:
            if self.health is None:
                survey = sharing(replace(survey, containers=stored(survey)), survey)
            self.window.append((survey, measure_recording(survey, 0)))
            if self.count < FIRST or changing or self.count % CONCLUDE == 0:
                self._conclude()
        self.count += 1
        return survey if self.health is None else as_mended(survey, self.health)

    def _conclude(self) -> None:
        """Judge the window."""
        surveys, rows = zip(*self.window, strict=True)
        # A recording of before that is gone by now leaves the health as it was.
        with suppress(BadValue):
            self.health = concluded(walk_of(_together(surveys), rows))


def _together(surveys: tuple[Survey, ...]) -> Survey:
    """Return surveys of one pose each as one."""
    last = surveys[-1]
    places = [each.loudspeakers for each in surveys if each.loudspeakers is not None]
    together = replace(
        last,
        poses=tuple(each.poses[0] for each in surveys),
        files=tuple(each.files[0] for each in surveys),
        numbers=tuple(each.numbers[0] for each in surveys),
        loudspeakers=np.concatenate(places) if places else None,
        further={},
    )
    return sharing(together, last)


def as_mended(survey: Survey, health: Health) -> Survey:
    """Return the survey of one pose, mended as the last recording that was judged."""
    mending = health.mending
    if mending is not None:
        mending = replace(
            mending,
            latency=mending.latency[-1:],
            sign=mending.sign[-1:],
            offset=mending.offset[-1:],
            tones=mending.tones[-1:],
        )
    return sharing(as_found(survey, replace(health, mending=mending)), survey)


def _steady(mending: Mending | None) -> bool:
    """Tell whether the same is mended in all recordings."""
    if mending is None:
        return True
    rows = (mending.latency, mending.sign, mending.offset)
    return all(bool((row == row[:1]).all()) for row in rows)
