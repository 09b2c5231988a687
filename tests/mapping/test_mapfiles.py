"""Map files as other programs read them: right side up, in the right place, with nothing lost."""

import csv
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from plyfile import PlyData

from charts import CONFIDENCE, CORNERS, POINTS, POSES, angled, lopsided, nav2
from echolearn.acoustics.geometry import distance_to_outline
from echolearn.acoustics.types import Array, EchoMap
from echolearn.checks import BadValue
from echolearn.mapping.files import grid, ply, svg, table
from echolearn.mapping.files.chart import Chart


@pytest.fixture
def chart() -> Chart:
    """Return the lopsided place."""
    return lopsided()


def test_the_table_holds_every_echo_to_the_last_digit(chart: Chart) -> None:
    files = table.write(chart)
    rows = list(csv.DictReader(StringIO(files["map.csv"].decode())))
    assert (
        ",".join(rows[0])
        == "index,x_m,y_m,toa_s,azimuth_rad,elevation_rad,power,score,confidence,kept"
    )
    assert [int(row["index"]) for row in rows] == [0, 0, 1, 1, 2, 2]
    assert np.array_equal([[float(row["x_m"]), float(row["y_m"])] for row in rows], POINTS)
    assert [float(row["toa_s"]) for row in rows] == chart.echoes.toa.ravel().tolist()
    assert [float(row["score"]) for row in rows] == (chart.echoes.toa.ravel() + 1).tolist()
    assert [float(row["azimuth_rad"]) for row in rows] == (chart.echoes.toa.ravel() + 3).tolist()
    assert [float(row["power"]) for row in rows] == (chart.echoes.toa.ravel() + 4).tolist()
    assert [row["kept"] for row in rows] == ["1", "1", "1", "1", "0", "1"]
    assert files["walls.csv"].decode().startswith("x0_m,y0_m,x1_m,y1_m,normal_rad,offset_m,")


def test_the_table_calls_poses_what_the_survey_does(chart: Chart) -> None:
    named = replace(chart, numbers=(40, 2**60 + 1, 7))
    rows = list(csv.DictReader(StringIO(table.write(named)["map.csv"].decode())))
    assert [int(row["index"]) for row in rows] == [40, 40, 2**60 + 1, 2**60 + 1, 7, 7]
    for writer in (ply, grid, svg):
        assert writer.write(named) == writer.write(chart)


