"""`map.csv`, every echo that was heard, and `walls.csv`, the lines fitted to those that are kept."""

from collections.abc import Iterable, Sequence
from io import StringIO

from echolearn.mapping.files.chart import Chart, Files

COLUMNS = "index x_m y_m toa_s azimuth_rad elevation_rad power score confidence kept".split()
WALLS = "x0_m y0_m x1_m y1_m normal_rad offset_m normal_sd_rad offset_sd_m rms_m points".split()


def write(chart: Chart) -> Files:
    """Return both tables; floats in shortest form."""
    echoes, found = chart.echoes, chart.map
    fields = (echoes.toa, echoes.azimuth, echoes.elevation, echoes.power, echoes.score)
    flat = [field.reshape(-1).tolist() for field in fields]
    places, beliefs = (
        found.points.T.tolist(),
        (found.confidence.tolist(), found.kept.astype(int).tolist()),
    )
    numbers = chart.numbers or range(len(chart.path))
    rows = zip((numbers[row] for row in chart.index), *places, *flat, *beliefs, strict=True)
    walls = (
        [*line.start.tolist(), *line.end.tolist(), line.normal, line.offset]
        + [line.normal_sd, line.offset_sd, line.rms, line.points]
        for line in chart.lines
    )
    return {"map.csv": csv_bytes(COLUMNS, rows), "walls.csv": csv_bytes(WALLS, walls)}


def csv_bytes(columns: Sequence[str], rows: Iterable[Sequence[float]]) -> bytes:
    """Return rows of numbers as CSV text."""
    text = StringIO()
    text.write(",".join(columns) + "\n")
    text.writelines(",".join(map(repr, row)) + "\n" for row in rows)
    return text.getvalue().encode()
