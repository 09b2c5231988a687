"""Map files as other programs read them: right side up, in the right place, with nothing lost."""

import csv
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from importlib import import_module
from io import BytesIO, StringIO
from pkgutil import iter_modules

import numpy as np
import pytest
import yaml
from PIL import Image

from echolearn.acoustics.sides import closed, distance_to_outline
from echolearn.acoustics.types import EchoMap, Pose
from echolearn.checks import BadValue
from echolearn.mapping import files
from echolearn.mapping.files import grid, ply, svg, table
from echolearn.mapping.mapped_walk import BAG
from mapped_walks import CONFIDENCE, CORNERS, POINTS, SEEN_FROM, angled, lopsided, nav2

WRITERS = [
    import_module(f"{files.__name__}.{module.name}") for module in iter_modules(files.__path__)
]


@pytest.fixture
def walk():
    return lopsided()


def emptied(walk):
    """Return a walk of whose echoes none is kept."""
    return replace(walk, map=EchoMap(POINTS, CONFIDENCE, np.zeros(6, dtype=bool), SEEN_FROM))


# ---------------------------------------------------------------- every writer


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.__name__.rpartition(".")[2])
@pytest.mark.parametrize("made", [lopsided, angled, lambda: emptied(lopsided())])
def test_a_writer_gives_the_same_bytes_at_any_time(writer, made, monkeypatch):
    written = writer.write(made())
    assert written and all(isinstance(content, bytes) and content for content in written.values())
    for clock in ("time", "time_ns"):
        monkeypatch.setattr(time, clock, lambda: 10**9)
    assert writer.write(made()) == written


def test_no_two_writers_write_one_file():
    names = [name for writer in WRITERS for name in writer.write(lopsided())]
    known = {"map.csv", "walls.csv", "map.ply", "map.pgm", "map.yaml", "map.svg", *BAG}
    assert sorted(names) == sorted(known)


# ---------------------------------------------------------------- tables


def rows(content):
    return list(csv.DictReader(StringIO(content.decode())))


def test_the_table_holds_every_echo_to_the_last_digit(walk):
    written = table.write(walk)
    found = rows(written["map.csv"])
    header = "index,x_m,y_m,toa_s,azimuth_rad,elevation_rad,power,score,confidence,kept"
    header += ",floor_or_ceiling,distance_sd_m,azimuth_sd_rad"
    assert ",".join(found[0]) == header
    assert [row["floor_or_ceiling"] for row in found] == ["0", "0", "0", "0", "0", "1"]
    assert [int(row["index"]) for row in found] == [0, 0, 1, 1, 2, 2]
    assert [row["kept"] for row in found] == ["1", "1", "1", "1", "0", "1"]
    toa = walk.echoes.toa.ravel()
    columns = {"x_m": POINTS[:, 0], "y_m": POINTS[:, 1], "toa_s": toa, "score": toa + 1}
    columns |= {"azimuth_rad": toa + 3, "power": toa + 4, "confidence": CONFIDENCE}
    for name, column in columns.items():
        assert [float(row[name]) for row in found] == column.tolist()
    assert written["walls.csv"].startswith(b"x0_m,y0_m,x1_m,y1_m,normal_rad,offset_m,")
    assert table.write(emptied(walk))["walls.csv"].count(b"\n") == 1


def test_the_table_calls_poses_what_the_survey_does(walk):
    named = replace(walk, numbers=(40, 10**19 - 1, 2**60 + 1))
    found = [int(row["index"]) for row in rows(table.write(named)["map.csv"])]
    assert found == [40, 40, 10**19 - 1, 10**19 - 1, 2**60 + 1, 2**60 + 1]
    for writer in WRITERS:
        assert writer is table or writer.write(named) == writer.write(walk)


def test_a_wall_has_its_row():
    walk = angled()
    first, *others = rows(table.write(walk)["walls.csv"])
    line = walk.lines[0]
    expected = [*line.start, *line.end, line.normal, line.offset]
    expected += [line.normal_sd, line.offset_sd, line.rms, line.points]
    assert [float(cell) for cell in first.values()] == expected
    assert len(others) + 1 == len(walk.lines)


# ---------------------------------------------------------------- grids