def test_the_grid_is_where_it_says_in_an_independent_reader(chart: Chart) -> None:
    files = grid.write(chart)
    about = yaml.safe_load(files["map.yaml"])
    image = np.asarray(Image.open(BytesIO(files["map.pgm"])))
    assert about["image"] == "map.pgm" and about["negate"] == 0 and len(about["origin"]) == 3

    def look(x: float, y: float) -> int:
        """Return the pixel of a place as map_server finds it: rows from the top, origin at the
        bottom left."""
        column = int((x - about["origin"][0]) // about["resolution"])
        row = int((y - about["origin"][1]) // about["resolution"])
        return int(image[image.shape[0] - 1 - row, column])

    occupied, free = 255 * (1 - about["occupied_thresh"]), 255 * (1 - about["free_thresh"])
    for x, y in POINTS[:4]:
        assert look(x, y) < occupied
    for x, y in ((3.02, -1.28), (3.02, -1.88), (4.52, 1.03), (4.02, 2.02)):
        assert occupied < look(x, y) > 127
    for x, y in ((3.5, -1.5), (2.6, -2.3), (4.8, 2.5)):
        assert look(x, y) == 205
    assert (image == 205).mean() > 0.5 and look(5.2, 1.03) == 205  # nothing is known behind a wall
    assert free > 204


def test_odds_add_up_as_the_header_says(chart: Chart) -> None:
    odds, touched, origin = grid.occupancy(chart)

    def at(x: float, y: float) -> float:
        row, column = (np.floor((np.array([y, x]) - origin[::-1]) / 0.05)).astype(int)
        assert touched[row, column]
        return float(odds[row, column])

    def logit(p: float) -> float:
        return float(np.log(p / (1 - p)))

    assert at(3.02, -1.98) == pytest.approx(logit(0.9 * 0.9 + 0.05))
    assert at(5.02, 1.03) == pytest.approx(logit(0.8 * 0.9 + 0.1) + logit(0.7 * 0.9 + 0.15))
    assert at(3.02, -1.48) == pytest.approx(logit(0.9 * 0.1 + 0.05))
    assert at(4.52, 1.03) == pytest.approx(logit(0.8 * 0.1 + 0.1) + logit(0.7 * 0.1 + 0.15))


def test_rejected_echoes_and_ceilings_leave_the_grid_and_the_cloud_alone(chart: Chart) -> None:
    assert chart.drawn.tolist() == [True] * 4 + [False] * 2
    assert (
        grid.occupancy(chart)[1].shape[1] * 0.05 < 4
    )  # the point at (9, 9) does not even widen it


def test_a_grid_beyond_reason_is_refused(chart: Chart) -> None:
    far = Chart(chart.name, chart.echoes, chart.map, chart.path * [1, 1e5, 1])
    with pytest.raises(
        BadValue, match=r"resolution=0.05 m: at most 16000000 cells; choose a larger one"
    ):
        grid.write(far)


def test_nothing_kept_is_a_map_of_nothing(chart: Chart) -> None:
    none = EchoMap(POINTS, CONFIDENCE, np.zeros(6, dtype=bool), POSES)
    empty = Chart("empty", chart.echoes, none, chart.path)
    assert (np.asarray(Image.open(BytesIO(grid.write(empty)["map.pgm"]))) == 205).all()
    assert b"element vertex 0\n" in ply.write(empty)["map.ply"]
    assert table.write(empty)["walls.csv"].count(b"\n") == 1
    assert ElementTree.fromstring(svg.write(empty)["map.svg"]).findall(".//*[@class='kept']") == []


def test_the_cloud_is_read_by_its_header(chart: Chart) -> None:
    head, _, body = ply.write(chart)["map.ply"].partition(b"end_header\n")
    lines = head.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"] and "element vertex 4" in lines
    assert [line.split()[1:] for line in lines if line.startswith("property")] == [
        ["float", name] for name in ("x", "y", "z", "confidence")
    ]
    cloud = np.frombuffer(body, "<f4").reshape(4, 4)
    assert np.allclose(cloud[:, :2], POINTS[:4]) and np.allclose(cloud[:, 3], CONFIDENCE[:4])
    assert np.allclose(cloud[:, 2], [1.5, 1.5, 1.6, 1.6])


@pytest.mark.parametrize("made", [lopsided, angled])
def test_the_cloud_opens_in_plyfile(made: Callable[[], Chart], tmp_path: Path) -> None:
    chart = made()
    (tmp_path / "map.ply").write_bytes(ply.write(chart)["map.ply"])
    found = PlyData.read(tmp_path / "map.ply")
    assert (
        [element.name for element in found] == ["vertex"]
        and found.byte_order == "<"
        and not found.text
    )
    vertices = found["vertex"]
    assert [(column.name, column.val_dtype) for column in vertices.properties] == [
        (name, "f4") for name in ("x", "y", "z", "confidence")
    ]
    points = np.column_stack([chart.map.points, chart.path[chart.index, 2], chart.map.confidence])[
        chart.drawn
    ]
    for name, column in zip(("x", "y", "z", "confidence"), points.T, strict=True):
        assert np.array_equal(vertices[name], column.astype(np.float32))


def test_nav2_finds_walls_and_walk_of_an_l_where_they_are_and_nowhere_else() -> None:
    chart = angled()
    cells, (x, y, resolution) = nav2(grid.write(chart))
    assert {*cells.flat} == {-1, 0, 100}

    def holds(read: Array) -> bool:
        """Tell whether a reading has every wall point occupied and every pose free."""
        return all(
            ((places - [x, y]) // resolution < read.shape[::-1]).all()
            and {*read[tuple(((places - [x, y]) // resolution).astype(int).T[::-1])]} == {value}
            for places, value in ((chart.map.points, 100), (chart.path[:, :2], 0))
        )

    assert holds(cells)
    for wrong in (
        cells[::-1],
        cells[:, ::-1],
        cells[::-1, ::-1],
        cells.T,
        cells.T[::-1],
        *(np.roll(cells, 1, axis=k) for k in (0, 1)),
    ):
        assert not holds(wrong)
    rows, columns = np.nonzero(cells == 100)
    centres = np.column_stack([columns + 0.5, rows + 0.5]) * resolution + [x, y]
    assert distance_to_outline(centres, CORNERS).max() <= resolution / np.sqrt(2)
    assert (np.ptp(centres, axis=0) > [5.9, 5.4]).all()  # from wall to wall


def test_walls_are_drawn_above_points() -> None:
    kinds = [part.get("class") for part in ElementTree.fromstring(svg.write(angled())["map.svg"])]
    assert "wall" in kinds and kinds.index("wall") > max(
        k for k, kind in enumerate(kinds) if kind == "kept"
    )


def test_the_drawing_has_equal_axes_and_every_point(chart: Chart) -> None:
    root = ElementTree.fromstring(svg.write(chart)["map.svg"])
    kept, rejected = (root.findall(f".//*[@class='{kind}']") for kind in ("kept", "rejected"))
    assert len(kept) == 4 and len(rejected) == 1
    x, y = ([float(dot.attrib[axis]) for dot in (kept[0], kept[3])] for axis in ("cx", "cy"))
    assert x[1] - x[0] == pytest.approx(svg.SCALE * 1.0, abs=0.2)
    assert y[0] - y[1] == pytest.approx(svg.SCALE * 5.0, abs=0.2)  # larger y is higher up
    assert len(root.findall(".//*[@class='outline']")) == 1
