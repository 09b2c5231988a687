"""A bundle's card: what it is for, how it was made, what it is worth, where that ends.

    bundle.json, the set's plan, comparisons --card--> a Markdown page

Every figure is a row of some `results.csv` or of the bundle, with its interval; nothing is typed.
After Mitchell et al., Model Cards for Model Reporting (FAT* 2019).
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from echolearn.checks import check
from echolearn.dataset.labelled_set import RECORDED as RECORDED_SET
from echolearn.evaluation.rows import PAPER, pick
from echolearn.storage import manifests

SHOWN = {
    "set": ("own_auc", "own_precision", "own_recall", "calibration_error"),
    "measured": ("auc", "r90", "precision", "true_retention", "calibration_error"),
    "survey": ("precision", "true_retention", "spurious_removal"),
}
"""Metrics of a card, by the kind of what was tested."""

TITLES = {
    "set": "Simulated rooms, every echo by the label that was learned",
    "measured": "Measured sound, every echo by its time and direction",
    "survey": "Maps of simulated walks, points within 0.10 m of a wall",
}

PLAN = {
    "size_low": "smallest room, m",
    "size_high": "largest room, m",
    "t60": "reverberation time, s",
    "wall_factor": "factor on the walls' reflection",
    "snr_db": "SNR, dB",
}
"""Ranges of a training set that a card tells."""

Row = dict[str, str]


PAGE = """# {name}

`{classifier}`: the belief that {true}.

| | |
|---|---|
| microphones, mm from the loudspeaker | {array} |
| sample rate | {sample_rate:g} Hz |
| walls sought | {nearest:g} to {farthest:g} m away |
| echoes by | `{localizer}` |
| sees | {columns} |
| an echo is kept from | {threshold:.3f} ({chosen}) |
| trained on | `{plan}`, {rows} rows, digest `{digest}`, seed {seed} |
{ranges}| made by | `{command}` |
| SHA-256 of the model | `{sha256}` |

## What it is worth

At {held_out} held-out rows of its own set, by its label, with 95 % intervals over positions:

| metric | value |
|---|---|
{figures}
{evidence}

## Limits

- For this array and burst alone: what it sees depends on where the microphones are. `map` refuses
  others.
{learned}
- Figures on measured sound, if a table has any, are of the same recipe, trained for the array that
  measured. Without such a table, what it is worth there is not known.
"""
"""The page, with places for what differs from bundle to bundle."""

SIMULATED = """\
- Walls nearer or farther than the window, and rooms, reverberation and noise outside the ranges
  above, were not learned. The rooms were boxes.
- The cut was chosen on simulated rows with their share of true echoes: where fewer are true, less
  of what is kept is. The tables say by how much on other sound."""
RECORDED = """\
- It was fitted to recordings of the places of that set. Rooms, loudspeakers and noise that are
  not heard in them were not learned.
- Its figures, calibration and cut come from few places, and all from the same recordings: the
  intervals say how little that may be. Where fewer echoes are true, less of what is kept is."""
"""What was not learned, by what the training set is."""


def card(about: Mapping[str, Any], *, plan: Mapping[str, Any], evidence: Sequence[Path]) -> str:
    """Return the card of a bundle.

    Args:
        about: content of its `bundle.json`.
        plan: plan of the set that it was trained on, as in its manifest.
        evidence: folders of comparisons of runs of the same classifier and label.

    Raises:
        BadValue: no comparison, or one that says nothing about such a classifier.
    """
    held_out = about["metrics"]["held_out"]
    figures = held_out["figures"].items()
    threshold = about["threshold"]
    return PAGE.format(
        **{key: about[key] for key in ("name", "classifier", "sample_rate", "seed")},
        **{key: about["data"][key] for key in ("plan", "rows", "digest")},
        **{key: about["window"][key] for key in ("nearest", "farthest")},
        command=about.get("command") or "a call of the library",
        true=about["label"]["true"],
        array=[[round(1000 * value) for value in place] for place in about["array"]],
        localizer=about["localizer"]["name"],
        columns=", ".join(f"`{each['name']}`" for each in about["columns"]),
        threshold=threshold["value"],
        chosen=threshold["chosen"],
        ranges="".join(f"{line}\n" for line in (*_origin(about), *_ranges(plan))),
        learned=RECORDED if plan.get("kind") == RECORDED_SET else SIMULATED,
        sha256=about["files"]["model.onnx"]["sha256"],
        held_out=held_out["rows"],
        figures="\n".join(f"| {words(name)} | {figure_text(each)} |" for name, each in figures),
        evidence="\n".join(line for folder in evidence for line in _evidence(about, folder)),
    )


def _origin(about: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line about the filter that was adapted, if one was."""
    earlier = about.get("adapted_from")
    if earlier:
        name = f"the {earlier['kind']} `{earlier['name']}`, SHA-256 `{earlier['sha256']}`"
        yield f"| adapted from | {name}, at {earlier['places']} places |"


def _ranges(plan: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines about what a training set was drawn from."""
    for key, title in PLAN.items():
        if plan.get(key) is not None:
            mark = " x " if key.startswith("size") else " to "
            yield f"| {title} | {mark.join(f'{value:g}' for value in plan[key])} |"


def _evidence(about: Mapping[str, Any], folder: Path) -> Iterator[str]:
    """Yield the tables of one comparison about runs of a bundle's classifier and label."""
    manifests.verify(folder)
    with (Path(folder) / "results.csv").open(newline="") as file:
        rows: list[Row] = list(csv.DictReader(file))
    own = {"classifier": about["classifier"], "target": about["label"]["name"]}
    rows = pick(rows, seed="", **own)
    allowed = f"must be a comparison of runs of {about['classifier']} with target={own['target']}"
    check(len(rows) > 0, "evidence", folder, allowed=allowed)
    for kind, names in SHOWN.items():
        # By the paper's label, a model's own figures are the usual ones.
        plain = own["target"] == PAPER
        metrics = [name.removeprefix("own_") if plain else name for name in names]
        here = pick(rows, kind=kind, metric=tuple(metrics))
        # Bands of sets would fill pages; levels of recordings and walks are few.
        here = pick(here, snr_db="") if kind == "set" else here
        if here:
            yield from ("", f"{TITLES[kind]}:", "", *_table(here, metrics))


def _table(rows: Sequence[Row], metrics: Sequence[str]) -> Iterator[str]:
    """Yield a table of rows: a line for each place and level, a column for each metric."""
    yield f"| trained on | tested on | SNR | {' | '.join(map(words, metrics))} |"
    yield "|---|---|---|" + "---|" * len(metrics)
    lines: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in rows:
        key = (row["trained_on"], row["tested_on"], row["localizer"], row["snr_db"])
        lines.setdefault(key, {})[row["metric"]] = row
    for (trained, tested, localizer, level), cells in lines.items():
        by = f", `{localizer}`" if localizer else ""
        told = " | ".join(figure_text(cells.get(name, {})) for name in metrics)
        yield f"| {trained} | {tested}{by} | {level + ' dB' if level else 'all'} | {told} |"


def words(metric: str) -> str:
    """Return a metric's name as words."""
    return metric.removeprefix("own_").replace("_", " ")


def figure_text(figure: Mapping[str, Any]) -> str:
    """Return `value [low, high]`, nothing where there is none."""
    told = [figure.get(key) for key in ("value", "ci_low", "ci_high")]
    value, low, high = ("" if each in (None, "") else f"{float(each):.3f}" for each in told)
    return f"{value} [{low}, {high}]" if low else value
