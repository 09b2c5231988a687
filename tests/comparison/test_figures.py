"""Figures: the same bytes for the same data, well-formed, true to scale, and showing what they were
given."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from echolearn.acoustics.sides import closed
from echolearn.comparison import figures
from echolearn.comparison.looks import looks
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Predictions, Recordings

POINTS = np.array([[0.0, 2.0], [3.0, 0.05], [5.95, 2.0], [3.0, 3.5], [2.0, 2.0]])
POSES = np.array([[1.5, 2.0], [3.0, 1.5], [4.5, 2.0], [3.0, 2.5], [3.0, 2.0]])
TRUE = np.array([True, True, True, False, False])
KEPT = np.array([True, False, True, True, False])
NOTHING = np.zeros(5, dtype=bool)


def labelled(reference):
    rows = np.arange(len(reference))
    return LabelledRows(Recordings("", "set"), reference, rows, 0.0 * rows, np.ones((1, len(rows))))


def walk():
    """Return a survey of five poses in a room of 6 m by 4 m."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]])
    return LocalizedSurvey(labelled(TRUE), POINTS, POSES, closed(corners), {})


def row(snr_db, value):
    return {"snr_db": snr_db, "value": value, "ci_low": value - 0.1, "ci_high": value + 0.05}


def belief():
    rng = np.random.default_rng(0)
    some = Predictions(0, np.arange(0, 200, 2), rng.random(100), 0.5)
    every = Predictions(0, np.arange(200), rng.random(200), 0.5)
    answers = {"some": some, "every": every}
    return figures.belief(answers, labelled(rng.random(200) < 0.5), looks=looks(answers))


def arrival_times():
    rng = np.random.default_rng(0)
    sets = {name: (rng.random(50), rng.random(50) < 0.5) for name in ("on", "off")}
    return figures.arrival_times(sets)


def over_snr(lines):
    """Draw more lines than there are colours."""
    many = {str(n): [row("0", 0.5), row("-5", 0.4)] for n in range(lines)}
    return figures.over_snr({"room": many}, looks=looks(many), ylabel="y")


def dots():
    rows = [row("", 0.5) | {"classifier": name} for name in "ab"]
    about = {"title": "t", "metric": "m", "best": "a", "low": 0.3}
    return figures.dots(rows, looks=looks("abc"), order="abc", **about)


DRAWN = {
    "maps": lambda: figures.maps([("a", walk(), KEPT), ("b", walk(), NOTHING)], classifier="c"),
    "over_snr": lambda: over_snr(30),
    "bands": lambda: figures.bands(
        {"a": [row("-40:-20", 0.5), row("-5:40", 0.9)], "b": [row("-5:40", 0.8)]}, looks=looks("ab")
    ),
    "undefined": lambda: figures.bands(
        {"a": [row("-5:40", float("nan"))], "b": []}, looks=looks("ab")
    ),
    "belief": belief,
    "dots": dots,
    "single_map": lambda: figures.single_map(walk(), KEPT),
    "arrival_times": arrival_times,
}


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_is_the_same_svg_each_time_and_needs_nothing_else(name):
    """No date, no font, no image: every reference is to the figure itself."""
    first = DRAWN[name]()
    assert first == DRAWN[name]()
    root = ET.fromstring(first)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert {"width", "height", "viewBox"} <= set(root.attrib)
    for node in root.iter():
        assert not node.tag.endswith(("}image", "}text", "}date"))
        links = [value for key, value in node.attrib.items() if key.endswith("href")]
        assert all(link.startswith("#") for link in links)


def test_a_walk_is_a_row_of_two_maps_before_and_after():
    sizes = []
    for walks in (1, 2):
        root = ET.fromstring(figures.maps([("", walk(), KEPT)] * walks, classifier="c"))
        sizes.append([float(root.attrib[side].removesuffix("pt")) for side in ("width", "height")])
    assert sizes[0][0] == sizes[1][0]
    assert sizes[1][1] > 1.5 * sizes[0][1]


def painted(kept=KEPT):
    axis = Figure(figsize=(7, 3)).subplots()
    figures.paint_map(axis, walk(), title="title", kept=kept)
    return axis


def test_a_map_shows_walls_path_and_every_point_once():
    """Kinds of points differ in shape, not in colour alone; all is true to scale."""
    axis = painted()
    lines = {line.get_label(): line for line in axis.lines}
    drawn = {label: np.array(line.get_data()) for label, line in lines.items()}
    assert np.array_equal(drawn["path"].T, POSES)
    assert np.array_equal(drawn["wall"][:, 0], drawn["wall"][:, -1])
    assert drawn["wall"].shape == (2, 5)
    points = {"kept, on a wall": [0, 2], "kept, spurious": [3], "rejected": [1, 4]}
    for label, rows in points.items():
        assert np.array_equal(drawn[label].T, POINTS[rows])
    assert len({lines[label].get_marker() for label in points}) == 3
    assert axis.get_aspect() == 1.0
    assert (*axis.get_xlim(), *axis.get_ylim()) == pytest.approx((-0.6, 6.6, -0.6, 4.6))


def test_the_title_says_how_many_kept_points_are_true():
    assert painted().get_title() == "title\n67% of 3 points on a wall"
    assert painted(NOTHING).get_title() == "title\nno points"


def test_lines_over_snr_have_their_interval():
    _, [axis] = figures.styled(figures.canvas)(1, width=4, height=3)
    figures.paint_line(axis, [row("-10", 0.6), row("0", 0.9)], label="a")
    assert np.array_equal(np.array(axis.lines[0].get_data()), [[-10, 0], [0.6, 0.9]])
    edges = np.array(axis.collections[0].get_paths()[0].vertices)[:, 1]
    assert (edges.min(), edges.max()) == pytest.approx((0.5, 0.95))


def test_the_first_24_looks_differ_and_follow_the_alphabet():
    found = looks(f"{number:02}" for number in range(30))
    assert len({*list(found.values())[:24]}) == 24
    assert len({look.colour for look in found.values()}) == 8
    assert looks("ba") == looks("ab")


def test_both_maps_of_a_pair_have_one_size_whatever_is_kept():
    sizes = {
        ET.fromstring(figures.single_map(walk(), kept)).attrib["viewBox"]
        for kept in (KEPT, NOTHING)
    }
    assert len(sizes) == 1
