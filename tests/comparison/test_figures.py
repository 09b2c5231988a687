"""Figures: the same bytes for the same data, well-formed, true to scale, and showing what they were
given."""

import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.figure import Figure

from echolearn.acoustics.types import Array
from echolearn.comparison import figures
from echolearn.evaluation.scoring import Answer, Heard, Row, Sheet

POINTS = np.array([[0.0, 2.0], [3.0, 0.05], [5.95, 2.0], [3.0, 3.5], [2.0, 2.0]])
POSES = np.array([[1.5, 2.0], [3.0, 1.5], [4.5, 2.0], [3.0, 2.5], [3.0, 2.0]])
TRUE = np.array([True, True, True, False, False])
KEPT = np.array([True, False, True, True, False])


def walk(width: float = 4.0) -> Heard:
    """Return a survey of five poses in a room of 6 m by `width`."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, width], [0.0, width]])
    sheet = Sheet("walk", TRUE, np.arange(5), np.zeros(5), np.ones((1, 5)))
    return Heard(sheet, POINTS, POSES, corners, {})


def row(snr_db: str, value: float) -> Row:
    return {"snr_db": snr_db, "value": value, "ci_low": value - 0.1, "ci_high": value + 0.05}


def belief() -> str:
    rng = np.random.default_rng(0)
    reference = rng.random(200) < 0.5
    sheet = Sheet("set", reference, np.arange(200), np.zeros(200), np.ones((1, 200)))
    rows = np.arange(0, 200, 2)
    some, all_rows = (
        Answer(0, rows, rng.random(100), 0.5),
        Answer(0, np.arange(200), rng.random(200), 0.5),
    )
    return figures.belief({"some": some, "all": all_rows}, sheet)


def arrival_times() -> str:
    rng = np.random.default_rng(0)
    return figures.arrival_times(
        {name: (rng.random(50), rng.random(50) < 0.5) for name in ("on", "off")}
    )


DRAWN: dict[str, Callable[[], str]] = {
    "maps": lambda: figures.maps(
        [("before", walk(), np.ones(5, dtype=bool)), ("after", walk(), KEPT)]
    ),
    "one map": lambda: figures.maps([("nothing", walk(), np.zeros(5, dtype=bool))]),
    "over_snr": lambda: figures.over_snr(
        {"room": {"a": [row("0", 0.9), row("-10", 0.6)]}}, ylabel="y"
    ),
    "bands": lambda: figures.bands(
        {"a": [row("-40:-20", 0.5), row("-5:40", 0.9)], "b": [row("-5:40", 0.8)]}
    ),
    "undefined": lambda: figures.bands({"a": [row("-5:40", float("nan"))], "b": []}),
    "belief": belief,
    "arrival_times": arrival_times,
}


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_is_the_same_svg_each_time_and_needs_nothing_else(name: str) -> None:
    """No date, no font, no image: every reference is to the figure itself."""
    first, again = DRAWN[name](), DRAWN[name]()
    assert first == again
    root = ET.fromstring(first)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert {"width", "height", "viewBox"} <= set(root.attrib)
    links = [
        value for node in root.iter() for key, value in node.attrib.items() if key.endswith("href")
    ]
    assert all(link.startswith("#") for link in links)
    assert not [node for node in root.iter() if node.tag.endswith(("}image", "}text", "}date"))]


def test_more_panels_take_more_rows() -> None:
    sizes = []
    for panels in (2, 3):
        root = ET.fromstring(figures.maps([(str(n), walk(), KEPT) for n in range(panels)]))
        sizes.append([float(root.attrib[side].removesuffix("pt")) for side in ("width", "height")])
    assert sizes[0][0] == sizes[1][0]
    assert sizes[1][1] > 1.5 * sizes[0][1]


@pytest.fixture
def drawn() -> dict[str, Array]:
    """Return what is drawn of a map by label, shape (2, points)."""
    axis = Figure().subplots()
    figures.paint_map(axis, "title", walk(), KEPT)
    return {str(line.get_label()): np.array(line.get_data()) for line in axis.lines}


@pytest.mark.parametrize("width", [4.0, 9.0])
def test_a_map_is_true_to_scale_and_holds_the_room(width: float) -> None:
    axis = Figure(figsize=(7, 3)).subplots()
    figures.paint_map(axis, "title", walk(width), KEPT)
    assert axis.get_aspect() == 1.0
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    assert left < 0 and right > 6 and low < 0 and high > width
    assert (right - left) / (high - low) == pytest.approx((6 + 1.2) / (width + 1.2))


def test_a_map_shows_walls_path_and_every_point_once(drawn: dict[str, Array]) -> None:
    assert np.array_equal(drawn["path"].T, POSES)
    assert np.array_equal(drawn["wall"][:, 0], drawn["wall"][:, -1])
    assert drawn["wall"].shape == (2, 5)
    assert np.array_equal(drawn["kept, on a wall"].T, POINTS[[0, 2]])
    assert np.array_equal(drawn["kept, spurious"].T, POINTS[[3]])
    assert np.array_equal(drawn["rejected"].T, POINTS[[1, 4]])


def test_the_title_says_how_many_kept_points_are_true() -> None:
    axis = Figure().subplots()
    figures.paint_map(axis, "filtered", walk(), KEPT)
    assert axis.get_title() == "filtered\n67% of 3 points on a wall"
    figures.paint_map(axis, "filtered", walk(), np.zeros(5, dtype=bool))
    assert axis.get_title() == "filtered\nno points"


def test_kinds_of_points_differ_in_shape_not_in_colour_alone() -> None:
    axis = Figure().subplots()
    figures.paint_map(axis, "title", walk(), KEPT)
    markers = [line.get_marker() for line in axis.lines if line.get_linestyle() == "None"]
    assert len(set(markers)) == 3


def test_lines_over_snr_are_in_order_with_their_interval() -> None:
    axis = Figure().subplots()
    figures.paint_line(axis, "a", [row("-10", 0.6), row("0", 0.9)], number=0)
    assert np.array_equal(np.array(axis.lines[0].get_data()), [[-10, 0], [0.6, 0.9]])
    edges = np.array(axis.collections[0].get_paths()[0].vertices)
    assert edges[:, 1].min() == pytest.approx(0.5) and edges[:, 1].max() == pytest.approx(0.95)


def test_colours_and_markers_do_not_run_out() -> None:
    many = {str(n): [row("0", 0.5), row("-5", 0.4)] for n in range(30)}
    assert ET.fromstring(figures.over_snr({"room": many}, ylabel="y")) is not None
    assert len(set(figures.CYCLE)) == 8
