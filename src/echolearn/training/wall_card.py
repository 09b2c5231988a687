"""The card of a bundle of a classifier of walls; `card` is that of one of echoes.

bundle.json, plan of the hypotheses, comparisons of walks --wall_card--> a Markdown page
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from echolearn.checks import check
from echolearn.evaluation.rows import pick
from echolearn.storage import manifests
from echolearn.training.card import figure_text, words

BESIDE = ("walls_geometry", "ransac_joint", "oracle")
"""Who stands beside the bundle in each table: the control that hears nothing, lines through the
strongest echoes, and who believes in exactly the hypotheses that are right."""

PLAN = {
    "snr_db": "SNR, dB",
    "odometry_error": "error of the odometry, m",
    "t60": "reverberation time, s",
    "wall_factor": "factor on the walls' reflection",
    "margin": "from the path to each wall, m",
    "height": "height of the rooms, m",
}
"""Ranges of the walks that a card tells."""

Row = dict[str, str]

PAGE = """# {name}

`{classifier}`: the belief that {true}.
It judges the lines that a whole walk speaks for, and so maps walls that no single ping tells
([walls.md](../walls.md)).

| | |
|---|---|
| microphones, mm from the loudspeaker | {array} |
| sample rate | {sample_rate:g} Hz |
| walls sought | {nearest:g} to {farthest:g} m from a pose |
| hypotheses of a walk | at most {count} |
| sees | {columns} |
| a line is a wall from | {threshold:.3f} ({chosen}) |
| trained on | {walks} walks of {poses} poses, `{plan}`, {rows} hypotheses, digest `{digest}`, \
seed {seed} |
| paths; rooms; odometry | {paths}; {rooms}; {odometry} |
{ranges}
| made by | `{command}` |
| SHA-256 of the model | `{sha256}` |

## What it is worth

At {held_out} held-out hypotheses of its own set, with 95 % intervals over walks:

| metric | value |
|---|---|
{figures}
{evidence}

## Limits

- The cut was chosen on validation walks of its own set; what precision it has elsewhere, the table
  tells.
- For this array and burst alone, however the array is turned. `map` refuses others.
- Poses must be right to some centimetres from one to the next: what helps is that all of them hear
  the same wall. The tables say how much an error costs.
- Walls that few poses have in the window are not found, whatever else is heard.
- Paths, rooms and noise outside the ranges above were not learned. The walls were flat.
- A gap in a wall that is shorter than 1.5 m is not told from the wall.
"""
"""The page, with places for what differs from bundle to bundle."""


def wall_card(
    about: Mapping[str, Any], *, plan: Mapping[str, Any], evidence: Sequence[Path]
) -> str:
    """Return the card of a bundle of a classifier of walls.

    Args:
        about: content of its `bundle.json`.
        plan: of the hypotheses that it was trained on, as in the manifest of their set.
        evidence: folders of comparisons of walks.

    Raises:
        BadValue: a comparison that says nothing of such a classifier.
    """
    walks = plan["walks"]
    held_out = about["metrics"]["held_out"]
    threshold = about["threshold"]
    return PAGE.format(
        **{key: about[key] for key in ("name", "classifier", "sample_rate", "seed")},
        **{key: about["data"][key] for key in ("plan", "rows", "digest")},
        **{key: about["window"][key] for key in ("nearest", "farthest")},
        **{key: ", ".join(walks[key]) for key in ("paths", "rooms", "odometry")},
        command=about.get("command") or "a call of the library",
        true=about["label"]["true"],
        array=[[round(1000 * value) for value in place] for place in about["array"]],
        columns=", ".join(f"`{each['name']}`" for each in about["columns"]),
        count=about["hypotheses"]["count"],
        threshold=threshold["value"],
        chosen=threshold["chosen"],
        walks=walks["rows"],
        poses=walks["poses"],
        ranges="\n".join(
            f"| {title} | {' to '.join(f'{value:g}' for value in walks[key])} |"
            for key, title in PLAN.items()
        ),
        sha256=about["files"]["model.onnx"]["sha256"],
        held_out=held_out["rows"],
        figures="\n".join(
            f"| {words(name)} | {figure_text(each)} |" for name, each in held_out["figures"].items()
        ),
        evidence="\n".join(line for folder in evidence for line in _evidence(about, folder)),
    )


def _evidence(about: Mapping[str, Any], folder: Path) -> Iterator[str]:
    """Yield the table of a comparison of walks: a line for each cell, found and precision."""
    manifests.verify(folder)
    with (Path(folder) / "results.csv").open(newline="") as file:
        rows: list[Row] = list(csv.DictReader(file))
    own = about["classifier"]
    cells = list(dict.fromkeys(row["tested_on"] for row in pick(rows, classifier=own)))
    allowed = f"must be a comparison of walks that has {own}"
    check(len(cells) > 0, "evidence", folder, allowed=allowed)
    names = (own, *BESIDE)
    yield from ("", "Walls found of those that 20 poses hear / precision, on walks in a room that")
    yield from ("it has never seen, with 95 % intervals over walks:", "")
    yield "| room, paths | SNR | odometry | " + " | ".join(f"`{name}`" for name in names) + " |"
    yield "|---|---|---|" + "---|" * len(names)
    for cell in cells:
        here = pick(rows, tested_on=cell)
        place = f"{here[0]['room']}, {here[0]['paths']}"
        noise = f"{here[0]['snr_db']} dB | {100 * float(here[0]['odometry_error']):g} cm"
        told = " | ".join(_found(pick(here, classifier=name)) for name in names)
        yield f"| {place} | {noise} | {told} |"


def _found(rows: Sequence[Row]) -> str:
    """Return what one of a cell's judges finds, and how precisely."""
    told = {row["metric"]: row for row in rows}
    return f"{figure_text(told.get('found', {}))} / {figure_text(told.get('precision', {}))}"
