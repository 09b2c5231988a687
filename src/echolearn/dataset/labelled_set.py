"""A finished set, read back: columns and tensors by name, from shards checked on opening."""

from collections.abc import Collection
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.signals import joint_db
from echolearn.acoustics.types import Array, MicArray
from echolearn.checks import BadValue, check, suggest
from echolearn.dataset import derived
from echolearn.localization.columns import FURTHER
from echolearn.storage import manifests
from echolearn.storage.advice import data_frame, repair_hint
from echolearn.storage.files import let_go, open_array
from echolearn.storage.identity import digest
from echolearn.storage.kinds import folder_kind, told_kind

RECORDED = "recorded"
"""Kind of the plan of a set that was labelled from a recorded survey."""

FORMAT = 2
"""Version of the sets that are written and read; part of every digest."""


class Dataset:
    """A finished set, read from memory-mapped shards whose checksums were verified on opening.

    `dataset[name]` is a field of all rows, shape (B, ...); `dataset.gather(name, rows)` of some.
    Shards are let go after each look: their pages stay in the system's cache, but are no part of
    this process's memory.
    """

    def __init__(self, folder: Path) -> None:
        """Open the set in `folder`.

        Raises:
            BadValue: not a finished set, or a file that is missing, cut or changed.
        """
        self.folder = Path(folder)
        self.manifest = manifests.load_manifest(self.folder)
        check(
            self.manifest.get("kind") == "set",
            "set",
            self.folder,
            allowed="must be a folder that echolearn generate wrote",
            hint=told_kind(self.folder, folder_kind(self.folder), "set"),
        )
        self._check_format()
        manifests.check_own_name(self.folder, self.manifest)
        self.name: str = self.manifest["plan"]["name"]
        self.digest: str = digest(self.manifest["files"])
        mend = repair_hint(self.manifest, self.folder)
        files = sorted(self.manifest["files"].items())
        self._shards = [
            open_array(self.folder / name, size=entry["bytes"], sha256=entry["sha256"], mend=mend)
            for name, entry in files
        ]
        self._starts = np.cumsum([0, *map(len, self._shards[:-1])])

    def __repr__(self) -> str:
        """Say what it is; what it holds would fill pages."""
        return f"<Dataset {self.name}: {len(self)} rows, {len(self.columns)} columns>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what it is, and its columns."""
        names = ", ".join(f"<code>{escape(name)}</code>" for name in self.columns)
        return f"<p>{escape(repr(self)[1:-1])}</p><p>{names}</p>"

    @property
    def columns(self) -> list[str]:
        """Names of the fields that hold one figure a row; others are tensors."""
        known = self._shards[0].dtype
        return [name for name in known.names or () if known[name].shape == ()]

    def to_pandas(self) -> Any:
        """Return the columns as a `pandas.DataFrame`; pandas is not installed with echolearn."""
        return data_frame()({name: self[name] for name in self.columns})

    def _check_format(self) -> None:
        """Refuse a set whose manifest or columns are those of another version."""
        found = self.manifest.get("format")
        if found != FORMAT:
            maker = "echolearn 0.1" if found == 1 else f"another version (format {found})"
            reason = f"made by {maker}, whose sets this version cannot read"
            raise BadValue(
                f"set={self.folder}: {reason}; {repair_hint(self.manifest, self.folder)}"
            )

    def holds(self, names: Collection[str]) -> bool:
        """Return whether every record has all of these columns and tensors."""
        # Candidates are made of columns that every set has.
        return {*names} - {"candidates"} <= {*(self._shards[0].dtype.names or ())}

    @property
    def echoes(self) -> int:
        """Number of records of each observation."""
        # Hypotheses of walls come from no localizer.
        echoes = self.manifest["plan"].get("localizer", {}).get("echoes", 1)
        return echoes if isinstance(echoes, int) else 1

    @cached_property
    def array(self) -> MicArray | None:
        """What the robot heard with; None of a set whose manifest does not tell."""
        known = self.manifest.get("microphones")
        return None if known is None else MicArray(np.array(known, dtype=float))

    def __len__(self) -> int:
        return int(self.manifest["rows"])

    @property
    def ratio_db(self) -> Array:
        """Received probe over all noises together at microphone 1, in dB, shape (B,)."""
        if self.manifest["plan"].get("sdnr_db") is None:
            return self["snr_db"]
        return joint_db(self["snr_db"], self["sdnr_db"])

    def __getitem__(self, name: str) -> Array:
        return self.gather(name, np.arange(len(self)))

    def gather(self, name: str, rows: Array) -> Array:
        """Return a field of some rows, in their order.

        Args:
            name: of the field.
            rows: their numbers, shape (B,); each shard is visited once, whatever their order.

        Returns:
            Shape (B, ...).

        Raises:
            BadValue: the set has no such field, or no such row.
        """
        known = self._shards[0].dtype
        simulated = self.manifest["plan"].get("kind") != RECORDED
        if simulated and name == derived.NAME and name not in (known.names or ()):
            read = partial(self.gather, rows=rows)
            several = "wall" in (known.names or ())
            about: Any = {"several": several, "array": self.array}
            return derived.time_and_direction(read, self.manifest["plan"], **about)
        if name == "candidates":
            return derived.candidates_of(self.gather, rows, echoes=self.echoes)
        if name not in (known.names or ()):
            hint = suggest(str(name), known.names or ())
            if name in FURTHER:
                hint = f"generate it with plan.further=[{name}]"
            raise BadValue(f"column={name}: must be one of the set's; {hint}")
        found = np.empty((len(rows), *known[name].shape), dtype=known[name].base)
        order = np.argsort(rows, kind="stable")
        ordered = rows[order]
        inside = len(rows) == 0 or 0 <= ordered[0] <= ordered[-1] < len(self)
        asked = f"{ordered[:1]} to {ordered[-1:]}"
        check(inside, "rows", asked, allowed=f"must be from 0 to {len(self) - 1}")

        # In their order the rows of one shard follow each other: it is mapped and let go once.
        places = np.split(order, np.searchsorted(ordered, self._starts[1:]))
        for shard, start, here in zip(self._shards, self._starts, places, strict=True):
            if len(here):
                found[here] = shard[name][rows[here] - start]
                let_go(shard)
        return found
