"""Is the loudspeaker where a survey has it? One that is elsewhere moves all direct paths.

    off_m c / fs = |p_m - d| - |p_m| + b

d, by how much it is moved, and b, what all microphones share, are fitted by least squares. Where
that explains the direct paths of all microphones, no single one of them is late or misplaced.
"""

import numpy as np

from echolearn.acoustics.types import Array

PLACED = 0.005
"""m within which positions of microphones and of a loudspeaker's sound are known."""

FARTHEST = 1.0
MOSTLY = 0.9
"""m by which a loudspeaker may have been measured wrongly, and share of the direct paths that it
must then explain."""


def moved_loudspeaker(off: Array, positions: Array | None, *, metre: float, allowed: float) -> str:
    """Return by how much a loudspeaker seems moved, if that explains all direct paths; else "".

    Gauss and Newton's steps to the least squares of |p_m - d| - |p_m| + b = off_m c / fs.

    Args:
        off: latency less that of the median microphone, shape (P, M); NaN where it is not seen.
        positions: of the microphones around the loudspeaker, shape (M, 3), in m; None if it is not
            carried.
        metre: metres of a sample of path.
        allowed: samples by which a direct path may be off.
    """
    seen = np.isfinite(off).any(axis=0)
    # As many again as there are unknowns beyond those of a plane would fit anything.
    if positions is None or seen.sum() < 5:
        return ""
    ways = metre * np.nanmedian(off[:, seen], axis=0)
    around = positions[seen]
    moved = np.zeros(4)
    for _ in range(8):
        apart = around - moved[:3]
        away = np.linalg.norm(apart, axis=1)
        rest = ways - (away - np.linalg.norm(around, axis=1) + moved[3])
        slope = np.column_stack([-apart / np.maximum(away, 1e-3)[:, None], np.ones(len(away))])
        moved += np.linalg.lstsq(slope, rest, rcond=1e-3)[0]
    left = np.abs(off[:, seen] - (ways - rest) / metre)
    explained = np.mean(left[np.isfinite(left)] <= allowed) > MOSTLY
    told = len(ways) > np.linalg.matrix_rank(slope, tol=1e-3)
    if not (explained and told and PLACED < np.linalg.norm(moved[:3]) < FARTHEST):
        return ""
    shown = ", ".join(f"{each:z.3f}" for each in moved[:3])
    return f"all would fit with loudspeaker moved by [{shown}] m; is it where survey.yaml has it?"
