"""Maps made by hand, whose every point is known, and how nav2 reads a grid."""

from io import BytesIO

import numpy as np
import yaml
from PIL import Image

from echolearn.acoustics.sides import closed
from echolearn.acoustics.types import Array, Echoes, EchoMap, Pose
from echolearn.mapping.mapped_walk import Files, MappedWalk

POINTS = np.array(
    [[3.02, -1.98], [5.02, 1.03], [5.02, 1.03], [4.02, 3.02], [9.0, 9.0], [3.02, -0.98]]
)
POSES = np.array([[3.02, -0.98, 1.5], [4.02, 1.03, 1.6], [4.02, 1.02, 1.7]])
SEEN_FROM = POSES[[0, 1, 1, 2, 2, 0], :2]
CONFIDENCE = np.array([0.9, 0.8, 0.7, 0.99, 0.1, 0.9])
FLAT = np.array([1, 1, 1, 1, 1, 0])

CORNERS = np.array(
    [[-1.48, -1.98], [4.52, -1.98], [4.52, 0.52], [1.52, 0.52], [1.52, 3.52], [-1.48, 3.52]]
)
"""An L that no mirror and no turn maps onto itself; no wall lies on the border of a cell."""

LEGS = np.array([[3.62, -1.08], [0.32, -1.08], [0.32, 2.42]])
"""A walk through it that does not begin at the origin."""


def lopsided() -> MappedWalk:
    """Return three poses of two echoes with negative coordinates; the last is a ceiling's."""
    column = (np.arange(6.0) / 3).reshape(3, 2)
    elevation = (FLAT * np.pi / 2).reshape(3, 2)
    echoes = Echoes(column, column + 1, column + 2, column + 3, elevation, column + 4)
    outline = np.array([[0.0, -2.0], [5.0, -2.0], [5.0, 3.0], [0.0, 3.0]])
    found = EchoMap(POINTS, CONFIDENCE, CONFIDENCE > 0.5, SEEN_FROM)
    return MappedWalk(echoes, found, [Pose(place) for place in POSES], range(3), closed(outline))


def angled() -> MappedWalk:
    """Return 35 poses in the L, each with sure echoes of the two walls nearest before it."""
    path = np.concatenate([np.linspace(*LEGS[leg : leg + 2], 18)[leg:] for leg in (0, 1)])
    points = np.concatenate([_nearest(place) for place in path])
    along = np.diff(path, axis=0, append=path[-1:] + [[0.0, 1.0]])
    heights = np.linspace(1.0, 1.5, len(path))
    poses = [
        Pose(np.append(place, height), float(np.arctan2(*step[::-1])))
        for place, height, step in zip(path, heights, along, strict=True)
    ]
    sure = np.full(len(points), 0.95)
    found = EchoMap(points, sure, sure > 0.5, path.repeat(2, axis=0))
    echoes = Echoes(*[np.full((len(path), 2), np.pi / 2)] * 6)
    return MappedWalk(echoes, found, poses, range(len(poses)), closed(CORNERS))


def _nearest(place: Array) -> Array:
    """Return where sound from `place` meets the two nearest walls that send it back, (2, 2)."""
    starts, ends = CORNERS, np.roll(CORNERS, -1, axis=0)
    share = ((place - starts) * (ends - starts)).sum(axis=1) / ((ends - starts) ** 2).sum(axis=1)
    feet = (starts + share[:, None] * (ends - starts))[(share > 0) & (share < 1)]
    return feet[np.linalg.norm(feet - place, axis=1).argsort()[:2]]


def nav2(files: Files) -> tuple[Array, tuple[float, float, float]]:
    """Return cells, origin and resolution as nav2's map_server loads them.

    Row 0 of the cells is the smallest y; they are 100, 0 or -1.
    """
    about = yaml.safe_load(files["map.yaml"])
    image = np.asarray(Image.open(BytesIO(files[about["image"]])), dtype=float)
    assert about["mode"] == "trinary" and about["origin"][2] == 0
    occupied = (image if about["negate"] else 255 - image) / 255
    cells = np.full(image.shape, -1)
    cells[occupied > about["occupied_thresh"]] = 100
    cells[occupied < about["free_thresh"]] = 0
    x, y, _ = about["origin"]
    return cells[::-1], (x, y, about["resolution"])
