"""`map.ply`: the kept points as a cloud at the loudspeaker's height, with their confidences (PLY 1.0, binary)."""

import numpy as np

from echolearn.mapfiles import Chart, Files


def write(chart: Chart) -> Files:
    """Return the point cloud."""
    shown = chart.drawn
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("confidence", "<f4")]
    cloud = np.empty(int(shown.sum()), dtype=fields)
    cloud["x"], cloud["y"] = chart.map.points[shown].T
    cloud["z"], cloud["confidence"] = chart.path[chart.index[shown], 2], chart.map.confidence[shown]
    properties = "".join(f"property float {name}\n" for name, _ in fields)
    head = f"ply\nformat binary_little_endian 1.0\ncomment metres, room frame\nelement vertex {len(cloud)}\n"
    return {"map.ply": f"{head}{properties}end_header\n".encode() + cloud.tobytes()}
