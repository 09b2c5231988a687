"""The report: one page that needs nothing else, whose numbers are those of the comparison, and a
README's table."""

import csv
import re
from base64 import b64encode
from dataclasses import replace
from functools import partial
from hashlib import sha256
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from echolearn.checks import BadValue
from echolearn.comparison import (
    choice,
    drawings,
    examined_figures,
    figures,
    report,
    tables,
    template,
)
from echolearn.comparison.compare import page_files
from echolearn.comparison.examined import Examined, examined_facts
from echolearn.comparison.looks import looks_of
from echolearn.comparison.map_pairs import map_pairs
from echolearn.comparison.shown import Shown
from echolearn.comparison.tables import placed
from echolearn.evaluation.rows import pick
from echolearn.storage.marked_page import around
from echolearn.training.predictions import predict_echoes

NAN = float("nan")
BEGIN, END, _ = report.RESULTS
VOID = {"meta", "br"}
CLASSIFIERS = ("threshold_peak", "svm_pair", "trees_features")
REFERENCES = ("keep_everything", "keep_nothing", "oracle", "chance")


HIDDEN = ("style", "script")


class Page(HTMLParser):
    """What a page consists of; an element that is closed wrongly is an error."""

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.tags = []
        self.texts = []
        self.rows = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.open += [tag] * (tag not in VOID)
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self.open[-1] if self.open else "", data))
        if "td" in self.open:
            self.rows[-1][-1] += data

    def all(self, tag):
        """Return the attributes of every element of that name."""
        return [attributes for name, attributes in self.tags if name == tag]

    def cells(self, *first):
        """Return the cells of the table rows that begin with these."""
        return [row for row in self.rows if row[: len(first)] == [*first]]

    @property
    def text(self):
        """All that can be read, blanks made one."""
        return " ".join(" ".join(text for tag, text in self.texts if tag not in HIDDEN).split())


