"""A study from end to end: what it finds, its resumption, other studies of its name; its page."""

import csv
import re
import shutil
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from children import begin
from echolearn.acoustics.types import MicArray
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.localization.methods.joint import Joint
from echolearn.storage import manifests
from echolearn.storage.identity import plain
from echolearn.studies import page as pages
from echolearn.studies.run import run_study
from reference import RING

PAGE = Path(__file__).parents[2] / "docs" / "studies.md"


@pytest.fixture(scope="module")
def brief(small):
    """Return a study of one level and few recordings."""
    one = {"gated": small.localizers["gated"]}
    return replace(small, values=[10.0], positions=2, trials=4, localizers=one)


@pytest.fixture(scope="module")
def carried_out(brief, tmp_path_factory):
    """Return its folder; not to be changed."""
    return run_study(brief, name="small", runs=tmp_path_factory.mktemp("brief"), resamples=20)


@pytest.fixture
def copied(carried_out, tmp_path):
    """Return a copy of it, below `tmp_path`."""
    return shutil.copytree(carried_out, tmp_path / "study" / "small")


def content(folder):
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_estimators_are_perfect_in_quiet_and_guess_in_noise(folder):
    assert manifests.verify(folder)["kind"] == "study"
    with (folder / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 3 * 4
    shares = {}
    for row in rows:
        figures = [float(row[key]) for key in ("value", "ci_low", "ci_high")]
        shares[row["localizer"], row["snr_db"], row["metric"]] = figures
    lines = (folder / "study.md").read_text().splitlines()
    assert "| | -30.0 | 0.0 | 10.0 |" in lines
    for localizer in ("gated", "joint"):
        toa = [100 * shares[localizer, level, "toa"][0] for level in ("-30.0", "0.0", "10.0")]
        assert f"| {localizer} | {toa[0]:.0f} | {toa[1]:.0f} | {toa[2]:.0f} |" in lines
        value, low, high = shares[localizer, "10.0", "on_map"]
        assert value == high == 1.0
        assert 0.7 < low < 0.8  # Wilson's for 12 of 12
        assert shares[localizer, "-30.0", "toa"][0] < 0.7
    value, low, high = shares["chance", "10.0", "toa"]
    assert shares["chance", "-30.0", "toa"] == [value, low, high]
    assert 0.03 < low < value < high < 0.3


@pytest.mark.usefixtures("anew")
def test_an_interrupted_study_goes_on_and_ends_the_same(small, folder, tmp_path):
    """By other processes, which change nothing."""
    again = shutil.copytree(folder, tmp_path / "study" / "small")
    kept, *lost = sorted(again.glob("estimates-*/*.npy"))
    before = kept.stat().st_mtime_ns
    command = manifests.load_manifest(folder)["command"]
    for path in (again / manifests.MANIFEST, *lost):
        path.unlink()
    run_study(small, name="small", runs=tmp_path, workers=2, resamples=50, command=command)
    assert content(again) == content(folder)
    assert len(lost) == 2 and kept.stat().st_mtime_ns == before


def test_another_study_of_that_name_is_refused_whatever_is_left_of_it(
    brief, copied, carried_out, tmp_path
):
    given = {"name": "small", "runs": tmp_path, "resamples": 20}
    folder = copied
    [estimates] = folder.glob("estimates-*")
    changes = ({"values": [20.0]}, {"trials": 5}, {"localizers": {"joint": Joint()}})

    def unless_refused():
        before = content(folder)
        for change in changes:
            with pytest.raises(BadValue, match="^name=small: must be a new .* the same settings"):
                run_study(replace(brief, **change), **given)
        assert content(folder) == before

    unless_refused()
    (folder / "study.csv").write_bytes(b"half")
    unless_refused()
    (folder / manifests.MANIFEST).unlink()
    unless_refused()
    shutil.copy(carried_out / manifests.MANIFEST, folder)
    shutil.rmtree(estimates)
    unless_refused()
    run_study(brief, **given)
    assert content(folder) == content(carried_out)


def test_a_study_of_version_0_1_is_told_and_stays(brief, tmp_path):
    """It named classes by their modules, so the digest of the same study was another."""
    folder = tmp_path / "study" / "old"
    (folder / "estimates-b933a90b83e6").mkdir(parents=True)
    (folder / "study.csv").write_text("old")
    with pytest.raises(BadValue, match="other settings or is of an earlier version; remove it"):
        run_study(brief, name="old", runs=tmp_path)
    assert (folder / "study.csv").read_text() == "old"


def test_other_intervals_and_an_older_format_are_made_from_the_same_estimates(
    brief, copied, tmp_path
):
    folder = copied
    [estimates] = folder.glob("estimates-*/*.npy")
    whole, before = content(folder), estimates.stat().st_mtime_ns
    about = manifests.verify(folder) | {"format": 0}
    (folder / "study.md").write_text("as it was")
    manifests.finish(folder, about, files=["study.csv", "study.md"])
    # What killed commands have left.
    for left in (folder / ".study.md", folder / "figures" / ".map.svg"):
        left.with_name(f"{left.name}.0123456789ab.tmp").touch()
    run_study(brief, name="small", runs=tmp_path, resamples=20)
    assert content(folder) == whole
    assert list(folder.rglob(".*")) == []
    run_study(brief, name="small", runs=tmp_path, resamples=30)
    assert manifests.verify(folder)["resamples"] == 30
    assert estimates.stat().st_mtime_ns == before


@pytest.mark.parametrize("seed", [0, 1])
def test_of_two_at_once_the_second_finds_it_finished_or_is_refused(brief, tmp_path, seed):
    one = replace(brief, values=[0.0, 10.0])
    given = {"name": "small", "runs": tmp_path, "resamples": 20}
    child = begin(partial(run_study, one, **given))
    while child.is_alive() and not (tmp_path / "study" / "small").exists():  # made under the lock
        time.sleep(0.001)
    refused = pytest.raises(BadValue, match="^name=small: must be a new name")
    with refused if seed else nullcontext():
        run_study(replace(one, seed=seed), **given)
    child.join()
    assert child.exitcode == 0
    assert manifests.verify(tmp_path / "study" / "small")["study"] == plain(one)


def bare_page(tmp_path, name):
    begin, end, _ = pages.markers(name)
    page = tmp_path / "mine.md"
    page.write_text(f"# Mine\n\nBefore.\n\n{begin}\nold\n{end}\n\nAfter.\n")
    return page


def test_a_page_gets_figures_and_table_and_keeps_the_rest(folder, tmp_path):
    page = bare_page(tmp_path, "small")
    pages.publish(folder, page)
    text = page.read_text()
    assert text.startswith("# Mine\n\nBefore.\n\n<!-- study small")
    assert text.endswith("-->\n\nAfter.\n")
    assert "\nold\n" not in text
    assert "12 recordings at each value" in text
    assert "`echolearn study name=small`" in text  # the folder of this machine is nobody's business
    for name in ("study.csv", "figures/toa_doa.svg", "figures/map.svg"):
        copied = "small" + name.removeprefix("study").replace("figures/", "_")
        assert (tmp_path / "mine" / copied).read_bytes() == (folder / name).read_bytes()
        assert f"(mine/{copied})" in text
    pages.publish(folder, page)
    assert page.read_text() == text


def test_what_the_paper_says_stands_beside_what_was_found(tmp_path):
    shutil.copy(PAGE.parent / "studies" / "paper_snr.csv", tmp_path)
    said = pages.section(tmp_path / "paper_snr.csv", vary="snr_db", command="")
    assert (
        "| the TOA of S-NLS is right in around 80 % at -10 dB | at -10: 79.5 [72.5, 85.5] |" in said
    )
    assert said.rstrip("|").count("; at") == 2


def test_a_study_of_one_value_has_shares_instead_of_figures(carried_out, tmp_path):
    page = bare_page(tmp_path, "small")
    pages.publish(carried_out, page)
    assert "`gated` 100 [51, 100], `chance` " in page.read_text()
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["small.csv"]


def test_arrays_are_a_table_that_says_what_each_cannot_tell_or_that_it_is_refused(
    small, brief, tmp_path
):
    """A line behind its loudspeaker is right on the side that it cannot tell from the other."""
    line = [[-0.1, y, 0.0] for y in (-0.15, -0.05, 0.05, 0.15)]
    places = {"ring": RING.positions, "line": line, "mast": [[0.1, 0.0, z] for z in (0.0, 0.1)]}
    scenes = {
        name: replace(small.scene, array=MicArray(np.array(each))) for name, each in places.items()
    }
    study = replace(brief, vary="array", values=[*places], scenes=scenes, snr_db=20.0)
    folder = run_study(study, name="arrays", runs=tmp_path / "runs", resamples=20)
    page = bare_page(tmp_path, "arrays")
    pages.publish(folder, page)
    table = [line for line in page.read_text().splitlines() if line.startswith("|")]
    assert table[0] == "| directions within 5 degrees, in % | gated | chance | |"
    assert re.match(
        r"\| `ring` \| 100 \| \d+ \| a level plane: cannot tell up from down \|", table[2]
    )
    assert re.match(r"\| `line` \| 100 \| \d+ \| a line: cannot tell one side of it", table[3])
    assert re.match(r"\| `mast` \| refused \| \d+ \| an upright line: cannot tell azi", table[4])
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["arrays.csv"]
    with pytest.raises(BadValue, match="^values=cross: must be names of scenes: ring, line, mast"):
        replace(study, values=["cross"])


def test_a_damaged_study_is_not_published(folder, tmp_path):
    broken = tmp_path / "small"
    shutil.copytree(folder, broken)
    (broken / "study.md").write_bytes(b"half")
    page = bare_page(tmp_path, "small")
    before = page.read_bytes()
    with pytest.raises(BadValue, match=r"study\.md"):
        pages.publish(broken, page)
    assert page.read_bytes() == before


def test_a_page_without_its_markers_stops_a_study_before_it_begins(tmp_path, capsys):
    page = bare_page(tmp_path, "another")
    words = ["study", "experiment=faults", f"page={page}", f"runs={tmp_path / 'runs'}"]
    assert main(words) == 1
    assert "<!-- study faults: written by `echolearn study` -->" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_the_projects_figures_and_tables_are_small_and_all_used():
    linked = re.findall(r"\]\((studies/.+?)\)", PAGE.read_text())
    there = list((PAGE.parent / "studies").iterdir())
    assert {*linked} == {f"studies/{path.name}" for path in there}
    assert max(path.stat().st_size for path in there) < 200_000
