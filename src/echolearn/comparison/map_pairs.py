"""The walks whose maps are shown before and after the chosen filter.

walks of the lowest and of the highest SNR of the tables --map_pairs--> `MapPair` of each room
"""

from collections.abc import Iterator

from echolearn.comparison.choice import Comparison, chosen
from echolearn.comparison.shown import MapPair
from echolearn.comparison.tables import levels, main_localizer, placed, unfiltered
from echolearn.evaluation.rows import pick
from echolearn.training.predictions import predict_echoes


def map_pairs(comparison: Comparison) -> list[MapPair]:
    """Return the walks of the lowest and the highest SNR of the tables, the lowest first."""
    known = levels(comparison)
    ends = list(dict.fromkeys([*known[:1], *known[-1:]]))
    return [pair for level in ends for pair in _pairs_at(comparison, level)]


def _pairs_at(comparison: Comparison, snr_db: str) -> Iterator[MapPair]:
    """Return every room's walk at an SNR and what the chosen model's first seed keeps of it."""
    localizer = main_localizer(comparison)
    rows = placed(pick(comparison.rows, seed=""), comparison.surveys.values())
    for row in pick(unfiltered(rows), localizer=localizer, snr_db=snr_db):
        survey = comparison.surveys[row["tested_on"], localizer]
        kept = predict_echoes(comparison.models[chosen(comparison)][0], survey).kept
        yield MapPair(f"{row['place']} m, SNR {snr_db} dB", snr_db, survey, kept)
