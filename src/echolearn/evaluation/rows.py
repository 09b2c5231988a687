"""What is evaluated, and the tidy table that comes of it.

    LabelledRows (what is true) + Predictions (what a model believes) -> rows of `results.csv`

A row is a dictionary from column to cell. Whatever a row is about stands in a column of its own,
here the fields of `Model` and `Recordings`, so that no name need be taken apart.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.evaluation import coverage, metrics

SNR_BANDS_DB = ((-40, -20), (-20, -15), (-15, -10), (-10, -5), (-5, 40))
"""dB, from and to; classifiers differ between -20 and -5 dB only."""

OTHER_ARRAY = "other_array"
OTHER_RATE = "other_rate"
OTHER_LOCALIZER = "other_localizer"
MISSING_COLUMNS = "missing_columns"
OWN_SET = "own_set"

UNFIT = (OTHER_ARRAY, OTHER_RATE, OTHER_LOCALIZER, MISSING_COLUMNS, OWN_SET)
"""Metrics of rows that say why there is no figure: their model was made for another array or rate,
the localizer cannot work on what was recorded, the model looks at what is not there, or a bundle
was trained on the set and its run, which tells the rows it held out, is not there. Their value is
empty."""

PAPER = "reflector"
"""The paper's label, by which all models are compared on sets."""

BUNDLE = "bundle"
"""Role and method of a bundle."""

Row = dict[str, Any]


class Model(NamedTuple):
    """A classifier trained on one set, whatever the seed; its fields are columns of results.

    Attributes:
        classifier: name of its configuration, or of the reference.
        trained_on: name of the set's plan; "-" for references, which are not trained.
        role: "learned", "baseline" (a bare threshold), "bundle" or "reference" (knows nothing, or
            all).
        method: short name of what is fitted; empty for references.
        split: what is never divided between training and test, "position" or "row".
        target: label that was learned, "reflector", "on_map" or "time_and_direction".
        train_rows: most rows that it was trained on, as text; empty: all of them.
        without: columns of its configuration that were left out, separated by blanks.
    """

    classifier: str
    trained_on: str = "-"
    role: str = "reference"
    method: str = ""
    split: str = ""
    target: str = ""
    train_rows: str = ""
    without: str = ""

    @property
    def full(self) -> "Model":
        """Return the model that this one takes rows or columns from: itself, usually."""
        return self._replace(train_rows="", without="")

    @property
    def training(self) -> str:
        """Name of the training set, with what is unusual about the training."""
        unusual = []
        if self.target not in ("", "reflector"):
            unusual.append(self.target)
        if self.split not in ("", "position"):
            unusual.append(f"{self.split} split")
        if self.train_rows:
            unusual.append(f"{self.train_rows} rows")
        if self.without:
            unusual.append(f"without {self.without}")
        return f"{self.trained_on} ({', '.join(unusual)})" if unusual else self.trained_on

    def columns(self) -> Row:
        """Return its fields and `training` as cells of a row."""
        return self._asdict() | {"training": self.training}


class Recordings(NamedTuple):
    """Where test rows come from; its fields are columns of results.

    Attributes:
        tested_on: name of the set or survey.
        kind: "set", "survey" (its map), or "measured" (the echoes of recorded surveys).
        noise: kinds of noise, such as "white+rotor".
        set_role: what the set's plan was made for; empty for surveys.
        room: of the survey, such as "8x6x5"; empty for sets.
        localizer: whose echoes of the survey these are; empty for sets.
    """

    tested_on: str
    kind: str
    noise: str = "white"
    set_role: str = ""
    room: str = ""
    localizer: str = ""


@dataclass(frozen=True)
class LabelledRows:
    """What is known of the B rows of a test set.

    Attributes:
        source: recordings that the rows come from.
        reference: truth, shape (B,), bool.
        groups: position or pose of each row, shape (B,).
        joint_snr_db: received probe over all noises together, shape (B,).
        weights: resamples, shape (resamples, B).
    """

    source: Recordings
    reference: Array
    groups: Array
    joint_snr_db: Array
    weights: Array


@dataclass(frozen=True)
class Predictions:
    """What one run says about a test set.

    Attributes:
        seed: seed of the run.
        rows: numbers of the rows that it is evaluated on, shape (B,).
        confidence: belief in these rows, shape (B,).
        threshold: confidence from which a row is kept, fixed on validation data.
    """

    seed: int
    rows: Array
    confidence: Array
    threshold: float

    @property
    def kept(self) -> Array:
        """Which of the rows the filter keeps, shape (B,)."""
        return metrics.kept(self.confidence, self.threshold)

    def within(self, mask: Array) -> "Predictions":
        """Return those about rows of the test set where `mask` holds."""
        inside = mask[self.rows]
        return replace(self, rows=self.rows[inside], confidence=self.confidence[inside])


@dataclass(frozen=True)
class LocalizedSurvey:
    """A survey as one localizer sees it: P echoes, their points on the map, what describes them.

    Attributes:
        labelled: truth, "the map point lies within 0.10 m of a wall".
        points: map points, shape (P, 2), in m.
        poses: robot positions, shape (P, 2), in m.
        walls: of the floor plan, shape (W, 2, 2), in m.
        columns: what classifiers look at, by name, shape (P, ...).
    """

    labelled: LabelledRows
    points: Array
    poses: Array
    walls: Array
    columns: Mapping[str, Array]

    @property
    def snr_db(self) -> str:
        """Joint SNR of the recordings, as `results.csv` spells it."""
        return f"{self.labelled.joint_snr_db[0]:g}"

    @property
    def attainable(self) -> float:
        """Share of poses with a wall 1 to 2 m away: about what one echo a pose can get right."""
        return coverage.attainable(self.walls, self.poses)


@dataclass(frozen=True)
class MeasuredRows:
    """The echoes of recorded surveys of one kind, as one localizer finds them: B rows.

    Attributes:
        labelled: truth by `label`.
        label: "time_and_direction", "on_map", or "reflector" where times alone are known.
        by_time: truth by time alone, shape (B,), bool; None where times are not known.
        columns: what classifiers look at, by name, shape (B, ...).
        places: number of places, over which resamples are drawn.
    """

    labelled: LabelledRows
    label: str
    by_time: Array | None
    columns: Mapping[str, Array]
    places: int


def in_band(snr_db: Array, *, low: float, high: float) -> Array:
    """Tell which SNRs (B,) lie in [low, high) dB; the last band holds its upper end, too.

    Args:
        snr_db: ratios, shape (B,), in dB.
        low: lower end of the band, included, in dB.
        high: upper end, in dB.
    """
    # Without this the loudest rows, at 40 dB sharp, would be in no band.
    below = snr_db <= high if high == SNR_BANDS_DB[-1][1] else snr_db < high
    return (snr_db >= low) & below


def pick(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """Return the rows whose columns equal `wanted`; a tuple allows several values."""
    found = list(rows)
    for key, value in wanted.items():
        allowed = value if isinstance(value, tuple) else (value,)
        found = [row for row in found if row[key] in allowed]
    return found


def distinct(rows: Iterable[Row], key: str) -> list[Any]:
    """Return what stands in a column, each once, in the order of the rows."""
    return list(dict.fromkeys(row[key] for row in rows))


def to_csv(rows: Iterable[Row], columns: Sequence[str]) -> bytes:
    """Return rows as CSV text; floats to 6 decimals in shortest form, NaN empty."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_cell(row[name]) for name in columns])
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if not isinstance(value, float | np.floating):
        return value
    return "" if np.isnan(value) else repr(round(float(value), 6))
