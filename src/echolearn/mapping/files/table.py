"""`map.csv`, every echo, and `walls.csv`, the lines fitted to those that are kept.

Where walls were judged over all poses, `hypotheses.csv` has every line that was asked about.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.mapped_walk import Files, JudgedWalls, MappedWalk

COLUMNS = """
    index x_m y_m toa_s azimuth_rad elevation_rad power score confidence kept floor_or_ceiling
    distance_sd_m azimuth_sd_rad
""".split()
MIRROR = "mirror_of"
"""Column of echoes that have a mirror image: the row of the other point, counted from 0."""
WALLS = "x0_m y0_m x1_m y1_m normal_rad offset_m normal_sd_rad offset_sd_m rms_m points".split()
HYPOTHESES = "normal_rad offset_m strength confidence wall".split()


def write(walk: MappedWalk) -> Files:
    """Return both tables; floats in shortest form. Without a map there are no places, no walls."""
    if not walk.placed:
        return {"map.csv": echo_table(walk)}
    files = {"map.csv": echo_table(walk), "walls.csv": csv_bytes(WALLS, wall_rows(walk))}
    if walk.judged is not None:
        files["hypotheses.csv"] = csv_bytes(HYPOTHESES, hypothesis_rows(walk.judged))
    return files


def echo_table(walk: MappedWalk) -> bytes:
    """Return the text of `map.csv`."""
    rows: list[Sequence[float | str]] = []
    for number, x, y, *rest in echo_rows(walk):
        rows.append([number, x, y, *rest] if walk.placed else [number, "", "", *rest])
    if walk.undecided is None:
        return csv_bytes(COLUMNS, rows)
    # Pairs follow one another: 0 and 1 are one echo's, 2 and 3 the next one's.
    twins = [[*row, number ^ 1] for number, row in enumerate(rows)]
    return csv_bytes([*COLUMNS, MIRROR], twins)


def echo_rows(walk: MappedWalk) -> Iterable[Sequence[float]]:
    """Return a row for each echo, pose by pose, its columns as in `COLUMNS`."""
    echoes, found = walk.echoes, walk.map
    # As objects: a number may name a nanosecond since 1970, of which a float loses the last digits.
    names = np.array(walk.numbers, dtype=object)[walk.index]
    columns: list[Array] = [names, *found.points.T]
    columns += [echoes.toa, echoes.azimuth, echoes.elevation, echoes.power, echoes.score]
    columns += [found.confidence, np.asarray(found.kept, dtype=int), ~walk.sideways + 0]
    columns += walk.accuracy.of_echoes(echoes)
    return zip(*(column.reshape(-1).tolist() for column in columns), strict=True)


def wall_rows(walk: MappedWalk) -> Iterable[Sequence[float]]:
    """Return a row for each fitted line, its columns as in `WALLS`."""
    for line in walk.lines:
        ends = [*line.start.tolist(), *line.end.tolist()]
        sds = [line.normal_sd, line.offset_sd]
        yield *ends, line.normal, line.offset, *sds, line.rms, line.points


def hypothesis_rows(judged: JudgedWalls) -> Iterable[Sequence[float]]:
    """Return a row for each line that was asked about, its columns as in `HYPOTHESES`."""
    columns = [judged.theta, judged.rho, judged.strength, judged.confidence, judged.believed + 0]
    return zip(*(column.tolist() for column in columns), strict=True)


def csv_bytes(columns: Sequence[str], rows: Iterable[Sequence[float | str]]) -> bytes:
    """Return rows of numbers as CSV text; texts as they are."""
    cells = ([cell if isinstance(cell, str) else repr(cell) for cell in row] for row in rows)
    lines = [",".join(columns), *map(",".join, cells)]
    return "\n".join([*lines, ""]).encode()
