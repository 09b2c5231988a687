"""Labelled sets of observations: a plan says where and how, `generate` simulates, estimates, describes, labels.

Row i of a set depends on `SeedSequence(plan.seed, spawn_key=(i,))` alone, and shards are always computed
whole and with one thread, so the bytes are the same for any engine, any number of workers and any interruption.

A shard is one structured array, a record per echo (`records`).
"""

import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import fields, is_dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from echolearn import disk, store
from echolearn.engine import Engine
from echolearn.plans import Plan
from echolearn.progress import track
from echolearn.records import records
from echolearn.signals import joint_db
from echolearn.types import Array, BadValue, check, check_number

FORMAT = 1
"""Version of the records; part of every digest."""

BLOCK = 64
"""Rows whose recordings are held at a time, 4.5 MB each with all that is computed from them."""

PATIENCE = 60.0
"""Seconds until a file that another machine wrote must be seen."""

SHARED = "a folder that all workers see and write to at the same path; some worker does not"


def plain(value: Any) -> Any:
    """Return `value` as plain containers for a manifest: dataclasses by their fields, arrays by their hash.

    A field marked `LATER` is left out while it has its default.
    """
    if is_dataclass(value) and not isinstance(value, type):
        name = f"{type(value).__module__}.{type(value).__qualname__}"
        held = {f.name: getattr(value, f.name) for f in fields(value)}
        absent = {f.name for f in fields(value) if "later" in f.metadata and _is_default(held[f.name], f.default)}
        return {"_target_": name, **{key: plain(item) for key, item in held.items() if key not in absent}}
    if isinstance(value, np.ndarray):
        return {"shape": list(value.shape), "sha256": sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _is_default(value: Any, default: Any) -> bool:
    return value is default or (isinstance(default, int | str) and bool(value == default))


def noise_kind(scene: Mapping[str, Any], *, sensor: bool = True) -> str:
    """Return the names of a scene's noises, "white" or "white+rotor".

    Args:
        scene: as plain containers.
        sensor: whether the microphones have noise of their own.
    """
    heard = [scene["noise"]] if sensor else []
    if "diffuse" in scene:
        heard.append(scene["diffuse"].get("source", scene["diffuse"]))
    return "+".join(noise["_target_"].rpartition(".")[2].lower() for noise in heard)


def folder_of(plan: Plan, runs: Path) -> Path:
    """Return the folder of a plan's set, named after the digest of the plan."""
    return Path(runs) / "data" / f"{plan.name}-{disk.digest({'format': FORMAT, 'plan': plain(plan)})}"


def generate(plan: Plan, *, runs: Path, engine: Engine, command: str | None = None) -> Path:
    """Simulate, estimate, describe and label every row of a plan; finished shards are kept, a finished set is skipped.

    Args:
        plan: what to observe.
        runs: folder of everything generated; workers of the engine write into it, wherever they are.
        engine: where the shards are computed; the result does not depend on it.
        command: what makes the set again, for the manifest; None says nothing about it.

    Returns:
        The set's folder, complete.

    Raises:
        BadValue: more shards than a manifest can name, the engine cannot work, or the disk is full, or not shared by
            the workers.
    """
    folder, shards = folder_of(plan, runs), -(-len(plan) // plan.shard_rows)
    name, allowed = "plan.shard_rows", f"at most {store.MOST} shards of {len(plan)} rows"
    check(shards <= store.MOST, name, plan.shard_rows, allowed=allowed, hint="make it larger")
    disk.clean(folder)
    names = [store.shard_name(shard) for shard in range(shards)]
    missing = store.missing_shards(folder, len(names))
    if missing:
        _simulate(plan, folder, missing, done=len(names) - len(missing), engine=engine)
    if missing or not store.is_finished(folder):
        about = {"kind": "set", "format": FORMAT, "rows": len(plan) * plan.localizer.echoes, "plan": plain(plan)}
        store.finish(folder, about | store.made_by(command), names)
    return folder


def _simulate(plan: Plan, folder: Path, missing: list[int], *, done: int, engine: Engine) -> None:
    """Write the missing shards."""
    with disk.presence(folder.resolve()) as mark, closing(engine(partial(_write, plan, mark), missing)) as jobs:
        for _ in track(jobs, f"generate {folder.name}", total=done + len(missing), unit="shards", done=done):
            pass
    _await([store.sidecar(folder / store.shard_name(shard)) for shard in missing])


def _write(plan: Plan, mark: Path, shard: int) -> None:
    """Write one shard beside the mark by which a worker knows the folder."""
    check(mark.is_file(), "runs", mark.parent, allowed=SHARED)
    rows = range(len(plan))[shard * plan.shard_rows :][: plan.shard_rows]
    blocks = [records(plan, rows[start : start + BLOCK]) for start in range(0, len(rows), BLOCK)]
    store.write_shard(mark.parent, shard, np.concatenate(blocks))


def _await(paths: list[Path]) -> None:
    """Wait for files that others have written: a network's disk may show them late. A finished set has none left."""
    until, folder = time.monotonic() + PATIENCE, paths[0].parent
    while absent := [path for path in paths if not path.is_file()]:
        if store.is_finished(folder):  # by another command
            return
        check(time.monotonic() < until, "runs", folder, allowed=f"{SHARED} ({absent[0].name} is not seen)")
        time.sleep(0.2)


class Dataset:
    """A finished set, read from memory-mapped shards whose checksums were verified on opening.

    `dataset[name]` is a field of all rows, shape (B, ...); `dataset.gather(name, rows)` of some. Shards are let go
    after each look: their pages stay in the system's cache, but are no part of this process's memory.
    """

    def __init__(self, folder: Path) -> None:
        """Open the set in `folder`.

        Raises:
            BadValue: not a finished set, or a file that is missing, cut or changed.
        """
        self.folder = Path(folder)
        self.manifest = store.load_manifest(self.folder)
        check(self.manifest.get("kind") == "set", "set", self.folder, allowed="a folder written by echolearn generate")
        self.name: str = self.manifest["plan"]["name"]
        self.digest: str = disk.digest(self.manifest["files"])
        mend = store.advice(self.manifest)
        files = sorted(self.manifest["files"].items())
        self._shards = [
            disk.open_array(self.folder / name, size=entry["bytes"], sha256=entry["sha256"], mend=mend)
            for name, entry in files
        ]
        self._ends = np.cumsum([len(shard) for shard in self._shards])

    def __len__(self) -> int:
        return int(self.manifest["rows"])

    @property
    def ratio_db(self) -> Array:
        """Received probe over all noises together at microphone 1, in dB, shape (B,)."""
        if "sdnr_db" not in self.manifest["plan"]:
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
        if name not in (known.names or ()):
            raise BadValue(
                f"column={name}: one of {', '.join(known.names or ())}; does the set come from an older version?"
            )
        found = np.empty((len(rows), *known[name].shape), dtype=known[name].base)
        order = np.argsort(rows, kind="stable")
        ordered = rows[order]
        inside = len(rows) == 0 or 0 <= ordered[0] <= ordered[-1] < len(self)
        check(inside, "rows", f"{ordered[:1]} to {ordered[-1:]}", allowed=f"from 0 to {len(self) - 1}")
        stops = np.searchsorted(ordered, self._ends)
        for index in np.flatnonzero(np.diff(stops, prepend=0)):
            start = stops[index - 1] if index else 0
            here, first = order[start : stops[index]], self._ends[index] - len(self._shards[index])
            found[here] = self._shards[index][name][ordered[start : stops[index]] - first]
            disk.let_go(self._shards[index])
        return found


def split(groups: Array, *, share: float, seed: int) -> tuple[Array, Array]:
    """Split rows so that no group falls on both sides.

    Args:
        groups: position of each row, shape (B,).
        share: of the groups that go to the second part, 0 to 1.
        seed: of the shuffle.

    Returns:
        Row indices of the first and of the second part, ascending.
    """
    check_number("share", share, low=0.0, high=1.0)
    unique = np.unique(groups)
    chosen = np.random.default_rng(seed).permutation(unique)[: round(share * len(unique))]
    second = np.isin(groups, chosen)
    return np.flatnonzero(~second), np.flatnonzero(second)