@pytest.fixture(scope="module")
def files(compared):
    """Return what `compare` has written, by name."""
    paths = (path for path in compared.rglob("*") if path.is_file())
    return {str(path.relative_to(compared)): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def page(files):
    return Page(files["report.html"].decode())


@pytest.fixture(scope="module")
def rows(comparison):
    """Return the means over seeds, with places."""
    return placed(pick(comparison.rows, seed=""), comparison.surveys.values())


# ---------------------------------------------------------------- the page


def test_the_page_needs_nothing_from_elsewhere(page, files):
    """Its images are the figures, each told in words; its links lead to places on the page."""
    text = files["report.html"].decode()
    assert not re.search(r"https?:|//\w|@import|url\((?!#)", text.replace("// ", ""))
    assert not {tag for tag, _ in page.tags} & {"img", "link", "iframe", "object", "embed"}
    places = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(places) == len({*places})
    links = [value for _, each in page.tags for key, value in each.items() if key.endswith("href")]
    assert page.all("a") and page.all("use")
    inside = [link for link in links if not link.startswith("data:image/png;base64,")]
    assert {link.removeprefix("#") for link in inside} <= {*places}
    told = [attributes["aria-label"] for attributes in page.all("svg")]
    drawn = {name for name in files if name.startswith("figures/")}
    # What shows several maps at once is for a README; the page lays them over each other.
    apart = {"figures/maps_first.svg", "figures/maps_last.svg"}
    assert apart < drawn and len(told) == len({*told}) == len(drawn - apart) == 16
    assert all(each["role"] == "img" for each in page.all("svg")) and all(told)


def test_only_the_pages_own_script_may_run(page, files):
    [script] = page.all("script")
    [policy] = [meta["content"] for meta in page.all("meta") if "http-equiv" in meta]
    assert "default-src 'none'" in policy and script == {}
    text = template.template_text("report.js")
    proof = b64encode(sha256(text.encode()).digest()).decode()
    assert f"script-src 'sha256-{proof}'" in policy
    assert f"<script>{text}</script>" in files["report.html"].decode()


def answered(files):
    return list(csv.DictReader(StringIO(files["answer.csv"].decode())))


def test_the_first_screen_says_what_the_tables_hold(page, files):
    """The filter's figure is in results.csv, its paired difference in tests.csv."""
    read = {
        name: list(csv.DictReader(StringIO(files[name].decode())))
        for name in ("results.csv", "tests.csv")
    }
    found = answered(files)
    assert len(found) == 2 and {row["snr_db"] for row in found} == {"-10"}
    for row in found:
        where = {"tested_on": "hall_-10dB", "localizer": "gated", "trained_on": "scattered"}
        where |= {"metric": row["metric"]}
        for who, value in (("classifier", "value"), ("against", "against_value")):
            [known] = pick(read["results.csv"], classifier=row[who], seed="", **where)
            assert row[value] == known["value"]
        where |= {"test": "swaps", "classifier": row["classifier"], "against": row["against"]}
        turned = where | {"classifier": row["against"], "against": row["classifier"]}
        tests = pick(read["tests.csv"], **where)
        keys, sign = ("difference", "ci_low", "ci_high"), 1
        if not tests:
            tests, sign, keys = pick(read["tests.csv"], **turned), -1, (keys[0], *keys[:0:-1])
        values = [float(row[key]) for key in ("difference", "difference_low", "difference_high")]
        assert values == [sign * float(tests[0][key]) for key in keys]
        value, low, high = (f"{100 * each:+.1f}" for each in values)
        assert f"{value} [{low}, {high}]" in page.text
    best, bare = found
    assert bare["against"] == "threshold_peak" != best["against"]
    assert float(best["against_value"]) >= float(bare["against_value"])


def test_own_sets_bring_none_of_the_papers_text(page, comparison):
    """Nor of anybody's; where a set of the paper is among them, it is there."""
    assert "paper" not in page.text.lower()
    sets = {"paper": comparison.sets["grid"], **comparison.sets}
    facts = tables.gather(replace(comparison, sets=sets))
    assert facts["paper"] and not tables.gather(comparison)["paper"]


def test_a_classifier_has_one_look_everywhere(comparison, monkeypatch):
    """In every figure a line of its name has its colour and marker; no two share both."""
    looks = looks_of(comparison.models)
    assert len({*looks.values()}) == len(looks) == 3
    seen = set()
    plain = figures.as_svg

    def noted(figure, **about):
        for line in [line for axis in figure.axes for line in axis.lines]:
            seen.add((line.get_label(), line.get_color(), line.get_marker()))
        bars = [bar for axis in figure.axes for bar in axis.containers]
        for bar in [bar for bar in bars if isinstance(bar, ErrorbarContainer)]:
            seen.add((bar.get_label(), bar[0].get_color(), bar[0].get_marker()))
        return plain(figure, **about)

    for module in (figures, examined_figures):
        monkeypatch.setattr(module, "as_svg", noted)
    drawings.draw_all(comparison, map_pairs(comparison))
    for name, look in looks.items():
        assert {each[1:] for each in seen if each[0] == name} == {(look.colour, look.marker)}


def test_everyone_and_everything_is_on_the_page(page, comparison):
    for name in (*CLASSIFIERS, *REFERENCES, *comparison.sets, "6x5x4", "gated"):
        assert name in page.text
    for dataset in comparison.sets.values():
        assert dataset.digest in page.text
    assert "7 trained runs, seeds 0, 1" in page.text


def test_the_first_sentence_says_what_the_comparison_found(page, comparison):
    best = choice.chosen(comparison)
    where = best._asdict() | {"tested_on": "hall_-10dB", "localizer": "gated"}
    told = []
    for metric in ("spurious_removal", "true_retention"):
        [row] = pick(comparison.rows, seed="", metric=metric, **where)
        value, low, high = (100 * row[key] for key in ("value", "ci_low", "ci_high"))
        told.append(f"{value:.0f} [{low:.0f}, {high:.0f}] %")
    assert (
        f"In 6x5x4 at -10 dB, {best.classifier} trained on scattered removes {told[0]} of the "
        f"spurious points and keeps {told[1]} of the true ones"
    ) in page.text
    [test] = pick(comparison.tests, test="swaps", against="threshold_peak", **where)
    points = f"{100 * test['difference']:+.1f}"
    assert f"balanced accuracy differs from the bare threshold's by {points} [" in page.text


def test_every_cell_of_the_generalisation_table_is_there(page, rows):
    cells = pick(rows, kind="set", metric="auc", snr_db="")
    assert len(cells) == 3 * (3 + 2 + 1)
    for cell in cells:
        assert template.with_interval(cell) in page.text


# ---------------------------------------------------------------- what is drawn


def test_maps_are_drawn_before_and_after_the_filter_the_lowest_snr_first(
    comparison, files, monkeypatch
):
    drawn = []
    paint = figures.paint_map

    def noted(axis, *given, **about):
        drawn.append((given, about))
        paint(axis, *given, **about)

    monkeypatch.setattr(figures, "paint_map", noted)
    svg = drawings.filtered(comparison, map_pairs(comparison), snr_db="-10")
    assert svg.encode() == files["figures/maps_first.svg"] != files["figures/maps_last.svg"]
    survey = comparison.surveys["hall_-10dB", "gated"]
    best = choice.chosen(comparison)
    predicted = predict_echoes(comparison.models[best][0], survey)
    kept = predicted.confidence >= predicted.threshold
    ways = ("every estimate", kept | True), (f"filtered by {best.classifier}", kept)
    for (given, about), (told, expected) in zip(drawn, ways, strict=True):
        assert given == (survey,)
        assert about["title"] == f"6x5x4 m, SNR -10 dB: {told}"
        assert np.array_equal(about["kept"], expected)
    assert kept.any() and not kept.all()


def test_quality_is_drawn_over_snr_with_the_main_localizer(comparison, rows):
    lines = drawings.quality(comparison, rows)["6x5x4"]
    assert set(lines) == set(CLASSIFIERS)
    for name, found in lines.items():
        assert found == pick(
            rows,
            classifier=name,
            trained_on="scattered",
            kind="survey",
            localizer="gated",
            metric="balanced_accuracy",
        )
        assert [row["snr_db"] for row in found] == ["0", "-10"]


# ---------------------------------------------------------------- comparisons of another kind


def only(comparison, **wanted):
    """Return a comparison as if these had been all."""
    rows, tests = (pick(table, **wanted) for table in (comparison.rows, comparison.tests))
    return replace(comparison, rows=rows, tests=tests)


def test_thresholds_alone_make_a_report_and_so_does_one_walk(comparison):
    """The threshold is then the best there is, nothing is tested against it, one walk has one
    map."""
    models = {who: runs for who, runs in comparison.models.items() if who.role == "baseline"}
    surveys = {pair: each for pair, each in comparison.surveys.items() if pair[0] == "hall_0dB"}
    few = only(
        replace(comparison, models=models, surveys=surveys),
        role=("baseline", "reference"),
        tested_on=(*comparison.sets, "hall_0dB"),
    )
    made = page_files(few, name="small", examined=Examined())
    page = Page(made["report.html"].decode())
    assert "In 6x5x4 at 0 dB, threshold_peak trained on scattered removes" in page.text
    assert "from the bare threshold's" not in page.text
    assert "0 tests" in page.text and "svm_pair |" not in made["table.md"].decode()
    assert "figures/maps_first.svg" in made and "figures/maps_last.svg" not in made
    # Without a rival there is no difference to be shown.
    assert "no yardstick was tested beside it" in page.text


def test_without_surveys_there_are_no_maps(comparison):
    """Nor can the comparison's name break the page."""
    bare = only(replace(comparison, surveys={}), kind="set")
    made = page_files(bare, name="<script>x</script>", examined=Examined())
    page = Page(made["report.html"].decode())
    dots = {f"figures/dots_{number}.svg" for number in (1, 2, 3)}
    drawn = {name for name in made if name.endswith(".svg")}
    assert drawn - dots == {
        "figures/arrival_times.svg", "figures/bands.svg", "figures/belief.svg"
    } and dots < drawn  # fmt: skip
    assert len(page.all("svg")) == 6 and len(page.all("script")) == 1
    assert "<script>x</script>" in page.text
    for name in CLASSIFIERS:
        assert name in page.text
    table = made["table.md"].decode()
    assert "True points kept" not in table
    # What a split holds out of the grid is little.
    few = {row["n"] for row in pick(bare.rows, tested_on="grid", metric="auc", snr_db="")}
    assert few and all(count < template.FEW for count in few)
    assert all(f" ({count} echoes)" in text for count in few for text in (table, page.text))


def test_rooms_may_be_walked_at_different_snrs(comparison):
    """Each has its own cells; what was not walked is left empty; an unusual SNR has no tables."""
    rows = list(comparison.rows)
    surveys = dict(comparison.surveys)
    for room, snr_db, old in (("barn", -5.0, "hall_-10dB"), ("shed", 7.0, "hall_0dB")):
        here = {"tested_on": room, "room": room}
        for row in pick(comparison.rows, tested_on=old):
            rows.append(row | here | {"snr_db": f"{snr_db:g}"})
        for localizer in ("gated", "snls"):
            known = surveys[old, localizer]
            labelled = replace(
                known.labelled,
                source=known.labelled.source._replace(**here),
                joint_snr_db=np.full(len(known.points), snr_db),
            )
            surveys[room, localizer] = replace(known, labelled=labelled)
    changed = replace(comparison, surveys=surveys, rows=rows)
    facts = tables.gather(changed) | examined_facts(Examined(), changed)
    names = ["quality", "arrival_times", "directions", "bands", "belief"]
    names += [f"map_{number}_{side}" for number in range(1, 9) for side in ("every", "kept")]
    names += [f"dots_{number}" for number in range(1, 20)]
    shown = {"drawings": dict.fromkeys(names, "<svg />")}
    shown["shown"] = Shown(pairs=map_pairs(changed))
    page = Page(report.report_page(changed, facts | {"name": ""}, **shown))
    assert "In 6x5x4 at -10 dB" in page.text and "In barn at -5 dB" in page.text
    assert "In shed" not in page.text
    for room, filled in (("6x5x4", [0, 1]), ("barn", [2]), ("shed", [3])):
        for localizer in ("gated", "snls"):
            everything, saved = page.cells(room, localizer)
            assert (len(everything), len(saved)) == (3 + 4, 2 + 4)
            for cells in (everything[3:], saved[2:]):
                assert [column for column, cell in enumerate(cells) if cell] == filled


# ---------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("value", "percent", "figure"),
    [(0.125, "12", "0.12"), (0.9999, "100", "1.00"), (NAN, "", ""), ("", "", ""), (None, "", "")],
)
def test_figures_are_rounded_and_undefined_ones_left_out(value, percent, figure):
    assert (template.number(value, 100, 0), template.number(value)) == (percent, figure)


