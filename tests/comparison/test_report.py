"""The report: one page that needs nothing else, whose numbers are those of the comparison, and a
README's table."""

import re
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from echolearn.checks import BadValue
from echolearn.comparison import report, tables
from echolearn.comparison.tables import Comparison, pick
from echolearn.storage.marked_page import around
from echolearn.training.runs import answer_map

NAN = float("nan")
VOID = {"meta", "img", "br", "link", "hr"}
CLASSIFIERS = ("threshold_peak", "svm_pair", "trees_features")


class Page(HTMLParser):
    """What a page consists of; an element that is closed wrongly is an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.rows: list[list[str]] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.open += [tag] * (tag not in VOID)
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))
        if "td" in self.open:
            self.rows[-1][-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """Return the attributes of every element of that name."""
        return [attributes for name, attributes in self.tags if name == tag]

    def cells(self, *first: str) -> list[list[str]]:
        """Return the cells of the table rows that begin with these."""
        return [row for row in self.rows if row[: len(first)] == [*first]]

    @property
    def text(self) -> str:
        """All that can be read, blanks made one."""
        return " ".join(" ".join(text for tag, text in self.texts if tag != "style").split())


@pytest.fixture(scope="module")
def files(contest: Comparison) -> dict[str, bytes]:
    return report.make(contest, name="small")


@pytest.fixture(scope="module")
def page(files: dict[str, bytes]) -> Page:
    return Page(files["report.html"].decode())


# ---------------------------------------------------------------- the page


def test_the_page_needs_nothing_from_elsewhere(page: Page, files: dict[str, bytes]) -> None:
    text = files["report.html"].decode()
    assert not re.search(r"https?://|@import|url\(", text)
    assert not page.all("script") and not page.all("link") and not page.all("iframe")
    assert len(page.all("img")) == 7
    assert all(
        str(image["src"]).startswith("data:image/svg+xml;base64,") and image["alt"]
        for image in page.all("img")
    )


def test_its_images_are_the_figures(page: Page, files: dict[str, bytes]) -> None:
    shown = {b64decode(str(image["src"]).partition(",")[2]) for image in page.all("img")}
    drawn = {content for name, content in files.items() if name.startswith("figures/")}
    assert shown == drawn and len(drawn) == 7


def test_links_lead_to_places_on_the_page(page: Page) -> None:
    places = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert page.all("a") and all(
        str(link["href"]).removeprefix("#") in places for link in page.all("a")
    )


def test_everyone_and_everything_is_on_the_page(page: Page, contest: Comparison) -> None:
    for name in (
        *CLASSIFIERS,
        "keep_everything",
        "keep_nothing",
        "oracle",
        "chance",
        *contest.sets,
        "hall",
        "gated",
    ):
        assert name in page.text
    assert all(dataset.digest in page.text for dataset in contest.sets.values())
    assert "7 trained runs, seeds 0, 1" in page.text


def test_the_first_sentence_says_what_the_comparison_found(page: Page, contest: Comparison) -> None:
    best = tables.chosen(contest, "scattered")
    where = {"classifier": best, "trained_on": "scattered", "tested_on": "hall_0dB/gated"}
    found = {row["metric"]: row for row in pick(contest.rows, seed="", **where)}
    removed, kept = (
        "{} [{}, {}] %".format(
            *(f"{100 * found[metric][key]:.0f}" for key in ("value", "ci_low", "ci_high"))
        )
        for metric in ("spurious_removal", "true_retention")
    )
    sentence = f"In hall at 0 dB, {best} trained on scattered removes {removed} of the spurious points and keeps"
    assert f"{sentence} {kept} of the true ones" in page.text
    [test] = pick(contest.tests, **where)
    assert (
        f"its balanced accuracy differs from the bare threshold's by {100 * test['difference']:+.1f} ["
        in page.text
    )


def test_every_cell_of_the_generalisation_table_is_there(page: Page, contest: Comparison) -> None:
    cells = pick(contest.rows, metric="auc", seed="", snr_db="", tested_on=tuple(contest.sets))
    assert len(cells) == 3 * (3 + 2 + 1)
    for cell in cells:
        assert f"{cell['value']:.2f} [{cell['ci_low']:.2f}, {cell['ci_high']:.2f}]" in page.text


def test_the_same_comparison_gives_the_same_report(files: dict[str, bytes], compared: Path) -> None:
    """In another process, by way of the disk."""
    assert all((compared / name).read_bytes() == content for name, content in files.items())


# ---------------------------------------------------------------- what is drawn


def test_maps_are_drawn_before_and_after_the_filter(contest: Comparison) -> None:
    [before, after] = report.panels(contest, "-10", source="scattered", best="svm_pair")
    heard = contest.heard["hall_-10dB", "gated"]
    assert before[1] is heard and after[1] is heard
    assert before[0] == "hall m, SNR -10 dB: every estimate"
    assert after[0] == "hall m, SNR -10 dB: filtered by svm_pair"
    assert before[2].all()
    answer = answer_map(contest.runs["svm_pair", "scattered"][0], heard)
    assert np.array_equal(after[2], answer.confidence >= answer.threshold) and not after[2].all()


def test_quality_is_drawn_over_snr_with_the_main_direction(contest: Comparison) -> None:
    whole = pick(contest.rows, seed="")
    lines = report.quality(contest, whole, "scattered")["hall"]
    assert set(lines) == set(CLASSIFIERS)
    for name, rows in lines.items():
        assert [
            (row["classifier"], row["tested_on"], row["snr_db"], row["metric"]) for row in rows
        ] == [
            (name, f"hall_{snr_db}dB/gated", snr_db, "balanced_accuracy") for snr_db in ("0", "-10")
        ]


def test_directions_are_drawn_without_a_filter(contest: Comparison) -> None:
    lines = report.unfiltered(contest, pick(contest.rows, seed=""))["hall"]
    assert list(lines) == ["gated", "snls"]
    shares = [row["value"] for row in lines["snls"]]
    expected = [
        contest.heard[f"hall_{snr_db}dB", "snls"].sheet.reference.mean() for snr_db in ("0", "-10")
    ]
    assert shares == pytest.approx(expected)


# ---------------------------------------------------------------- comparisons of another kind


def only(contest: Comparison, *classifiers: str) -> Comparison:
    """Return a comparison as if only these had been trained."""
    runs = {who: runs for who, runs in contest.runs.items() if who[0] in classifiers}
    yards = {row["classifier"] for row in contest.rows if row["trained_on"] == "-"}
    rows = pick(contest.rows, classifier=(*classifiers, *yards))
    return replace(contest, runs=runs, rows=rows, tests=pick(contest.tests, classifier=classifiers))


def test_thresholds_alone_make_a_report_and_so_does_one_walk(contest: Comparison) -> None:
    """The threshold is then the best there is, and nothing is tested against it; one walk has one
    map."""
    few = only(contest, "threshold_peak")
    heard = {pair: walk for pair, walk in few.heard.items() if pair[0] == "hall_0dB"}
    rows = [row for row in few.rows if not row["tested_on"].startswith("hall_-10dB")]
    made = report.make(replace(few, heard=heard, rows=rows), name="small")
    page = Page(made["report.html"].decode())
    assert "In hall at 0 dB, threshold_peak trained on scattered removes" in page.text
    assert "from the bare threshold's" not in page.text
    assert "0 tests" in page.text and "svm_pair |" not in made["table.md"].decode()
    assert "figures/maps_first.svg" in made and "figures/maps_last.svg" not in made
    assert len(page.all("img")) == 6


def test_without_surveys_there_are_no_maps(contest: Comparison) -> None:
    """Nor can the comparison's name break the page."""
    sets = tuple(contest.sets)
    rows, tests = (pick(table, tested_on=sets) for table in (contest.rows, contest.tests))
    made = report.make(
        replace(contest, heard={}, rows=rows, tests=tests), name="<script>x</script>"
    )
    page = Page(made["report.html"].decode())
    assert {name for name in made if name.endswith(".svg")} == {
        "figures/arrival_times.svg", "figures/bands.svg", "figures/belief.svg"
    }  # fmt: skip
    assert len(page.all("img")) == 3 and not page.all("script")
    assert all(name in page.text for name in CLASSIFIERS)
    assert "True points kept" not in made["table.md"].decode()


