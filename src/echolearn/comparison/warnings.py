"""What a reader of a comparison should know before believing it, as short codes: `warnings.csv`.

Each code has a function that yields its warnings; `docs/statistics.md` tells what they mean and
what to do.
"""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.choice import Comparison, headline
from echolearn.comparison.rivals import BASELINE
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import Row, pick
from echolearn.survey.floor_plan import floor_size
from echolearn.survey.reader import read_survey
from echolearn.survey.survey import Survey

COLUMNS = "code classifier training tested_on value limit message".split()
"""Columns of `warnings.csv`."""

CODES = {
    "W01": "leak",
    "W02": "below the threshold",
    "W03": "seeds differ by more than the effect",
    "W04": "saturated",
    "W05": "shifted",
    "W06": "yardstick missing",
    "W07": "no better than geometry",
    "W08": "exact poses missing",
}
"""What each code is called."""

YARDSTICKS = ("threshold_peak", "threshold_cfar", "svm_pair", "svm_features", "trees_features")
"""Classifiers beside which any other must stand: bare thresholds, SVMs on both sets of columns,
trees on all columns."""

SIGNIFICANT = 0.05
SATURATED = 0.99
"""AUC of the bare threshold from which on nobody can be better by much."""

SHIFTED = 0.1
"""Share of tested values outside of the trained ones, which is 0.01 if nothing has shifted."""


class Warned(NamedTuple):
    """A warning; its fields are the columns of `warnings.csv`.

    Attributes:
        code: one of `CODES`.
        classifier: whom it is about; empty: all of the training.
        training: on what they were trained, and how.
        tested_on: where it was seen; empty: in several places, or none.
        value: figure that it is given for.
        limit: figure from which on it is given.
        message: what is the matter, in a sentence.
    """

    code: str
    classifier: str
    training: str
    tested_on: str
    value: float
    limit: float
    message: str


def all_warnings(
    comparison: Comparison,
    *,
    trained: Mapping[str, Path],
    surveys: Mapping[str, Path],
    shifts: Sequence[Row],
) -> list[Warned]:
    """Return every warning of a comparison, by code.

    Args:
        comparison: what was found.
        trained: folders of training sets by their digests.
        surveys: folders of the surveys that were tested on, by name.
        shifts: rows of `shifts.csv`.
    """
    return [
        *leaks(comparison, trained, surveys=surveys),
        *below_threshold(comparison.tests),
        *unsettled(comparison),
        *saturated(comparison),
        *shifted(shifts),
        *missing_yardsticks(comparison),
    ]


def leaks(
    comparison: Comparison, trained: Mapping[str, Path], *, surveys: Mapping[str, Path]
) -> Iterator[Warned]:
    """Yield W01: test rows that a model has seen, or whose position it has.

    Args:
        comparison: what was found.
        trained: folders of training sets by their digests.
        surveys: folders of the surveys that were tested on, by name.
    """
    for model in comparison.models:
        if model.split == "row" and model.full == model:
            message = "rows of one position stand on both sides of the split"
            yield Warned("W01", model.classifier, model.training, model.trained_on, 1, 0, message)
    # Rows of results call a survey by its folder, from wherever it was taken.
    walks = {folder.name: walked_places(read_survey(folder)) for folder in surveys.values()}
    sets = {name: places(dataset) for name, dataset in comparison.sets.items()}
    yield from _begun_on(comparison)
    used = {
        each for runs in comparison.models.values() for run in runs for each in run.learned_from
    }
    for digest in sorted(used & {*trained}):
        training = Dataset(trained[digest])
        known = {*places(training)}
        # On the set itself, models are tested by the rows that their split held out.
        others = [name for name, dataset in comparison.sets.items() if dataset.digest != digest]
        tested = [(name, sets[name], "rows") for name in others]
        tested += [(name, walk, "poses") for name, walk in walks.items()]
        for name, there, what in tested:
            share = float(np.mean([place in known for place in there] or [False]))
            if share > 0:
                message = f"{share:.1%} of its {what} are at positions of the training set"
                yield Warned("W01", "", training.name, name, share, 0, message)


def _begun_on(comparison: Comparison) -> Iterator[Warned]:
    """Yield W01: sets that the filters had learned from of which others were adapted."""
    for model, runs in comparison.models.items():
        # Of its own set a run is tested on the rows that it held out; of these on all.
        earlier = {each for run in runs for each in run.learned_from[1:]}
        for name, dataset in comparison.sets.items():
            if dataset.digest in earlier:
                message = "the filter that it was adapted from has learned from this set"
                yield Warned("W01", model.classifier, model.training, name, 1, 0, message)


def places(dataset: Dataset) -> list[bytes]:
    """Return where each row was heard, as keys."""
    if not dataset.holds(["room", "position"]):
        return []
    return _keys(dataset["room"], dataset["position"])


def walked_places(survey: Survey) -> list[bytes]:
    """Return where each pose of a survey is, as keys."""
    room = np.tile(floor_size(survey.walls), (len(survey), 1))
    return _keys(room, np.array([pose.position for pose in survey.poses], dtype=float))


