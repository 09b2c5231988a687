"""When a share agrees with what was expected of it; that everything expected can be found."""

import csv
from pathlib import Path

import pytest
from scipy.stats import binomtest

from echolearn import config, expected
from echolearn.expected import Expectation, Share
from echolearn.types import BadValue

AT = ("snls", "toa", "-10")
TABLE = Path(__file__).parents[1] / "docs" / "studies" / "expected.csv"
EXPECTATIONS = expected.read(TABLE)


def verdict(found, *, share=float("nan"), **about):
    """Return the last column for one share that was found."""
    return Expectation("it", "study", AT, share, why="The weather.", **about).row(found)[-1]


def test_a_share_agrees_within_the_interval_of_what_was_counted_or_with_it_in_its_own():
    low, high = binomtest(33, 40).proportion_ci(method="wilson")
    counted = {"share": 0.825, "trials": 40}
    assert verdict({AT: Share(low + 0.001, low - 0.1, low + 0.01, 100)}, **counted) == "yes"
    assert verdict({AT: Share(high - 0.001, high - 0.01, 1.0, 100)}, **counted) == "yes"
    assert verdict({AT: Share(low - 0.001, low - 0.1, 0.83, 100)}, **counted) == "yes"
    assert verdict({AT: Share(low - 0.001, low - 0.1, 0.82, 100)}, **counted) == "no. The weather."
    assert verdict({AT: Share(high + 0.001, 0.83, 1.0, 100)}, **counted) == "no. The weather."


def test_a_figure_among_those_of_single_positions_is_told_from_one_that_is_nowhere():
    counted = {"share": 0.825, "trials": 40}
    among = "with single positions, 20 to 90. The weather."
    assert verdict({AT: Share(0.5, 0.4, 0.6, 100, 0.2, 0.9)}, **counted) == among
    assert verdict({AT: Share(0.5, 0.4, 0.6, 100, 0.2, 0.8)}, **counted) == "no. The weather."
    assert verdict({AT: Share(0.5, 0.4, 0.6, 100, 0.2, 1.0)}, share=0.9, limit=">=") == "no. The weather."


def test_a_figure_without_trials_must_lie_in_the_interval():
    assert verdict({AT: Share(0.7, 0.6, 0.8, 100)}, share=0.8, trials=None) == "yes"
    assert verdict({AT: Share(0.7, 0.6, 0.79, 100)}, share=0.8, trials=None) == "no. The weather."


def test_a_limit_is_met_by_the_share_itself():
    assert verdict({AT: Share(0.14, 0.1, 0.2, 100)}, share=0.15, limit="<") == "yes"
    assert verdict({AT: Share(0.25, 0.14, 0.4, 100)}, share=0.15, limit="<") == "no. The weather."
    assert verdict({AT: Share(1.0, 0.96, 1.0, 100)}, share=0.9, limit=">=") == "yes"
    assert verdict({AT: Share(0.86, 0.82, 0.905, 100)}, share=0.9, limit=">=") == "no. The weather."


def test_a_share_can_be_expected_to_stay():
    there = (*AT[:2], "0")
    assert verdict({AT: Share(0.9, 0.8, 0.95, 50), there: Share(0.95, 0.89, 1.0, 50)}, beside="0") == "yes"
    assert verdict({AT: Share(0.8, 0.7, 0.9, 50), there: Share(0.95, 0.91, 1.0, 50)}, beside="0") == "no. The weather."


def test_what_was_not_found_says_so_and_a_row_is_in_per_cent():
    about = {"share": 0.825, "trials": 40, "source": "us"}
    assert Expectation("it", "study", AT, **about).row({})[3:] == ["not yet: `make studies`", ""]
    row = Expectation("it", "study", AT, **about).row({AT: Share(0.76, 0.695, 0.83, 200)})
    assert row == ["it", "82.5 [68.1, 91.3], n = 40", "us", "76 [69.5, 83], n = 200", "yes"]


def test_a_folder_without_studies_leaves_every_place_open(tmp_path):
    assert expected.table(EXPECTATIONS, tmp_path).count("not yet") == len(EXPECTATIONS) > 20


def test_a_table_that_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "expected.csv"
    for text in (None, "what,study\nit,one\n", TABLE.read_text().replace("0.825,40", "most,40")):
        if text:
            path.write_text(text)
        with pytest.raises(BadValue, match=r"expected\.csv: cannot be read"):
            expected.read(path)


def test_every_row_has_what_it_says():
    with TABLE.open(newline="") as file:
        for row, each in zip(csv.DictReader(file), EXPECTATIONS, strict=True):
            assert (each.what, each.at[0], str(each.trials or ""), each.why) == (
                row["what"], row["localizer"], row["trials"], row["why"]
            )  # fmt: skip
            assert each.beside or 0 <= each.share <= 1


@pytest.mark.parametrize("name", sorted({each.study for each in EXPECTATIONS if "pings" not in each.study}))
def test_every_expectation_is_of_something_that_its_experiment_finds(name):
    experiment, _, room = name.partition("_") if name.startswith("attainable") else (name, "", "")
    words = [f"experiment={experiment}", *([f"room={room}"] if room else [])]
    [(_, about)] = config.compose("study", words)
    assert about["name"] == name
    for each in EXPECTATIONS:
        if each.study == name:
            assert each.at[0] in about["localizers"]
            assert {each.at[2], each.beside} - {""} <= {str(value) for value in about["values"]}