def test_rooms_may_be_heard_at_different_snrs(contest: Comparison) -> None:
    """Each has its own columns; what was not walked is left empty; an unusual SNR has no tables."""
    rows, heard = list(contest.rows), dict(contest.heard)
    for walk, snr_db, old in (("barn_-5dB", -5.0, "hall_-10dB"), ("shed_7dB", 7.0, "hall_0dB")):
        for row in contest.rows:
            if row["tested_on"].startswith(old):
                place = row["tested_on"].replace(old, walk)
                rows.append(row | {"tested_on": place, "snr_db": f"{snr_db:g}"})
        for (name, localizer), known in contest.heard.items():
            if name == old:
                sheet = replace(known.sheet, snr_db=np.full(len(known.points), snr_db))
                heard[walk, localizer] = replace(known, sheet=sheet)
    page = Page(
        report.make(replace(contest, heard=heard, rows=rows), name="small")["report.html"].decode()
    )
    assert (
        "In hall at 0 dB" in page.text
        and "In barn at -5 dB" in page.text
        and "In shed" not in page.text
    )
    for room, filled in (("hall", [0, 1]), ("barn", [2]), ("shed", [3])):
        for localizer in ("gated", "snls"):
            everything, saved = page.cells(room, localizer)
            assert (len(everything), len(saved)) == (3 + 4, 2 + 4)
            for cells in (everything[3:], saved[2:]):
                assert [column for column, cell in enumerate(cells) if cell] == filled


