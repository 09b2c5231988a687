"""What a page and its figures show of a comparison: answers, pairs of maps, the dot plot.

The first two ask runs for predictions again (`answer`, `map_pairs`); who shows them is given them
and needs no run.
"""

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.choice import Comparison, headline
from echolearn.comparison.tables import levels, main_localizer, placed
from echolearn.comparison.template import share_on_walls, verdict
from echolearn.evaluation.rows import LocalizedSurvey, Row, distinct, pick

MAP_METRIC = "balanced accuracy of the map"

ANSWER_COLUMNS = (
    "place snr_db metric classifier value ci_low ci_high"
    " against against_value difference difference_low difference_high verdict n"
).split()
"""Columns of `answer.csv`."""


class MapPair(NamedTuple):
    """A walk, and which of its points the chosen model's first seed keeps.

    Attributes:
        title: place and SNR.
        snr_db: SNR, as the tables name it.
        survey: the walk.
        kept: which points, shape (P,), bool.
    """

    title: str
    snr_db: str
    survey: LocalizedSurvey
    kept: Array

    @property
    def told(self) -> tuple[str, str]:
        """How many points lie on a wall before and after."""
        true = self.survey.labelled.reference
        return share_on_walls(true, self.kept | True), share_on_walls(true, self.kept)


class Answer(NamedTuple):
    """The chosen filter in one place, and by how much it differs from others there.

    Attributes:
        title: place and SNR, as a heading.
        place: room of the maps, group of recorded surveys, or set.
        row: its row of `results.csv`, the mean over seeds.
        rivals: figure and paired difference of the best yardstick, then of the bare threshold
            unless that is the best; none where there is nothing to test against.
    """

    title: str
    place: str
    row: Row
    rivals: list[tuple[Row, Row]]


class Shown(NamedTuple):
    """What runs were asked again for, to be shown.

    Attributes:
        answers: what the first screen says.
        pairs: maps before and after, those of the lowest SNR first.
    """

    answers: Sequence[Answer] = ()
    pairs: Sequence[MapPair] = ()


def answer_rows(found: Sequence[Answer]) -> list[Row]:
    """Return the rows of `answer.csv`; what is beside nobody has one, too."""
    rows = []
    for answer in found:
        shown = {key: answer.row[key] for key in ANSWER_COLUMNS[1:7]} | {"place": answer.place}
        for other, test in answer.rivals or [({"classifier": "", "value": ""}, {})]:
            beside = {"against": other["classifier"], "against_value": other["value"]}
            ends = dict.fromkeys(ANSWER_COLUMNS[9:], "")
            if test:
                low, high = test["ci_low"], test["ci_high"]
                ends = {"difference": test["difference"], "difference_low": low}
                ends |= {"difference_high": high, "verdict": verdict(test), "n": test["n"]}
            rows.append(shown | beside | ends)
    return rows


class DotPanel(NamedTuple):
    """A place in which classifiers are compared: a panel of the dot plot.

    Attributes:
        title: of the panel.
        metric: what is shown, in words.
        rows: rows of results.csv, one for each classifier of the headline's training.
    """

    title: str
    metric: str
    rows: list[Row]


def conditions(comparison: Comparison) -> list[DotPanel]:
    """Return the maps by SNR, measured sound, and the sets, each with everybody's figure."""
    # Bundles, which may be of the same training, have no rank by validation.
    own = {"training": headline(comparison), "role": ("learned", "baseline")}
    rows = [row for row in pick(comparison.rows, seed="", **own) if np.isfinite(row["value"])]
    maps = placed(
        pick(rows, kind="survey", metric="balanced_accuracy"), comparison.surveys.values()
    )
    maps = pick(maps, localizer=main_localizer(comparison), snr_db=tuple(levels(comparison)))
    every = [
        row | {"cell": f"{row['place']}, SNR {row['snr_db']} dB", "shown": MAP_METRIC}
        for row in sorted(maps, key=lambda row: float(row["snr_db"]))
    ]
    whole = pick(rows, snr_db="", kind=("set", "measured"), metric=("auc", "time_auc"))
    for row in sorted(whole, key=itemgetter("kind")):
        timed = comparison.measured.get((row["tested_on"], row["localizer"]))
        wanted = "time_auc" if timed and timed.label == "reflector" else "auc"
        if row["metric"] == wanted and row["localizer"] in ("", main_localizer(comparison)):
            title = f"measured: {row['tested_on']}" if timed else row["tested_on"]
            every.append(row | {"cell": title, "shown": "AUC"})
    titles = distinct(every, "cell")
    parts = {title: pick(every, cell=title) for title in titles}
    return [DotPanel(title, part[0]["shown"], part) for title, part in parts.items()]