def test_the_grid_is_where_it_says_in_an_independent_reader(walk):
    written = grid.write(walk)
    about = yaml.safe_load(written["map.yaml"])
    image = np.asarray(Image.open(BytesIO(written["map.pgm"])))
    assert about["image"] == "map.pgm" and about["negate"] == 0 and len(about["origin"]) == 3

    def look(x, y):
        """Return the pixel of a place as map_server finds it: the origin at the bottom left."""
        column = int((x - about["origin"][0]) // about["resolution"])
        row = int((y - about["origin"][1]) // about["resolution"])
        return int(image[image.shape[0] - 1 - row, column])

    occupied = 255 * (1 - about["occupied_thresh"])
    assert all(look(x, y) < occupied for x, y in POINTS[:4])
    for x, y in ((3.02, -1.28), (3.02, -1.88), (4.52, 1.03), (4.02, 2.02)):
        assert look(x, y) > max(occupied, 127)
    for x, y in ((3.5, -1.5), (2.6, -2.3), (4.8, 2.5), (5.2, 1.03)):
        assert look(x, y) == 205  # nothing is known beside a ray and behind a wall
    assert (image == 205).mean() > 0.5
    empty = np.asarray(Image.open(BytesIO(grid.write(emptied(walk))["map.pgm"])))
    assert (empty == 205).all()


def test_odds_add_up_as_the_header_says(walk):
    odds, touched, origin = grid.occupancy(walk)

    def at(x, y):
        row, column = np.floor((np.array([y, x]) - origin[::-1]) / 0.05).astype(int)
        assert touched[row, column]
        return float(odds[row, column])

    def logit(p):
        return float(np.log(p / (1 - p)))

    assert at(3.02, -1.98) == pytest.approx(logit(0.9 * 0.9 + 0.05))
    assert at(5.02, 1.03) == pytest.approx(logit(0.8 * 0.9 + 0.1) + logit(0.7 * 0.9 + 0.15))
    assert at(3.02, -1.48) == pytest.approx(logit(0.9 * 0.1 + 0.05))
    assert at(4.52, 1.03) == pytest.approx(logit(0.8 * 0.1 + 0.1) + logit(0.7 * 0.1 + 0.15))


def test_rejected_echoes_and_ceilings_leave_the_grid_and_the_cloud_alone(walk):
    """The rejected point at (9, 9) does not even widen the grid."""
    assert walk.shown.tolist() == [True] * 4 + [False] * 2
    assert grid.occupancy(walk)[1].shape[1] * 0.05 < 4


def test_a_grid_beyond_reason_is_refused(walk):
    poses = [Pose(pose.position * [1, 1e5, 1]) for pose in walk.poses]
    with pytest.raises(BadValue, match="resolution=0.05 m: must leave at most 16000000 cells; ch"):
        grid.write(replace(walk, poses=poses))


def test_nav2_finds_walls_and_walk_of_an_l_where_they_are_and_nowhere_else():
    walk = angled()
    cells, (x, y, resolution) = nav2(grid.write(walk))
    assert {*cells.flat} == {-1, 0, 100}

    def holds(read):
        """Tell whether a reading has every wall point occupied and every pose free."""
        for places, value in ((walk.map.points, 100), (walk.path[:, :2], 0)):
            columns, rows = ((places - [x, y]) // resolution).astype(int).T
            if rows.max() >= read.shape[0] or columns.max() >= read.shape[1]:
                return False
            if {*read[rows, columns]} != {value}:
                return False
        return True

    assert holds(cells)
    shifted = [np.roll(cells, 1, axis=k) for k in (0, 1)]
    turned = [cells[::-1], cells[:, ::-1], cells[::-1, ::-1], cells.T, cells.T[::-1]]
    assert not any(map(holds, [*shifted, *turned]))
    rows, columns = np.nonzero(cells == 100)
    centres = np.column_stack([columns + 0.5, rows + 0.5]) * resolution + [x, y]
    assert distance_to_outline(centres, closed(CORNERS)).max() <= resolution / np.sqrt(2)
    assert (np.ptp(centres, axis=0) > [5.9, 5.4]).all()  # from wall to wall


# ---------------------------------------------------------------- clouds and drawings


def read_ply(data):
    """Return the vertices of a cloud, by what its header says about the bytes after it."""
    header, _, body = data.partition(b"end_header\n")
    magic, form, *rest = [line.split() for line in header.decode("ascii").splitlines()]
    assert (magic, form) == (["ply"], ["format", "binary_little_endian", "1.0"])
    (*element, count), *properties = [words for words in rest if words[0] != "comment"]
    assert element == ["element", "vertex"]
    assert {(word, kind) for word, kind, _ in properties} == {("property", "float")}
    vertices = np.frombuffer(body, [(name, "<f4") for *_, name in properties])
    assert len(vertices) == int(count)
    return vertices


@pytest.mark.parametrize("made", [lopsided, angled])
def test_the_cloud_holds_the_shown_points(made):
    walk = made()
    vertices = read_ply(ply.write(walk)["map.ply"])
    points = np.column_stack([walk.map.points, walk.path[walk.index, 2], walk.map.confidence])
    assert vertices.dtype.names == ("x", "y", "z", "confidence")
    for name, values in zip(vertices.dtype.names, points[walk.shown].T, strict=True):
        assert np.array_equal(vertices[name], values.astype(np.float32))


def shapes(walk):
    return list(ElementTree.fromstring(svg.write(walk)["map.svg"]))


def test_walls_are_drawn_above_points():
    kinds = [shape.get("class") for shape in shapes(angled())]
    assert kinds.index("wall") > max(k for k, kind in enumerate(kinds) if kind == "kept")


def test_a_plan_with_a_door_and_a_pillar_is_drawn_line_by_line():
    """Lines that close are polygons, of their corners once; others leave the gap open."""
    wall = np.array([[[0.0, 0.0], [5.0, 0.0]], [[5.0, 0.0], [5.0, 4.0]]])
    pillar = closed(np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]]))
    walk = replace(lopsided(), outline=np.concatenate([wall, pillar]))
    drawn = [shape for shape in shapes(walk) if shape.get("class") == "outline"]
    assert [shape.tag.rpartition("}")[2] for shape in drawn] == ["polyline", "polygon"]
    assert [len(str(shape.get("points")).split()) for shape in drawn] == [3, 3]


def test_the_drawing_has_equal_axes_and_every_point(walk):
    found = shapes(walk)
    kinds = [shape.get("class") for shape in found]
    drawn = [kinds.count(kind) for kind in ("kept", "rejected", "upright", "outline", "path")]
    assert drawn == [4, 1, 1, 1, 1]
    assert (
        found[-1].text
        == "points: 4 kept (blue), 1 rejected (hollow), 1 from floor or ceiling (pink)"
    )
    kept = [shape.attrib for shape in found if shape.get("class") == "kept"]
    x, y = ([float(dot[axis]) for dot in (kept[0], kept[3])] for axis in ("cx", "cy"))
    assert x[1] - x[0] == pytest.approx(svg.SCALE * 1.0, abs=0.2)
    assert y[0] - y[1] == pytest.approx(svg.SCALE * 5.0, abs=0.2)  # larger y is higher up
    assert not any(shape.get("class") == "kept" for shape in shapes(emptied(walk)))
