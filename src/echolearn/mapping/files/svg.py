"""`map.svg`: the map as a drawing with equal axes.

It shows the path, kept and rejected points, the fitted walls, and the outline if it is known; and
kept echoes from floor or ceiling, which belong to no wall. Colours are those of Okabe and Ito,
which colour-blind readers tell apart; a rejected point is hollow besides, one of floor or ceiling
fainter. Where an array sees mirror images, both points of an echo whose side is undecided are
orange and hollow.
"""

import numpy as np

from echolearn.acoustics.sides import polylines
from echolearn.acoustics.types import Array
from echolearn.mapping.mapped_walk import Files, MappedWalk

SCALE = 60
"""Pixels per m."""

STYLE = """\
.outline{fill:none;stroke:#999;stroke-width:1.5}.path{fill:none;stroke:#bbb;stroke-dasharray:3 3}\
.rejected{fill:none;stroke:#D55E00;stroke-width:.8}.kept{fill:#0072B2}\
.upright{fill:#CC79A7;fill-opacity:.75}\
.wall{stroke:#009E73;stroke-width:4;stroke-opacity:.55}text{font:12px sans-serif;fill:#333}"""

UNDECIDED = ".undecided{fill:none;stroke:#E69F00;stroke-width:1.6}"


def write(walk: MappedWalk) -> Files:
    """Return the drawing."""
    outline = np.empty((0, 2, 2)) if walk.outline is None else walk.outline
    # Everything is to be seen, half a metre from the edge.
    everything = np.concatenate([walk.map.points, walk.path[:, :2], *outline])
    low = everything.min(axis=0) - 0.5
    high = everything.max(axis=0) + 0.5
    width, height = (SCALE * (high - low)).round(1).tolist()

    def placed(points: Array) -> Array:
        """Return image coordinates, y downwards."""
        return np.stack([points[..., 0] - low[0], high[1] - points[..., 1]], axis=-1) * SCALE

    unsure = np.zeros_like(walk.shown) if walk.undecided is None else walk.undecided
    rejected = walk.sideways & ~np.asarray(walk.map.kept) & ~unsure
    points = placed(walk.map.points)
    sizes = np.where(walk.shown, 1.5 + 2 * walk.map.confidence, 2.5)
    # Later shapes lie above earlier ones: walls above the points they were fitted to.
    shapes = [_plan(placed(line)) for line in polylines(outline)]
    shapes.append(_run('polyline class="path"', placed(walk.path)))
    shapes += _dots(points[rejected], kind="rejected", radii=sizes[rejected])
    shapes += _dots(points[unsure], kind="undecided", radii=sizes[unsure])
    shapes += _dots(points[walk.upright], kind="upright", radii=sizes[walk.upright])
    shapes += _dots(points[walk.shown], kind="kept", radii=sizes[walk.shown])
    shapes += [_wall(placed(np.stack([line.start, line.end]))) for line in walk.lines]
    walls = f"{len(walk.lines)} walls fitted"
    if walk.judged is not None:
        walls = f"{walk.judged.believed.sum()} walls by all poses together"
    body = "\n".join(shapes)
    style, further = STYLE, ""
    if walk.undecided is not None:
        style += UNDECIDED
        further = f"; {unsure.sum()} undecided (orange)"
    content = f"""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height + 36}" \
width="{width}" height="{height + 36}">
<style>{style}</style>
<rect width="100%" height="100%" fill="#fff"/>
{body}
<path d="M10 {height + 4}h{SCALE}" stroke="#333" stroke-width="2"/>
<text x="{SCALE + 16}" y="{height + 8}">1 m; {walls} (green){further}</text>
<text x="10" y="{height + 26}">points: {walk.shown.sum()} kept (blue), \
{rejected.sum()} rejected (hollow), {walk.upright.sum()} from floor or ceiling (pink)</text>
</svg>
"""
    return {"map.svg": content.encode()}


def _plan(line: Array) -> str:
    """Return a line of the floor plan, closed if it ends where it begins."""
    if (line[0] == line[-1]).all():
        return _run('polygon class="outline"', line[:-1])
    return _run('polyline class="outline"', line)


def _run(shape: str, points: Array) -> str:
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in points.tolist())
    return f'<{shape} points="{corners}"/>'


def _dots(points: Array, *, kind: str, radii: Array) -> list[str]:
    places = np.column_stack([points, radii]).tolist()
    return [f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}"/>' for x, y, r in places]


def _wall(ends: Array) -> str:
    (x0, y0), (x1, y1) = ends.tolist()
    return f'<line class="wall" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/>'
