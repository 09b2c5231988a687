"""What a comparison finds, on one screen: the chosen filter beside the best yardstick.

    on the maps of each room at the lowest SNR of the tables, on measured sound, or, where there is
    neither, on the set whose curves are drawn --answers--> `Answer`, rows of `answer.csv`

The best yardstick is that of the largest figure right there. Hindsight thus speaks for the
yardstick, never for the filter, which was chosen by its own validation rows. The difference is
paired: both answered about the same echoes, of which the same ones are resampled. It is that of
`tests.csv`; of measured sound, which has no rows there, it is computed in the same way.
"""

from collections.abc import Iterator

from echolearn.comparison.choice import Comparison, away, chosen
from echolearn.comparison.rivals import BASELINE
from echolearn.comparison.shown import Answer
from echolearn.comparison.tables import levels, main_localizer, placed
from echolearn.comparison.warnings import YARDSTICKS
from echolearn.evaluation.pairs import pair_seeds, paired_difference
from echolearn.evaluation.rows import MeasuredRows, Model, Row, pick
from echolearn.training.predictions import predict_measured

SHOWN = ("difference", "ci_low", "ci_high", "n")
"""What is taken of a paired test."""


def answers(comparison: Comparison) -> list[Answer]:
    """Return what the first screen says, places in the order of the tables."""
    found = [*_of_maps(comparison), *_of_measured(comparison)]
    return found or [*_of_set(comparison)]


def _of_maps(comparison: Comparison) -> Iterator[Answer]:
    rows = placed(pick(comparison.rows, seed="", kind="survey"), comparison.surveys.values())
    here = pick(rows, localizer=main_localizer(comparison), metric="balanced_accuracy")
    level = next(iter(levels(comparison)), "")
    for row in pick(here, snr_db=level, **chosen(comparison)._asdict()):
        title = f"{row['place']} at {level} dB"
        rivals = _tested(row, pick(here, tested_on=row["tested_on"]), comparison)
        yield Answer(title, row["place"], row, rivals)


def _of_set(comparison: Comparison) -> Iterator[Answer]:
    name = away(comparison)
    rows = pick(comparison.rows, seed="", kind="set", tested_on=name, snr_db="", metric="auc")
    for row in pick(rows, **chosen(comparison)._asdict()):
        yield Answer(name, name, row, _tested(row, rows, comparison))


def _of_measured(comparison: Comparison) -> Iterator[Answer]:
    for (group, localizer), measured in comparison.measured.items():
        if localizer != main_localizer(comparison):
            continue
        # Where times alone are known, they are what is judged.
        metric = "time_auc" if measured.label == "reflector" else "auc"
        about = {"localizer": localizer, "metric": metric, "snr_db": "", "seed": ""}
        rows = pick(comparison.rows, tested_on=group, **about)
        for row in pick(rows, **chosen(comparison)._asdict()):
            paired = []
            for other in _yardsticks(row, rows):
                test = _measured_test(row, other, comparison=comparison, measured=measured)
                paired += [(other, test)] if test else []
            yield Answer(f"measured sound, {group}", group, row, paired)


def _yardsticks(row: Row, rows: list[Row]) -> list[Row]:
    """Return the best yardstick of the same training, then the bare threshold if it is another."""
    others = tuple(name for name in YARDSTICKS if name != row["classifier"])
    found = pick(rows, training=row["training"], classifier=others)
    found = sorted(found, key=lambda each: -float(each["value"]))
    return found[:1] + pick(found[1:], classifier=BASELINE)


def _tested(row: Row, rows: list[Row], comparison: Comparison) -> list[tuple[Row, Row]]:
    """Return those of a place beside whom the filter was tested, and the tests.

    Args:
        row: the filter's figure.
        rows: everybody's figures there.
        comparison: whose tests are known.
    """
    known: dict[str, tuple[Row, Row]] = {}
    for other in rows:
        if other["training"] == row["training"]:
            test = _known_test(row, other, comparison)
            known |= {other["classifier"]: (other, test)} if test else {}
    wanted = _yardsticks(row, [other for other, _ in known.values()])
    return [known[other["classifier"]] for other in wanted]


def _known_test(row: Row, other: Row, comparison: Comparison) -> Row | None:
    """Return the difference of `row` to `other` from `tests.csv`, whichever way it was tested."""
    keys = ("tested_on", "localizer", "metric", "training", "snr_db")
    tests = pick(comparison.tests, test="swaps", **{key: row[key] for key in keys})
    one, second = row["classifier"], other["classifier"]
    for test in pick(tests, classifier=one, against=second):
        return {key: test[key] for key in SHOWN}
    for test in pick(tests, classifier=second, against=one):
        low, high = -test["ci_high"], -test["ci_low"]
        return {"difference": -test["difference"], "ci_low": low, "ci_high": high, "n": test["n"]}
    return None


def _measured_test(
    row: Row, other: Row, *, comparison: Comparison, measured: MeasuredRows
) -> Row | None:
    """Return the paired difference of two models on measured echoes; None without common seeds.

    Args:
        row, other: figures of the two.
        comparison: holds their runs.
        measured: the echoes.
    """
    given = []
    for each in (row, other):
        runs = comparison.models[Model(*(each[name] for name in Model._fields))]
        given.append([predict_measured(run, measured) for run in runs])
    if not pair_seeds(*given):
        return None
    found = paired_difference(*given, labelled=measured.labelled, metric="auc")
    return {key: found[key] for key in SHOWN}
