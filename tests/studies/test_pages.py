"""A study in a page: tables, figures beside it, everything else untouched; and the page that the
project has."""

import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage.marked_page import Markers, write_between
from echolearn.studies import pages, study
from echolearn.studies.study import Study

PAGE = Path(__file__).parents[2] / "docs" / "studies.md"
BARE = "# Mine\n\nBefore.\n\n{}\nold\n{}\n\nAfter.\n"
SMALL = Study(
    "snr_db",
    [0.0, 10.0],
    Room((6.0, 5.0, 6.0), 0.25),
    Scene(circular_array(), noise_probe(length=8000), Images(), White()),
    {"gated": Gated(azimuths=36)},
    positions=2,
    trials=4,
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    study.run(
        SMALL,
        name="small",
        runs=runs,
        resamples=20,
        command="echolearn study runs=/tmp/x name=small",
    )
    study.run(replace(SMALL, values=[10.0]), name="single", runs=runs, resamples=20)
    return runs / "study"


def bare(tmp_path, name):
    begin, end, _ = pages.markers(name)
    page = tmp_path / "mine.md"
    page.write_text(BARE.format(begin, end))
    return page


def test_a_page_gets_the_table_and_the_figures_and_keeps_what_was_written(runs, tmp_path):
    page = bare(tmp_path, "small")
    pages.publish(runs / "small", page)
    text = page.read_text()
    assert text.startswith("# Mine\n\nBefore.\n\n<!-- study small")
    assert text.endswith("-->\n\nAfter.\n")
    assert "\nold\n" not in text
    assert "n = 4 at each value, over 2 positions. `echolearn study name=small`" in text
    for line in (runs / "small" / "study.md").read_text().splitlines():
        assert line.startswith("# ") or line in text
    for figure in ("toa_doa", "map"):
        copied = tmp_path / "mine" / f"small_{figure}.svg"
        assert copied.read_bytes() == (runs / "small" / "figures" / f"{figure}.svg").read_bytes()
        assert f"(mine/{copied.name})" in text
    assert (tmp_path / "mine" / "small.csv").read_bytes() == (
        runs / "small" / "study.csv"
    ).read_bytes()
    assert "[small.csv](mine/small.csv)" in text


def test_a_second_time_changes_nothing(runs, tmp_path):
    page = bare(tmp_path, "small")
    pages.publish(runs / "small", page)
    once = page.read_bytes()
    pages.publish(runs / "small", page)
    assert page.read_bytes() == once


def test_a_study_of_one_value_has_no_figure_to_show(runs, tmp_path):
    page = bare(tmp_path, "single")
    pages.publish(runs / "single", page)
    assert "| gated | " in page.read_text()
    assert "![" not in page.read_text()
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["single.csv"]


def test_a_page_that_asks_for_it_learns_what_was_expected(runs, tmp_path):
    page = bare(tmp_path, "small")
    page.write_text(page.read_text() + f"\n{pages.EXPECTED.begin}\n{pages.EXPECTED.end}\n")
    with pytest.raises(BadValue, match=r"mine/expected\.csv: cannot be read"):
        pages.publish(runs / "small", page)
    columns, row = (
        "what,study,localizer,metric,at,share,trials,limit,beside,source,why",
        "it,small,gated,toa,10.0,0,,>=,,us,",
    )
    (tmp_path / "mine" / "expected.csv").write_text(f"{columns}\n{row}\n")
    pages.publish(runs / "small", page)
    assert re.search(r"\| it \| >= 0 \| us \| .* n = 4 \|  \|  \| yes \|", page.read_text())


def write_often(page, name):
    """Write a section again and again, and tell whether what was written last was ever lost."""
    marks = Markers(f"<{name}>", f"</{name}>", "page")
    whole = []
    for number in range(100):
        write_between(page, f"{name}{number}", marks)
        whole.append(f"{name}{number}\n" in page.read_text())
    return all(whole)


def test_commands_that_share_a_page_wait_for_each_other(tmp_path):
    page = tmp_path / "mine.md"
    page.write_text("<a>\n</a>\n<b>\n</b>\n")
    with ProcessPoolExecutor(2) as pool:
        assert all(pool.map(write_often, [page, page], "ab"))
    assert page.read_text() == "<a>\na99\n</a>\n<b>\nb99\n</b>\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.md"]


def test_a_damaged_study_is_not_published(runs, tmp_path):
    page, table = bare(tmp_path, "small"), runs / "small" / "study.md"
    before, whole = page.read_bytes(), table.read_bytes()
    table.write_bytes(whole.replace(b"chance", b"chanse"))
    with pytest.raises(BadValue, match=r"study\.md"):
        pages.publish(runs / "small", page)
    table.write_bytes(whole)
    assert page.read_bytes() == before


def test_a_page_without_its_markers_stops_a_study_before_it_begins(tmp_path, capsys):
    page = bare(tmp_path, "another")
    words = ["study", "experiment=faults", f"page={page}", f"runs={tmp_path / 'runs'}"]
    assert main.main(words) == 1
    assert "<!-- study faults: written by `echolearn study` -->" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_the_projects_figures_are_there_small_and_all_used():
    shown = re.findall(r"!\[.+?\]\((.+?)\)", PAGE.read_text())
    tables = re.findall(r"\]\((studies/\w+\.csv)\)", PAGE.read_text())
    assert {*tables} == {
        path.relative_to(PAGE.parent).as_posix() for path in (PAGE.parent / "studies").glob("*.csv")
    }
    there = sorted(
        path.relative_to(PAGE.parent).as_posix() for path in (PAGE.parent / "studies").glob("*.svg")
    )
    assert sorted(shown) == there
    assert max((PAGE.parent / name).stat().st_size for name in shown) < 200_000
