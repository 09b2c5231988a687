"""When a share agrees with what was expected of it; that everything expected can be found."""

import csv
from pathlib import Path

import pytest
from scipy.stats import fisher_exact

from echolearn.checks import BadValue
from echolearn.cli import config
from echolearn.studies import expected
from echolearn.studies.expected import Expectation, Share

AT = ("snls", "toa", "-10")
TABLE = Path(__file__).parents[2] / "docs" / "studies" / "expected.csv"
EXPECTATIONS = expected.read(TABLE)


def row(found, *, share=float("nan"), more=(), before="", **about):
    """Return the cells of one expectation beside a share that was found at `AT`, and at the values
    of `more`."""
    each = Expectation("it", "study", AT, share, source="us", why="The weather.", **about)
    known = {AT: found, **{(*AT[:2], at): other for at, other in more}} if found else {}
    table = expected.tabulate([each], {"study": known}, before=before)
    return [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]


def test_counted_shares_are_held_against_each_other_by_fishers_test():
    cells = row(Share(0.51, 0.455, 0.57, 200), share=0.725, trials=40)
    p = fisher_exact([[29, 11], [102, 98]]).pvalue
    assert cells[:4] == ["it", "72.5 [57.2, 83.9], n = 40", "us", "51 [45.5, 57], n = 200"]
    assert cells[4:] == [f"{p:.2g}", f"{p:.2g}", "no. The weather."]
    assert row(Share(0.8, 0.7, 0.85, 200), share=0.825, trials=40)[-1] == "yes"


def test_of_many_rows_the_correction_is_holms():
    """Of two, the smaller p counts double: 0.04 alone is a difference, beside another row it is
    none."""
    shares = {AT: Share(0.515, 0.4, 0.6, 200), ("snls", "toa", "0"): Share(0.9, 0.8, 1.0, 200)}
    first = Expectation("one", "study", AT, 0.7, trials=40, why="The weather.")
    second = Expectation("two", "study", ("snls", "toa", "0"), 0.9, trials=40)
    lines = expected.tabulate([first, second], {"study": shares}).splitlines()[2:]
    p = fisher_exact([[28, 12], [103, 97]]).pvalue
    assert 0.025 < p < 0.05
    assert lines[0].endswith(f"| {p:.2g} | {2 * p:.2g} | not told apart. The weather. |")
    assert lines[1].endswith("| 1 | 1 | yes |")
    assert row(shares[AT], share=0.7, trials=40)[-1] == "no. The weather."


def test_a_figure_without_trials_must_lie_in_the_interval():
    assert row(Share(0.7, 0.6, 0.8, 100), share=0.8)[4:] == ["", "", "yes"]
    assert row(Share(0.7, 0.6, 0.79, 100), share=0.8)[-1] == "no. The weather."


def test_a_limit_is_met_by_the_share_itself():
    assert row(Share(0.14, 0.1, 0.2, 100), share=0.15, limit="<")[-1] == "yes"
    assert row(Share(0.25, 0.14, 0.4, 100), share=0.15, limit="<")[-1] == "no. The weather."
    assert row(Share(1.0, 0.96, 1.0, 100), share=0.9, limit=">=")[-1] == "yes"
    assert row(Share(0.86, 0.82, 0.905, 100), share=0.9, limit=">=")[-1] == "no. The weather."


def test_a_share_can_be_expected_to_stay():
    assert (
        row(Share(0.9, 0.8, 0.95, 50), more=[("0", Share(0.95, 0.89, 1.0, 50))], beside="0")[-1]
        == "yes"
    )
    assert (
        row(Share(0.8, 0.7, 0.9, 50), more=[("0", Share(0.95, 0.91, 1.0, 50))], beside="0")[-1]
        == "no. The weather."
    )


def test_what_was_not_found_keeps_its_row_or_says_so():
    assert row(None, share=0.5)[3:] == ["not yet: `make studies`", "", "", ""]
    before = "| it | about 50 | us | 49 [40, 58], n = 100 |  |  | yes |"
    assert (
        row(None, share=0.5, before=f"| other | a | us | b |\n{before}")[3]
        == "49 [40, 58], n = 100"
    )


def test_rows_of_one_thing_keep_each_its_own():
    """All rows of the page's table come back from it where no study is at hand, those of equal
    words, too."""
    page = (
        (TABLE.parents[1] / "studies.md")
        .read_text()
        .split("<!-- expected")[1]
        .split("-->", 1)[1]
        .split("<!--")[0]
    )
    table = expected.tabulate(EXPECTATIONS, {each.study: {} for each in EXPECTATIONS}, before=page)
    assert table == page.strip()


def test_a_folder_without_studies_leaves_every_place_open(tmp_path):
    assert expected.table(EXPECTATIONS, tmp_path).count("not yet") == len(EXPECTATIONS) > 20


def test_a_table_that_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "expected.csv"
    full = TABLE.read_text()
    wrong = full.replace("0.825,40", "most,40"), full.replace("e,\n", "e,yes, no\n")
    for text in (None, "what,study\nit,one\n", *wrong):
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


@pytest.mark.parametrize(
    "name", sorted({each.study for each in EXPECTATIONS if "pings" not in each.study})
)
def test_every_expectation_is_of_something_that_its_experiment_finds(name):
    experiment, _, room = name.partition("_") if name.startswith("attainable") else (name, "", "")
    words = [
        f"experiment={experiment.removesuffix('_recorded')}",
        *([f"room={room}"] if room else []),
    ]
    words += [f"name={name}", "diffuse=recorded"] if name.endswith("_recorded") else []
    [(_, about)] = config.compose("study", words)
    assert about["name"] == name
    for each in EXPECTATIONS:
        if each.study == name:
            assert each.at[0] in {*about["localizers"], "chance"}
            assert {each.at[2], each.beside} - {""} <= {str(value) for value in about["values"]}
