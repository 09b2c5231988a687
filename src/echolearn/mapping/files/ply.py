"""`map.ply`: the kept points as a cloud at the loudspeaker's height, with their confidences (PLY
1.0, binary).
"""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.files.chart import Chart, Files

FIELDS = ("x", "y", "z", "confidence")
"""Of a point, in this order, each a little-endian float of 4 bytes."""


def write(chart: Chart) -> Files:
    """Return the point cloud."""
    points = cloud(chart)
    properties = "".join(f"property float {name}\n" for name in FIELDS)
    head = f"ply\nformat binary_little_endian 1.0\ncomment metres, room frame\nelement vertex {len(points)}\n"
    return {"map.ply": f"{head}{properties}end_header\n".encode() + points.tobytes()}


def cloud(chart: Chart) -> Array:
    """Return the drawn points, shape (K, 4): columns `FIELDS`, as little-endian floats of 4 bytes."""
    shown = chart.drawn
    heights, beliefs = chart.path[chart.index[shown], 2], chart.map.confidence[shown]
    return np.column_stack([chart.map.points[shown], heights, beliefs]).astype("<f4")