# ---------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("value", "expected"), [(0.123, "12"), (1.0, "100"), (NAN, ""), ("", ""), (None, "")]
)
def test_percent(value: Any, expected: str) -> None:
    assert report.percent(value) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(0.125, "0.12"), (0.9999, "1.00"), (NAN, ""), ("", ""), (None, "")]
)
def test_figure(value: Any, expected: str) -> None:
    assert report.figure(value) == expected


def test_an_interval_is_shown_where_there_is_one() -> None:
    row = {"value": 0.756, "ci_low": 0.7, "ci_high": 0.81}
    assert report.interval(row) == "0.76 [0.70, 0.81]"
    assert report.interval(row, 100, 0) == "76 [70, 81]"
    assert report.interval(row | {"ci_low": NAN, "ci_high": NAN}) == "0.76"
    assert report.interval(row | {"value": NAN}) == report.interval(None) == ""


def test_a_difference_has_a_sign() -> None:
    assert (
        report.signed({"difference": 0.031, "ci_low": -0.002, "ci_high": 0.06})
        == "+3.1 [-0.2, +6.0]"
    )


def test_worse_than_a_coin_is_red_and_better_is_blue() -> None:
    assert report.shade(0.5).endswith(" 0.00)")
    assert report.shade(1.0) == "rgba(0, 114, 178, 0.42)"
    assert report.shade(0.25) == "rgba(213, 94, 0, 0.21)"


def test_the_machine_is_described() -> None:
    found = report.machine()
    assert re.fullmatch(r".+, \d+ cores", found["processor"])
    assert f"numpy {np.__version__}" in found["libraries"]


# ---------------------------------------------------------------- the table, here and in a README