def test_an_interval_is_shown_where_there_is_one_and_a_difference_has_a_sign():
    row = {"value": 0.756, "ci_low": 0.7, "ci_high": 0.81}
    assert template.with_interval(row) == "0.76 [0.70, 0.81]"
    assert template.with_interval(row, 100, 0) == "76 [70, 81]"
    assert template.with_interval(row | {"ci_low": NAN, "ci_high": NAN}) == "0.76"
    assert template.with_interval(row | {"value": NAN}) == template.with_interval(None) == ""
    # Of nothing that is kept there is no precision, nor a mean over seeds of which one keeps none.
    nothing = row | {"value": NAN, "metric": "precision"}
    assert template.with_interval(nothing) == template.precision(nothing) == "a seed keeps nothing"
    assert template.precision(row) == "76"
    test = {"difference": 0.031, "ci_low": -0.002, "ci_high": 0.06}
    assert template.signed(test) == "+3.1 [-0.2, +6.0]"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"n": 29}, " (29 echoes)"),
        ({"n": template.FEW}, ""),
        ({"n": 29, "metric": "other_array"}, ""),
        ({"n": 29, "value": NAN}, ""),
    ],
)
def test_a_figure_of_few_echoes_says_how_many(more, said):
    assert template.of_few({"metric": "auc", "value": 1.0} | more) == said
    assert template.of_few(None) == ""