def _keys(room: Array, position: Array) -> list[bytes]:
    """Return a key for each place: floor and position to the micrometre.

    Args:
        room: sizes, shape (B, 2 or 3), in m; the height is not asked, which no survey tells.
        position: shape (B, 3), in m.
    """
    both = np.concatenate([room[:, :2], position], axis=1)
    return [each.tobytes() for each in np.rint(1e6 * both).astype(np.int64)]


def below_threshold(tests: Iterable[Row]) -> Iterator[Warned]:
    """Yield W02: models that are significantly worse than the bare threshold somewhere."""
    against = pick(tests, test="swaps", against=BASELINE)
    found = defaultdict(list)
    for row in against:
        if row["difference"] < 0 and row["p_holm"] <= SIGNIFICANT:
            found[row["classifier"], row["training"]].append(row)
    for (classifier, training), rows in found.items():
        all_of_them = len(pick(against, classifier=classifier, training=training))
        worst = min(rows, key=lambda row: float(row["difference"]))
        message = (
            f"worse than {BASELINE} in {len(rows)} of {all_of_them} tests, most by"
            f" {-worst['difference']:.3f} of {worst['metric']}"
        )
        value = float(worst["difference"])
        yield Warned("W02", classifier, training, worst["tested_on"], value, 0, message)


def unsettled(comparison: Comparison) -> Iterator[Warned]:
    """Yield W03: models whose seeds scatter by more than their mean lead over the threshold."""
    rows = [row for row in comparison.rows if row["kind"] == "set" and row["metric"] == "auc"]
    values: dict[tuple[str, str, str], dict[int, float]] = defaultdict(dict)
    for row in rows:
        if row["seed"] != "" and row["split"] != "row":
            values[row["classifier"], row["training"], row["tested_on"]][row["seed"]] = row["value"]
    for (classifier, training, tested_on), seeds in values.items():
        base = values.get((BASELINE, training, tested_on), {})
        leads = [value - base[seed] for seed, value in seeds.items() if seed in base]
        if classifier == BASELINE or len(leads) < 2:
            continue
        spread, lead = stdev(leads), abs(mean(leads))
        if spread >= lead:
            message = (
                f"AUC differs from {BASELINE}'s by {mean(leads):+.3f}, over seeds by {spread:.3f}"
            )
            yield Warned("W03", classifier, training, tested_on, spread, lead, message)


def saturated(comparison: Comparison) -> Iterator[Warned]:
    """Yield W04: bands of a set where already the bare threshold is nearly always right."""
    source = headline(comparison)
    bare = pick(
        comparison.rows, classifier=BASELINE, training=source, kind="set", metric="auc", seed=""
    )
    found = defaultdict(list)
    for row in bare:
        if row["value"] >= SATURATED:
            found[row["tested_on"]].append(row)
    for tested_on, rows in found.items():
        bands = ", ".join(
            f"{row['snr_db'].replace(':', ' to ')} dB" if row["snr_db"] else "all rows"
            for row in rows
        )
        value = max(float(row["value"]) for row in rows)
        message = (
            f"{BASELINE} has an AUC of {value:.3f} ({bands}): models cannot be told apart there"
        )
        yield Warned("W04", BASELINE, source, tested_on, value, SATURATED, message)


def shifted(shifts: Iterable[Row]) -> Iterator[Warned]:
    """Yield W05: recordings whose columns lie outside of those that were trained on."""
    found = defaultdict(list)
    for row in shifts:
        if row["outside"] > SHIFTED:
            found[row["trained_on"], row["tested_on"]].append(row)
    for (trained_on, tested_on), rows in found.items():
        rows = sorted(rows, key=lambda row: -float(row["outside"]))
        named = ", ".join(f"{row['column']} {row['outside']:.0%}" for row in rows)
        message = f"values outside of the middle 99 % of those trained on: {named}"
        value = float(rows[0]["outside"])
        yield Warned("W05", "", trained_on, tested_on, value, SHIFTED, message)


def missing_yardsticks(comparison: Comparison) -> Iterator[Warned]:
    """Yield W06: trainings in which a yardstick is missing beside what was learned."""
    trainings = defaultdict(set)
    learned: set[str] = set()
    for model in comparison.models:
        if model.split != "row" and model == model.full:
            trainings[model.training].add(model.classifier)
            learned |= {model.training} if model.role == "learned" else set()
    for training, names in trainings.items():
        lacking = [name for name in YARDSTICKS if name not in names]
        if lacking and training in learned:
            message = f"nothing to stand beside: train {', '.join(lacking)} on the same set, too"
            yield Warned("W06", "", training, "", len(lacking), 0, message)


def tell(warned: Sequence[Warned]) -> None:
    """Say on stderr how many warnings there are of each code."""
    counts = Counter(each.code for each in warned)
    for code, count in sorted(counts.items()):
        print(f"{code} {CODES[code]}: {count}, see warnings.csv", file=sys.stderr, flush=True)
