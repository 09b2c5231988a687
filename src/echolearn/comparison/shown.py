"""What a page and its figures show of a comparison: pairs of maps, conditions for the dot plot."""

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.choice import Comparison, chosen, headline
from echolearn.comparison.tables import levels, main_localizer, placed, unfiltered
from echolearn.comparison.template import share_on_walls
from echolearn.evaluation.rows import LocalizedSurvey, Row, distinct, pick
from echolearn.training.predictions import predict_echoes

MAP_METRIC = "balanced accuracy of the map"


class MapPair(NamedTuple):
    """A walk, and which of its points the chosen model's first seed keeps, shape (P,), bool."""

    title: str
    survey: LocalizedSurvey
    kept: Array

    @property
    def told(self) -> tuple[str, str]:
        """How many points lie on a wall before and after."""
        true = self.survey.labelled.reference
        return share_on_walls(true, self.kept | True), share_on_walls(true, self.kept)


def map_pairs(comparison: Comparison) -> list[MapPair]:
    """Return the walks of the lowest and the highest SNR of the tables, the lowest first."""
    known = levels(comparison)
    shown = list(dict.fromkeys([*known[:1], *known[-1:]]))
    rows = placed(pick(comparison.rows, seed=""), comparison.surveys.values())
    return [pair for level in shown for pair in pairs_at(comparison, rows, snr_db=level)]


def pairs_at(comparison: Comparison, rows: Sequence[Row], *, snr_db: str) -> list[MapPair]:
    """Return every room's walk at an SNR and what the chosen model's first seed keeps of it.

    Args:
        comparison: what was found.
        rows: means over seeds, with places.
        snr_db: SNR of the surveys.
    """
    localizer = main_localizer(comparison)
    walks = []
    for row in pick(unfiltered(rows), localizer=localizer, snr_db=snr_db):
        survey = comparison.surveys[row["tested_on"], localizer]
        kept = predict_echoes(comparison.models[chosen(comparison)][0], survey).kept
        walks.append(MapPair(f"{row['place']} m, SNR {snr_db} dB", survey, kept))
    return walks


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