def test_the_table_has_a_line_per_contestant(files: dict[str, bytes], contest: Comparison) -> None:
    lines = [
        line.strip("| ").split(" | ")
        for line in files["table.md"].decode().splitlines()
        if line.count("|") == 5
    ]
    assert lines[0] == ["classifier", "hall, -10 dB", "hall, 0 dB", "AUC"]
    body = {
        cells[0].removesuffix(" **(chosen)**"): cells[1:]
        for cells in lines[2:]
        if " / " in cells[1]
    }
    assert set(body) == {*CLASSIFIERS, "keep_everything", "keep_nothing", "oracle", "chance"}
    assert [cells[0] for cells in lines if "chosen" in cells[0]] == [
        f"{tables.chosen(contest, 'scattered')} **(chosen)**"
    ]
    for column, walk in enumerate(("hall_-10dB/gated", "hall_0dB/gated")):
        where = {
            "classifier": "threshold_peak",
            "trained_on": "scattered",
            "tested_on": walk,
            "seed": "",
        }
        shares = [
            pick(contest.rows, metric=m, **where)[0]["value"]
            for m in ("true_retention", "spurious_removal")
        ]
        assert body["threshold_peak"][column] == " / ".join(
            f"{100 * share:.0f}" for share in shares
        )


@pytest.fixture
def finished(files: dict[str, bytes], tmp_path: Path) -> Path:
    """Return the folder of a comparison that has been written."""
    for name, content in files.items():
        path = tmp_path / "done" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return tmp_path / "done"


def test_the_table_and_the_reports_path_are_printed(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report.show(finished, readme=None)
    printed = capsys.readouterr().out
    assert printed.startswith((finished / "table.md").read_text())
    assert printed.endswith(f"\n{finished / 'report.html'}\n")


def test_a_readme_gets_the_table_between_its_markers_and_the_map(
    finished: Path, tmp_path: Path
) -> None:
    readme, table = tmp_path / "README.md", (finished / "table.md").read_text()
    before, after = "# Title\n\n<!-- another -->\r\n", "\n\n## Mehr über\n"
    readme.write_bytes(f"{before}{report.RESULTS.begin}\nold\n{report.RESULTS.end}{after}".encode())
    report.show(finished, readme=readme)
    once = readme.read_bytes()
    assert once == f"{before}{report.RESULTS.begin}\n{table}\n{report.RESULTS.end}{after}".encode()
    lowest = finished / "figures" / "maps_last.svg"
    assert (tmp_path / "docs" / "before_after.svg").read_bytes() == lowest.read_bytes()
    report.show(finished, readme=readme)
    assert readme.read_bytes() == once


def test_without_maps_the_readmes_picture_stays(finished: Path, tmp_path: Path) -> None:
    for picture in (finished / "figures").glob("maps_*.svg"):
        picture.unlink()
    (tmp_path / "README.md").write_text(f"{report.RESULTS.begin}{report.RESULTS.end}")
    report.show(finished, readme=tmp_path / "README.md")
    assert not (tmp_path / "docs").exists()
    assert "| classifier |" in (tmp_path / "README.md").read_text()


@pytest.mark.parametrize(
    "text",
    [
        "nothing",
        report.RESULTS.begin,
        report.RESULTS.end,
        f"{report.RESULTS.end}{report.RESULTS.begin}",
        2 * f"{report.RESULTS.begin}{report.RESULTS.end}",
    ],
)
def test_a_readme_without_the_markers_is_left_alone(
    finished: Path, tmp_path: Path, text: str
) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(text)
    with pytest.raises(
        BadValue, match=r"^readme=.*README.md: a file with one <!-- results.* and then one <!-- end"
    ):
        report.show(finished, readme=readme)
    assert readme.read_text() == text


def test_a_readme_that_is_not_there_is_named(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(BadValue, match=r"^readme=.*no.md: cannot be read"):
        report.show(finished, readme=tmp_path / "no.md")


def test_the_projects_readme_has_the_markers() -> None:
    before, after = around(Path(__file__).parents[2] / "README.md", report.RESULTS)
    assert before.endswith(report.RESULTS.begin) and after.startswith(report.RESULTS.end)