def test_worse_than_a_coin_is_red_and_better_is_blue():
    assert template.shade(0.5).endswith(" 0.00)")
    assert template.shade(1.0) == "rgba(0, 114, 178, 0.42)"
    assert template.shade(0.25) == "rgba(213, 94, 0, 0.21)"


def test_the_machine_is_described():
    found = report.machine()
    assert re.fullmatch(r".+, \d+ cores", found["processor"])
    assert f"numpy {np.__version__}" in found["libraries"]


# ---------------------------------------------------------------- the table, here and in a README


def test_the_table_has_a_line_per_model(files, comparison):
    lines = {}
    for line in files["table.md"].decode().splitlines():
        if line.count("|") == 5:
            name, *cells = line.strip("| ").split(" | ")
            lines[name] = cells
    assert lines["classifier"] == ["6x5x4, -10 dB", "6x5x4, 0 dB", "AUC"]
    best = choice.chosen(comparison).classifier
    lines[best] = lines.pop(f"{best} **(chosen)**")
    assert {*CLASSIFIERS, *REFERENCES} == set(lines) - {"classifier", "---|---|---|---"}
    where = {"classifier": "threshold_peak", "trained_on": "scattered", "localizer": "gated"}
    for cell, walk in zip(lines["threshold_peak"], ("hall_-10dB", "hall_0dB"), strict=False):
        metrics = ("true_retention", "spurious_removal")
        found = pick(comparison.rows, seed="", tested_on=walk, metric=metrics, **where)
        shares = [f"{100 * row['value']:.0f}" for row in found]
        assert cell == " / ".join(shares)


