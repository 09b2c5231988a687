"""Labelled sets of observations: a plan says where and how, `generate` makes the records.

    plan -> shards that are missing -> engine -> records of each (`records`) -> manifest

Row i of a set depends on `SeedSequence(plan.seed, spawn_key=(i,))` alone, and shards are always
computed whole and with one thread, so the bytes are the same for any engine, any number of workers
and any interruption. A shard is one structured array, a record per echo, or per walk where the plan
is of walks.
"""

import json
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.checks import check
from echolearn.dataset.hypothesis_records import HypothesisPlan, hypothesis_records
from echolearn.dataset.labelled_set import FORMAT
from echolearn.dataset.plans import Plan
from echolearn.dataset.records import records
from echolearn.dataset.walk_plan import WalkPlan
from echolearn.dataset.walk_records import walk_records
from echolearn.dataset.walk_set import KIND as WALKS
from echolearn.localization.localizer import returned
from echolearn.runtime.engine import Engine
from echolearn.runtime.progress import track
from echolearn.storage import manifests
from echolearn.storage.files import clean
from echolearn.storage.identity import canonical, plain
from echolearn.storage.once import presence

AnyPlan = Plan | WalkPlan

Made = AnyPlan | HypothesisPlan
"""All that sets are made of; the last is no plan of a user, but follows from that of its walks."""

BLOCK = 16
"""Most rows whose recordings are held at a time: what is computed of few stays near the processor.
"""

ALIKE = 64
"""Rows after which the first published sets began a new block."""

PATIENCE = 60.0
"""Seconds until a file that another machine wrote must be seen."""

SHARED = "a folder that all workers see and write to at the same path; some worker does not"


def generate(plan: Made, *, runs: Path, engine: Engine, command: str | None = None) -> Path:
    """Make the set of a plan; finished shards are kept, a finished set is skipped.

    Args:
        plan: what to observe.
        runs: folder of everything generated; workers of the engine write into it, wherever they
            are.
        engine: where the shards are computed; the result does not depend on it.
        command: what makes the set again, for the manifest; None says nothing about it.

    Returns:
        The set's folder, complete.

    Raises:
        BadValue: more shards than a manifest can name, the engine cannot work, or the disk is full,
            or not shared by the workers.
    """
    folder = folder_of(plan, runs)
    count = -(-len(plan) // plan.shard_rows)
    allowed = f"must make at most {manifests.MOST} shards of the {len(plan)} rows"
    fits = count <= manifests.MOST
    check(fits, "plan.shard_rows", plan.shard_rows, allowed=allowed, hint="make it larger")

    clean(folder)
    if manifests.is_finished(folder):
        # Its digest is that of its plan: a folder that was renamed holds the rows of another.
        own = manifests.load_manifest(folder).get("plan") == json.loads(canonical(plan_entry(plan)))
        allowed = "must hold the set of its own plan"
        check(own, "folder", folder, allowed=allowed, hint="was it renamed or copied? remove it")
    missing = manifests.missing_shards(folder, count)
    if missing:
        # The mark is how a worker elsewhere knows that its folder is this one.
        with (
            presence(folder.resolve()) as mark,
            closing(engine(partial(_write, plan=plan, mark=mark), missing)) as jobs,
        ):
            title = f"generate {folder.name}"
            for _ in track(jobs, title, total=count, unit="shards", done=count - len(missing)):
                pass
        _await([manifests.sidecar(folder / manifests.shard_name(shard)) for shard in missing])

    if missing or not manifests.is_finished(folder):
        about = _about(plan, folder, count=count) | manifests.command_entry(command)
        names = map(manifests.shard_name, range(count))
        manifests.finish(folder, about, files=names)
    return folder


def _about(plan: Made, folder: Path, *, count: int) -> dict[str, Any]:
    """Return what the manifest of a set in a folder of so many shards says of it."""
    kind, scene, rows = "set", _walks(plan).scene, len(plan)
    if isinstance(plan, WalkPlan):
        kind = WALKS
    elif isinstance(plan, HypothesisPlan):
        # How many there are shows when all have been sought.
        shards = map(manifests.shard_name, range(count))
        rows = sum(len(np.load(folder / name, mmap_mode="r")) for name in shards)
    else:
        rows *= returned(plan.localizer)
    about: dict[str, Any] = {"kind": kind, "format": FORMAT, "rows": rows, "plan": plan_entry(plan)}
    return about | {"microphones": scene.array.positions.tolist()}


def plan_entry(plan: Made) -> dict[str, Any]:
    """Return a plan as its manifest has it: that of hypotheses has the name and role of a set."""
    about: dict[str, Any] = plain(plan)
    if isinstance(plan, HypothesisPlan):
        about |= {"name": f"{plan.walks.name}_hypotheses", "role": plan.walks.role}
    return about


def _walks(plan: Made) -> AnyPlan:
    """Return the plan of what was recorded."""
    return plan.walks if isinstance(plan, HypothesisPlan) else plan


def folder_of(plan: Made, runs: Path) -> Path:
    """Return the folder of a plan's set, named after the digest of the plan."""
    return Path(runs) / "data" / manifests.set_name({"format": FORMAT, "plan": plan_entry(plan)})


def _write(shard: int, *, plan: Made, mark: Path) -> None:
    """Write one shard beside the mark by which a worker knows the folder."""
    check(mark.is_file(), "runs", mark.parent, allowed=SHARED)
    rows = range(len(plan))[shard * plan.shard_rows :][: plan.shard_rows]
    if isinstance(plan, WalkPlan):
        table = walk_records(plan, rows)
    elif isinstance(plan, HypothesisPlan):
        source = folder_of(plan.walks, mark.parents[2])
        table = hypothesis_records(plan, rows, source=source)
    else:
        # A device is given all at once: it idles over few.
        parts = row_blocks(rows) if plan.matched_filters == "compiled" else [rows]
        table = np.concatenate([records(plan, part) for part in parts])
    manifests.write_shard(mark.parent, shard, array=table)


def row_blocks(rows: range) -> Iterator[range]:
    """Yield the rows that are computed together: few, and never one alone but where it always was.

    A single row takes another way through matrix products, and so has other last bits.
    """
    for start in range(0, len(rows), ALIKE):
        alike = rows[start : start + ALIKE]
        count = -(-len(alike) // BLOCK)
        ends = [len(alike) * part // count for part in range(count + 1)]
        yield from (alike[first:last] for first, last in pairwise(ends))


def _await(paths: list[Path]) -> None:
    """Wait for files that others have written: a network's disk may show them late."""
    folder = paths[0].parent
    until = time.monotonic() + PATIENCE
    while absent := [path for path in paths if not path.is_file()]:
        # Another command may have finished the set, and a finished set has none of them left.
        if manifests.is_finished(folder):
            return
        allowed = f"{SHARED} ({absent[0].name} is not seen)"
        check(time.monotonic() < until, "runs", folder, allowed=allowed)
        time.sleep(0.2)
