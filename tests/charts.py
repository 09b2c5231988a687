"""Maps made by hand, whose every point is known, and how nav2 reads a grid."""

from io import BytesIO

import numpy as np
import yaml
from PIL import Image

from echolearn.acoustics.types import Array, Echoes, EchoMap
from echolearn.mapping.files.chart import Chart, Files

POINTS = np.array(
    [[3.02, -1.98], [5.02, 1.03], [5.02, 1.03], [4.02, 3.02], [9.0, 9.0], [3.02, -0.98]]
)
POSES = np.array(
    [[3.02, -0.98], [4.02, 1.03], [4.02, 1.03], [4.02, 1.02], [4.02, 1.02], [3.02, -0.98]]
)
CONFIDENCE = np.array([0.9, 0.8, 0.7, 0.99, 0.1, 0.9])
FLAT = np.array([1, 1, 1, 1, 1, 0])

CORNERS = np.array(
    [[-1.48, -1.98], [4.52, -1.98], [4.52, 0.52], [1.52, 0.52], [1.52, 3.52], [-1.48, 3.52]]
)
"""An L that no mirror and no turn maps onto itself; no wall lies on the border of a cell."""

LEGS = np.array([[3.62, -1.08], [0.32, -1.08], [0.32, 2.42]])
"""A walk through it that does not begin at the origin."""


def lopsided() -> Chart:
    """Return three poses of two echoes in a lopsided place with negative coordinates; the last is a
    ceiling's."""
    column = (np.arange(6.0) / 3).reshape(3, 2)
    echoes = Echoes(
        column, column + 1, column + 2, column + 3, (FLAT * np.pi / 2).reshape(3, 2), column + 4
    )
    path = np.array([[3.02, -0.98, 1.5], [4.02, 1.03, 1.6], [4.02, 1.02, 1.7]])
    outline = np.array([[0.0, -2.0], [5.0, -2.0], [5.0, 3.0], [0.0, 3.0]])
    return Chart(
        "lopsided", echoes, EchoMap(POINTS, CONFIDENCE, CONFIDENCE > 0.5, POSES), path, outline
    )


def angled() -> Chart:
    """Return 35 poses in the L, each with sure echoes of the two walls that are nearest before it."""
    path = np.concatenate([np.linspace(*LEGS[leg : leg + 2], 18)[leg:] for leg in (0, 1)])
    points = np.stack([_nearest(place) for place in path])
    along = np.diff(path, axis=0, append=path[-1:] + [[0.0, 1.0]])
    column = np.full((len(path), 2), np.pi / 2)
    found = EchoMap(
        points.reshape(-1, 2),
        np.full(2 * len(path), 0.95),
        np.full(2 * len(path), True),
        path.repeat(2, 0),
    )
    walk = np.column_stack([path, np.linspace(1.0, 1.5, len(path))])
    headings = np.arctan2(along[:, 1], along[:, 0])
    return Chart("angled", Echoes(*[column] * 6), found, walk, CORNERS, headings=headings)


def _nearest(place: Array) -> Array:
    """Return where sound from `place` meets the two nearest walls that send it back, shape (2, 2)."""
    starts, ends = CORNERS, np.roll(CORNERS, -1, axis=0)
    share = ((place - starts) * (ends - starts)).sum(axis=1) / ((ends - starts) ** 2).sum(axis=1)
    feet = (starts + share[:, None] * (ends - starts))[(share > 0) & (share < 1)]
    return feet[np.linalg.norm(feet - place, axis=1).argsort()[:2]]


def nav2(files: Files) -> tuple[Array, tuple[float, float, float]]:
    """Return cells (row 0 the smallest y; 100, 0 or -1), origin and resolution, as nav2's
    map_server loads them."""
    about = yaml.safe_load(files["map.yaml"])
    image = np.asarray(Image.open(BytesIO(files[about["image"]])), dtype=float)
    assert about["mode"] == "trinary" and about["origin"][2] == 0
    occupied = (image if about["negate"] else 255 - image) / 255
    cells = np.full(image.shape, -1)
    cells[occupied > about["occupied_thresh"]] = 100
    cells[occupied < about["free_thresh"]] = 0
    x, y, _ = about["origin"]
    return cells[::-1], (x, y, about["resolution"])