@pytest.mark.parametrize("maps", [True, False])
def test_a_readme_gets_the_table_between_its_markers_and_the_map(compared, tmp_path, maps):
    """Without maps its picture stays."""
    before, after = "# Title\n\n<!-- another -->\r\n", "\n\n## Mehr über\n"
    readme = tmp_path / "README.md"
    readme.write_bytes(f"{before}{BEGIN}\nold\n{END}{after}".encode())
    names = report.SHOWN if maps else report.SHOWN[:1]
    found = {name: (compared / name).read_bytes() for name in names}
    table = found["table.md"].decode()
    for _ in range(2):
        report.show(found, folder=compared, readme=readme)
        assert readme.read_bytes() == f"{before}{BEGIN}\n{table}\n{END}{after}".encode()
    shown = tmp_path / "docs" / "before_after.svg"
    assert shown.read_bytes() == found[names[1]] if maps else not shown.exists()


@pytest.mark.parametrize("text", ["nothing", BEGIN, END, END + BEGIN, 2 * (BEGIN + END)])
def test_a_readme_without_the_markers_is_left_alone(tmp_path, text):
    show = partial(report.show, {"table.md": b"new"}, folder=tmp_path)
    readme = tmp_path / "README.md"
    readme.write_text(text)
    with pytest.raises(BadValue, match=r"^readme=.*README.md: must be a file with one <!-- resu"):
        show(readme=readme)
    assert readme.read_text() == text
    readme.unlink()
    with pytest.raises(BadValue, match=r"^readme=.*README.md: cannot be read"):
        show(readme=readme)


def test_the_projects_readme_has_the_markers():
    before, after = around(Path(__file__).parents[2] / "README.md", report.RESULTS)
    assert before.endswith(BEGIN) and after.startswith(END)
