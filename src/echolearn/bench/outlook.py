"""The plan of a set of ten million observations, from what the growing set took.

    core seconds = rows / (rows per second / processes),   nodes = core seconds / (cores of a node * hours allowed)

The rate is the steady one of the largest set measured; shards are independent, so cores add up.
"""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

from echolearn.bench.measurement import Measurement
from echolearn.bench.page import describe, plain, table
from echolearn.checks import BadValue

ROWS = 10_000_000
NODE_CORES = 32
HOURS = (1, 4, 12, 24)
SHARD_ROWS = 1024
"""Rows of a shard: in more there are fewer files, and more is lost with a killed worker."""


def outlook(found: Sequence[Measurement], machine: Mapping[str, Any], *, workers: int) -> str:
    """Return the plan as Markdown.

    Raises:
        BadValue: no growing set was measured.
    """
    rows = [m for m in found if m.stage == "rows"]
    if not rows:
        raise BadValue("scaling: needs the stage rows; add it to stages=[...]")
    largest = max(m.value for m in rows)
    of = {m.measure: m.spread for m in rows if m.value == largest}
    rate, size = of["steady rate"].median / workers, of["size"].median / largest
    core_hours = ROWS / rate / 3600
    facts = [
        (
            "rows per second and core",
            plain(
                of["steady rate"]._replace(
                    **{key: value / workers for key, value in of["steady rate"]._asdict().items()}
                )
            ),
        ),
        ("bytes per row", f"{size:.0f}"),
        ("memory of a worker", f"{of['memory, worker'].median / 2**20:.0f} MiB"),
        ("core hours", f"{core_hours:.0f}"),
        ("disk", f"{ROWS * size / 1e9:.0f} GB"),
        ("files", f"{ceil(ROWS / SHARD_ROWS)} shards of `plan.shard_rows={SHARD_ROWS}`"),
    ]
    nodes = [
        (
            str(hours),
            str(ceil(core_hours / hours)),
            str(ceil(core_hours / hours / NODE_CORES)),
            writing(size, hours),
        )
        for hours in HOURS
    ]
    head = ("done in hours", "cores", f"nodes of {NODE_CORES} cores", "written, MB/s")
    source = (
        f"From {largest:,} rows measured with {workers} processes. {describe(machine)}".replace(
            ",", " ", 1
        )
    )
    return "\n\n".join([source, table(("ten million observations", ""), facts), table(head, nodes)])


def writing(size: float, hours: float) -> str:
    """Return how many MB/s all nodes together write."""
    return f"{ROWS * size / hours / 3600 / 1e6:.1f}"
