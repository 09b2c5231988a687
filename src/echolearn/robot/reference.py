"""What a bundle's classifier has learned from, `reference.npz`: columns of simulated walks.

    rows     float32 (S, n, K): columns of the strongest echo at n poses of S walks
    limits   float32 (2, K): 1 and 99 % of each column over all training rows

`domain` compares recordings with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.localization.columns import EVERY_COLUMN, SEVERAL
from echolearn.robot import untrusted_files

UNLIKE = "unlike what the filter has learned from"
"""What an alarm begins with."""

UNCHECKED = "no reference, not checked"
"""What is said of a bundle that does not tell what it has learned from."""


@dataclass(frozen=True)
class Reference:
    """Columns of simulated walks of the kind that a classifier was trained on.

    Attributes:
        columns: names of K columns.
        rows: of the strongest echo at n poses of S walks, shape (S, n, K).
        limits: lowest and highest usual value of each column, shape (2, K).
    """

    columns: tuple[str, ...]
    rows: Array
    limits: Array

    def __repr__(self) -> str:
        """Say what it is; what it holds would fill pages."""
        walks, poses, _ = self.rows.shape
        return f"<Reference {walks} walks of {poses} poses, {len(self.columns)} columns>"

    def about(self) -> dict[str, Any]:
        """Return what `bundle.json` says of it."""
        walks, poses, _ = self.rows.shape
        return {"columns": list(self.columns), "walks": walks, "poses": poses}

    def to_bytes(self) -> bytes:
        """Return the file."""
        buffer = BytesIO()
        np.savez(buffer, rows=self.rows.astype("<f4"), limits=self.limits.astype("<f4"))
        return buffer.getvalue()


def read_reference(data: bytes, about: Mapping[str, Any], *, name: str) -> Reference:
    """Return the reference in a file that nobody trusts.

    Args:
        data: the file.
        about: what `bundle.json` says of it, of the types that its table wants.
        name: of the file in errors.

    Raises:
        BadValue: other arrays than those, or columns that no recording has.
    """
    columns = about["columns"]
    known = (*EVERY_COLUMN, *SEVERAL)
    once = 0 < len(columns) == len({*columns}) and {*columns} <= {*known}
    allowed = "must be columns, each once"
    check(once, "reference.columns", ", ".join(columns)[:200], allowed=allowed)
    count = len(columns)
    shape = (about["walks"], about["poses"], count)
    expected = {"rows": ("<f4", shape), "limits": ("<f4", (2, count))}
    arrays = untrusted_files.read_arrays(data, expected, name=name)
    ordered = bool((arrays["limits"][0] <= arrays["limits"][1]).all())
    check(ordered, f"{name} limits", "the upper below", allowed="must be the lower first")
    return Reference(tuple(columns), arrays["rows"], arrays["limits"])
