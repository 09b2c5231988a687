"""When a share agrees with what was expected of it; that everything expected can be found."""

import pytest
from scipy.stats import binomtest

from echolearn import config, expected
from echolearn.expected import EXPECTATIONS, Expectation, Share

AT = ("snls", "toa", "-10")


def verdict(found, **about):
    """Return the last column for one share that was found."""
    return Expectation("it", "study", AT, why="The weather.", **about).row(found)[-1]


def test_counted_shares_agree_where_intervals_overlap():
    low, high = binomtest(33, 40).proportion_ci(method="wilson")
    counted = {"share": 0.825, "trials": 40}
    assert verdict({AT: Share(0.8, 0.75, 0.85, 100)}, **counted) == "yes"
    assert verdict({AT: Share(0.6, 0.5, low + 0.001, 100)}, **counted) == "overlap alone. The weather."
    assert verdict({AT: Share(0.6, 0.5, low - 0.001, 100)}, **counted) == "no. The weather."
    assert verdict({AT: Share(0.95, high - 0.001, 1.0, 100)}, **counted) == "overlap alone. The weather."
    assert verdict({AT: Share(0.95, high + 0.001, 1.0, 100)}, **counted) == "no. The weather."


def test_a_figure_without_trials_must_lie_in_the_interval():
    assert verdict({AT: Share(0.7, 0.6, 0.8, 100)}, share=0.8, trials=None) == "yes"
    assert verdict({AT: Share(0.7, 0.6, 0.79, 100)}, share=0.8, trials=None) == "no. The weather."


def test_a_limit_is_met_unless_the_whole_interval_is_beyond_it():
    assert verdict({AT: Share(0.14, 0.1, 0.2, 100)}, share=0.15, limit="<") == "yes"
    assert verdict({AT: Share(0.3, 0.2, 0.4, 100)}, share=0.15, limit="<") == "no. The weather."
    assert verdict({AT: Share(1.0, 0.96, 1.0, 100)}, share=0.9, limit=">=") == "yes"
    assert verdict({AT: Share(0.8, 0.7, 0.89, 100)}, share=0.9, limit=">=") == "no. The weather."


def test_a_share_can_be_expected_to_stay():
    there = (*AT[:2], "0")
    assert verdict({AT: Share(0.9, 0.8, 0.95, 50), there: Share(0.95, 0.89, 1.0, 50)}, beside="0") == "yes"
    assert verdict({AT: Share(0.8, 0.7, 0.9, 50), there: Share(0.95, 0.91, 1.0, 50)}, beside="0") == "no. The weather."


def test_what_was_not_found_says_so_and_a_row_is_in_per_cent():
    assert Expectation("it", "study", AT, 0.5).row({})[3:] == ["not yet: `make studies`", ""]
    row = Expectation("it", "study", AT, 0.825).row({AT: Share(0.76, 0.695, 0.83, 200)})
    assert row == ["it", "82.5 [68.1, 91.3], n = 40", "planning", "76 [69.5, 83], n = 200", "yes"]


def test_a_folder_without_studies_leaves_every_place_open(tmp_path):
    assert expected.table(tmp_path).count("not yet") == len(EXPECTATIONS)


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
