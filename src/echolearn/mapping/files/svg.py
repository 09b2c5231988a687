"""`map.svg`: the map as a drawing with equal axes: path, kept and rejected points, fitted walls,
the outline if known.

Colours are those of Okabe and Ito, which colour-blind readers tell apart; a rejected point is
hollow besides.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.files.chart import Chart, Files

SCALE = 60
"""Pixels per m."""

STYLE = (
    ".outline{fill:none;stroke:#999;stroke-width:1.5}.path{fill:none;stroke:#bbb;stroke-dasharray:3 3}"
    ".rejected{fill:none;stroke:#D55E00;stroke-width:.8}.kept{fill:#0072B2}"
    ".wall{stroke:#009E73;stroke-width:4;stroke-opacity:.55}text{font:12px sans-serif;fill:#333}"
)


def write(chart: Chart) -> Files:
    """Return the drawing."""
    outline = np.empty((0, 2)) if chart.outline is None else chart.outline
    everything = np.concatenate([chart.map.points, chart.path[:, :2], outline])
    low, high = everything.min(axis=0) - 0.5, everything.max(axis=0) + 0.5
    width, height = (SCALE * (high - low)).round(1).tolist()

    def place(points: Array) -> Array:
        """Return image coordinates, y downwards."""
        return np.stack([points[..., 0] - low[0], high[1] - points[..., 1]], axis=-1) * SCALE

    seen = np.sin(chart.echoes.elevation).reshape(-1) > 0.5
    rejected = seen & ~np.asarray(chart.map.kept)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height + 36}" '
        f'width="{width}" height="{height + 36}">',
        f"<style>{STYLE}</style>",
        '<rect width="100%" height="100%" fill="#fff"/>',
        *(
            [f'<polygon class="outline" points="{_joined(place(outline))}"/>']
            if len(outline)
            else []
        ),
        f'<polyline class="path" points="{_joined(place(chart.path))}"/>',
        *_dots(place(chart.map.points[rejected]), "rejected", [2.5] * int(rejected.sum())),
        *_dots(
            place(chart.map.points[chart.drawn]),
            "kept",
            (1.5 + 2 * chart.map.confidence[chart.drawn]).tolist(),
        ),
        *(_segment(place(np.stack([line.start, line.end]))) for line in chart.lines),
        f'<path d="M10 {height + 4}h{SCALE}" stroke="#333" stroke-width="2"/>',
        f'<text x="{SCALE + 16}" y="{height + 8}">1 m; {len(chart.lines)} walls fitted (green)</text>',
        f'<text x="10" y="{height + 26}">points: {int(chart.drawn.sum())} kept (blue), '
        f"{int(rejected.sum())} rejected (hollow)</text>",
        "</svg>\n",
    ]
    return {"map.svg": "\n".join(parts).encode()}


def _joined(points: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points.tolist())


def _dots(points: Array, kind: str, radii: Sequence[float]) -> Iterable[str]:
    for (x, y), radius in zip(points.tolist(), radii, strict=True):
        yield f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>'


def _segment(ends: Array) -> str:
    (x0, y0), (x1, y1) = ends.tolist()
    return f'<line class="wall" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/>'
