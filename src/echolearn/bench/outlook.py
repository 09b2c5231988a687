"""The plan of a set of ten million observations, from what the growing set took.

    core seconds = rows / (rows per second / processes)
    nodes = core seconds / (cores of a node * hours allowed)

The rate is the steady one of the largest set measured; shards are independent, so cores add up.
"""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

from echolearn.bench.measurement import Measurement
from echolearn.bench.page import Cell, measured_on, table, with_quartiles
from echolearn.checks import BadValue
from echolearn.runtime.timing import Spread

ROWS = 10_000_000
NODE_CORES = 32
HOURS = (1, 4, 12, 24)
SHARD_ROWS = 1024
"""Rows of a shard: in more there are fewer files, and more is lost with a killed worker."""


def outlook(found: Sequence[Measurement], machine: Mapping[str, Any], *, workers: int) -> str:
    """Return the plan as Markdown.

    Args:
        found: measurements, those of the growing set among them.
        machine: what they were made on.
        workers: processes that made the set.

    Raises:
        BadValue: no growing set was measured.
    """
    rows = [m for m in found if m.stage == "rows"]
    if not rows:
        raise BadValue("scaling: needs the stage rows; add it to stages=[...]")
    largest = max(m.value for m in rows)
    # The largest set has the steadiest rate, and its start weighs least.
    of = {m.measure: m.spread for m in rows if m.value == largest}
    per_core = Spread(*(part / workers for part in of["steady rate"]))
    row_bytes = of["size"].median / largest
    core_hours = ROWS / per_core.median / 3600
    facts = {
        "rows per second and core": with_quartiles(per_core),
        "bytes per row": f"{row_bytes:.0f}",
        "memory of a worker": f"{of['memory, worker'].median / 2**20:.0f} MiB",
        "core hours": f"{core_hours:.0f}",
        "disk": f"{ROWS * row_bytes / 1e9:.0f} GB",
        "files": f"{ceil(ROWS / SHARD_ROWS)} shards of `plan.shard_rows={SHARD_ROWS}`",
    }
    times: list[Cell] = []
    for hours in HOURS:
        cores = core_hours / hours
        times.append((str(hours), "cores", str(ceil(cores))))
        times.append((str(hours), f"nodes of {NODE_CORES} cores", str(ceil(cores / NODE_CORES))))
        written = ROWS * row_bytes / hours / 3600 / 1e6
        times.append((str(hours), "written, MB/s", f"{written:.1f}"))
    measured = f"{largest:,}".replace(",", " ")
    source = f"From {measured} rows measured with {workers} processes. {measured_on(machine)}"
    needed = table("ten million observations", ((fact, "", said) for fact, said in facts.items()))
    return "\n\n".join([source, needed, table("done in hours", times)])
