"""A finished set of walks, read back."""

from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, MicArray
from echolearn.checks import check
from echolearn.storage import manifests
from echolearn.storage.advice import repair_hint
from echolearn.storage.files import let_go, open_array
from echolearn.storage.identity import digest
from echolearn.storage.kinds import folder_kind, told_kind
from echolearn.walls.walk import HeardWalk

KIND = "walks"
"""Kind of these sets in their manifests."""


class WalkSet:
    """A finished set of walks, read from memory-mapped shards whose checksums were verified.

    `walks[row]` is a record (`walk_records`), `walks.heard(row)` what a robot knows of it.
    """

    def __init__(self, folder: Path) -> None:
        """Open the set in `folder`.

        Raises:
            BadValue: not a finished set of walks, or a file that is missing, cut or changed.
        """
        self.folder = Path(folder)
        self.manifest = manifests.load_manifest(self.folder)
        allowed = "must be a folder that echolearn generate plan=walks wrote"
        hint = told_kind(self.folder, folder_kind(self.folder), KIND)
        check(self.manifest.get("kind") == KIND, "set", self.folder, allowed=allowed, hint=hint)
        manifests.check_own_name(self.folder, self.manifest)
        self.digest: str = digest(self.manifest["files"])
        mend = repair_hint(self.manifest, self.folder)
        self._shards = [
            open_array(self.folder / name, size=entry["bytes"], sha256=entry["sha256"], mend=mend)
            for name, entry in sorted(self.manifest["files"].items())
        ]
        self._starts = np.cumsum([0, *map(len, self._shards)])

    @property
    def plan(self) -> dict[str, Any]:
        """The plan, as plain containers."""
        return dict(self.manifest["plan"])

    def __len__(self) -> int:
        return int(self.manifest["rows"])

    def __getitem__(self, row: int) -> Array:
        """Return the record of a walk."""
        check(0 <= row < len(self), "row", row, allowed=f"must be from 0 to {len(self) - 1}")
        number = int(np.searchsorted(self._starts, row, side="right")) - 1
        shard = self._shards[number]
        record = np.array(shard[row - self._starts[number]])
        let_go(shard)
        return record

    def heard(self, row: int) -> HeardWalk:
        """Return a walk as a robot knows it: matched filters, and poses by odometry."""
        record = self[row]
        scene, window = self.plan["scene"], self.plan["window"]
        limits = SearchWindow(window["nearest"], window["farthest"], window["rule"])
        array = MicArray(np.array(self.manifest["microphones"], dtype=float))
        rate, speed = scene["probe"]["sample_rate"], scene["speed_of_sound"]
        return HeardWalk(
            record["outputs"].astype(np.float32), record["told"], limits, array, rate, speed
        )
