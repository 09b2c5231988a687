"""A card says of a bundle what the bundle and comparisons say, and nothing else."""

import csv
import json

import pytest

from echolearn.checks import BadValue
from echolearn.training.card import card
from world import pack


@pytest.fixture(scope="module")
def written(world, compared, tmp_path_factory):
    """Return a bundle and its card."""
    place = tmp_path_factory.mktemp("card")
    page = place / "cards" / "small.md"
    folder = pack(world, "trees_features", place, card=page, evidence=[str(compared)])
    return folder, page.read_text()


def test_it_tells_what_the_bundle_is(written):
    folder, page = written
    about = json.loads((folder / "bundle.json").read_text())
    assert page.startswith("# small\n")
    for told in (
        about["data"]["digest"],
        about["threshold"]["chosen"],
        f"{about['threshold']['value']:.3f}",
        about["files"]["model.onnx"]["sha256"],
        about["label"]["true"],
        "| smallest room, m | 5 x 5 x 3 |",
        "| reverberation time, s | 0.25 to 0.3 |",
        "[[200, 0, 0], [100, 173, 0]",
    ):
        assert told in page, told
    auc = about["metrics"]["held_out"]["figures"]["auc"]
    assert f"| auc | {auc['value']:.3f} [{auc['ci_low']:.3f}, {auc['ci_high']:.3f}] |" in page
    assert "## Limits" in page


def test_its_evidence_are_rows_of_the_comparison(written, compared):
    _, page = written
    with (compared / "results.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["classifier"] == "trees_features"]
    [area] = [
        row
        for row in rows
        if row["tested_on"] == "offgrid_hall" and row["metric"] == "auc" and not row["snr_db"]
    ]
    shown = [f"{float(area[key]):.3f}" for key in ("value", "ci_low", "ci_high")]
    assert "| scattered | offgrid_hall | all | {} [{}, {}] | ".format(*shown) in page
    lines = [line for line in page.splitlines() if "hall_-10dB, `gated` | -10 dB |" in line]
    assert len(lines) == 1 and lines[0].count(" | ") == 5


def test_a_comparison_of_others_is_no_evidence(written, compared):
    folder, _ = written
    about = json.loads((folder / "bundle.json").read_text()) | {"classifier": "trees_other"}
    said = "evidence=.*: must be a comparison of runs of trees_other with target=reflector"
    with pytest.raises(BadValue, match=said):
        card(about, plan={}, evidence=[compared])
