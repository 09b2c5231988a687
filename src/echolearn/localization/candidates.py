"""All echoes of a pose together, seen from one of them.

A row of a set, of a comparison and of a map is one echo, and stays so: the tensor of an echo holds
its own description first, then those of the echoes that were estimated beside it in the same
recording. Rows may be shuffled, split and scored in any batch, and no model needs to know which
rows are of one pose. A first number says whether there is a candidate at all; where a localizer
seeks fewer than `CANDIDATES`, or an estimate has no positive gain, the rest is 0.

What an echo means to another is told relative to that one: how much later it comes, from how far to
the left, how much stronger it is. So neither gain nor heading of the robot matters.
"""

from collections.abc import Mapping

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.localization.columns import CANDIDATES

DESCRIBED = (
    "score",
    "peak_to_rms",
    "second_to_first",
    "coherence",
    "joint_ratio",
    "joint_score",
    "joint_lag",
    "gated_ratio",
)
"""Columns of each candidate, as they are."""

NEEDED = (*DESCRIBED, "toa", "gain", "azimuth", "elevation")
"""Columns that candidates are made from."""

LARGEST = 10.0
"""Bound of the logarithm of two gains' ratio."""


def candidates(columns: Mapping[str, Array], *, echoes: int) -> Array:
    """Return the candidates of every echo, shape (P R, `CANDIDATES`, K), float32.

    Args:
        columns: those of `NEEDED` by name, each of shape (P R,), pose by pose, strongest first.
        echoes: R.
    """
    each = {name: columns[name].reshape(-1, echoes) for name in NEEDED}
    # Itself, then the others in their order, shape (R, R).
    order = np.array([[own, *np.delete(np.arange(echoes), own)] for own in range(echoes)])
    seen = {name: values[:, order] for name, values in each.items()}

    turn = seen["azimuth"] - seen["azimuth"][..., :1]
    level = np.sin(seen["elevation"])
    gain = np.maximum(seen["gain"], np.finfo(np.float32).tiny)
    stronger = np.log(gain / gain[..., :1])
    found = [
        (seen["gain"] > 0).astype(float),
        *(seen[name] for name in DESCRIBED),
        seen["toa"] - seen["toa"][..., :1],
        # What comes from the axis has no azimuth.
        level * np.cos(turn),
        level * np.sin(turn),
        level,
        np.clip(stronger, -LARGEST, LARGEST),
    ]
    whole = np.stack(found, axis=-1)
    whole *= whole[..., :1]
    # Of an echo itself there is always a description, whatever its gain.
    whole[..., 0, :] = np.stack([values[..., 0] for values in found], axis=-1)
    whole[..., 0, 0] = 1.0
    whole = whole.reshape(-1, echoes, whole.shape[-1])[:, :CANDIDATES]
    missing = CANDIDATES - whole.shape[1]
    return np.pad(whole, [(0, 0), (0, missing), (0, 0)]).astype(np.float32)
