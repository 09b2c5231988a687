"""Run the benchmarks and write what they found: tables, all repetitions, the machine.

Stages run in one process that computes with one thread; one that fails stops no other. Nothing is
kept from an earlier benchmark: what stands side by side was measured in one run, on one machine.
Results are written when all are done.
"""

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import isnan
from multiprocessing import active_children
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from echolearn.bench.localizers import time_localizers
from echolearn.bench.measurement import COLUMNS, KEYS, Measurement, Setting
from echolearn.bench.models import inference, training
from echolearn.bench.outlook import outlook
from echolearn.bench.page import page as tables
from echolearn.bench.responses import time_responses
from echolearn.bench.robot import robot
from echolearn.bench.sets import generating, growing
from echolearn.bench.start import start
from echolearn.bench.steps import steps
from echolearn.checks import check, check_list, suggest
from echolearn.comparison import report
from echolearn.evaluation.rows import to_csv
from echolearn.runtime.processes import processes
from echolearn.storage import manifests
from echolearn.storage.files import clean, json_bytes, one_line, write_atomic
from echolearn.storage.marked_page import Markers, around, write_between

STAGES: dict[str, Callable[[Setting], Iterable[Measurement]]] = {
    "rir": time_responses,
    "localize": time_localizers,
    "steps": steps,
    "generate": generating,
    "rows": growing,
    "train": training,
    "models": inference,
    "robot": robot,
    "start": start,
}
PAGE = Markers("<!-- bench: written by echolearn bench -->", "<!-- end bench -->", "page")
SCALING = Markers("<!-- scaling: written by echolearn bench -->", "<!-- end scaling -->", "scaling")
REPETITIONS = [*KEYS, "repetition", "result"]
"""Columns of `repetitions.csv`."""

SCRATCH = ".scratch-"
"""What folders begin with that are removed in the end."""


class StagesFailed(Exception):
    """Some stages failed; each has been reported."""


def bench(
    *,
    runs: Path,
    stages: Sequence[str] = tuple(STAGES),
    page: Path | None = None,
    scaling: Path | None = None,
    command: str | None = None,
    **often: Any,
) -> Path:
    """Time the stages, write everything into `runs/bench`, and print the tables.

    Args:
        runs, often: see `Setting`.
        stages: which ones, by name.
        page: a Markdown page whose tables of times, between markers, are replaced.
        scaling: a Markdown page whose plan of a large set, between markers, is replaced; needs the
            stage `rows`.
        command: what does it again, for the manifest.

    Returns:
        The folder.

    Raises:
        BadValue: an unknown stage, a page without its markers, a setting out of range.
        StagesFailed: some did; what the others found is in the folder.
    """
    check_stages(stages, page=page, scaling=scaling)
    folder = Path(runs) / "bench"
    setting = Setting(runs=Path(runs), place=folder, **often)
    load_before = os.getloadavg()[0]
    # A killed benchmark could not remove its own.
    for killed in folder.glob(f"{SCRATCH}*"):
        shutil.rmtree(killed, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=SCRATCH, ignore_cleanup_errors=True) as place:
        found, failed = measure_stages(stages, replace(setting, place=Path(place)))
    machine = describe_machine(load_before=load_before)
    write_results(folder, found, machine=machine, command=command)
    sys.stdout.write(f"{tables(found, machine)}\n\n")
    # Pages show whole benchmarks only: half of one would replace more than it measured.
    if failed:
        told = f"failed; no page was changed, {folder} holds the others"
        raise StagesFailed(f"{', '.join(failed)}: {told}")
    if page is not None:
        write_between(page, tables(found, machine, brief=True), markers=PAGE)
    if scaling is not None:
        write_between(scaling, outlook(found, machine, workers=setting.workers), markers=SCALING)
    return folder


def check_stages(stages: Sequence[str], *, page: Path | None, scaling: Path | None) -> None:
    """Raise `BadValue` unless all stages are known and the pages can be written.

    Args:
        stages: names of stages.
        page, scaling: pages with markers, or None.
    """
    check_list("stages", stages)
    allowed = f"must be some of {', '.join(STAGES)}"
    hint = "a benchmark replaces the last"
    check(len(stages) > 0, "stages", "[]", allowed=allowed, hint=hint)
    for stage in stages:
        check(stage in STAGES, "stages", stage, allowed=allowed, hint=suggest(stage, [*STAGES]))
    if page is not None:
        around(page, PAGE)
    if scaling is not None:
        around(scaling, SCALING)
    needed = scaling is None or "rows" in stages
    hint = "scaling= is written from it"
    check(needed, "stages", list(stages), allowed="must have rows among them", hint=hint)


def measure_stages(stages: Sequence[str], setting: Setting) -> tuple[list[Measurement], list[str]]:
    """Return what stages find, in a process with one thread, and which of them failed."""
    found: list[Measurement] = []
    failed: list[str] = []
    with processes(1) as pool:
        for stage in sorted(set(stages), key=[*STAGES].index):
            print(f"bench {stage}", file=sys.stderr)
            try:
                found += pool.submit(_measure, stage, setting).result()
            except KeyboardInterrupt:
                for worker in active_children():
                    worker.terminate()  # a stage takes minutes; its own processes end with it
                raise
            except Exception as error:
                failed.append(stage)
                told = f"{type(error).__name__}: {one_line(error)}"
                print(f"bench {stage}: {told}", file=sys.stderr)
    return found, failed


def _measure(stage: str, setting: Setting) -> list[Measurement]:
    return list(STAGES[stage](setting))


def write_results(
    folder: Path, found: Sequence[Measurement], *, machine: Mapping[str, Any], command: str | None
) -> None:
    """Write the results in place of older ones, and then their manifest.

    Args:
        folder: of the benchmark.
        found: all measurements.
        machine: what they were made on.
        command: what does it again.
    """
    repetitions = (
        m.keys | {"repetition": number, "result": value}
        for m in found
        for number, value in enumerate(m.repetitions)
    )
    files = {
        "bench.md": f"{tables(found, machine)}\n".encode(),
        "bench.csv": to_csv((in_seven_digits(m.row()) for m in found), COLUMNS),
        "repetitions.csv": to_csv(map(in_seven_digits, repetitions), REPETITIONS),
        "machine.json": json_bytes(machine),
    }
    clean(folder)
    for name, content in files.items():
        write_atomic(folder / name, content)
    about = {"kind": "benchmark", **manifests.command_entry(command)}
    manifests.finish(folder, about, files=files)


def in_seven_digits(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with seven digits of each figure, as microseconds need; nothing for NaN."""
    shown = dict(row)
    for key, value in row.items():
        if isinstance(value, float):
            shown[key] = "" if isnan(value) else f"{value:.7g}"
    return shown


def describe_machine(*, load_before: float) -> dict[str, Any]:
    """Return the machine, what can be used of it, and how busy it was."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return report.machine() | {
        "load_before": round(load_before, 2),
        "load_after": round(os.getloadavg()[0], 2),
        "memory_gib": round(memory, 1),
        "usable_cores": len(os.sched_getaffinity(0)),
    }
