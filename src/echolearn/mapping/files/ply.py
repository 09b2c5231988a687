"""`map.ply`: the kept points as a cloud at the loudspeaker's height, with their confidences.

The format is PLY 1.0, binary, little-endian.
"""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.mapped_walk import Files, MappedWalk

FIELDS = ("x", "y", "z", "confidence")
"""Fields of a point, in this order, each a little-endian float of 4 bytes."""


def write(walk: MappedWalk) -> Files:
    """Return the point cloud."""
    points = cloud(walk)
    properties = "".join(f"property float {name}\n" for name in FIELDS)
    header = f"""\
ply
format binary_little_endian 1.0
comment metres, room frame
element vertex {len(points)}
{properties}end_header
"""
    return {"map.ply": header.encode() + points.tobytes()}


def cloud(walk: MappedWalk) -> Array:
    """Return the shown points, shape (K, 4): columns `FIELDS`, little-endian floats of 4 bytes."""
    shown = walk.shown
    heights = walk.path[walk.index[shown], 2]
    columns = [walk.map.points[shown], heights, walk.map.confidence[shown]]
    return np.column_stack(columns).astype("<f4")
