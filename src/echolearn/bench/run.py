"""Run the benchmarks and write what they found: `bench.csv`, all repetitions, machine, tables,
figures.

Stages run in one process that computes with one thread; one that fails stops no other. Nothing is
kept from an earlier
benchmark: what stands side by side was measured in one run, on one machine. Results are written
    when all are done.
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

from echolearn.bench.localizers import localizers
from echolearn.bench.measurement import COLUMNS, Measurement, Setting
from echolearn.bench.models import inference, training
from echolearn.bench.outlook import outlook
from echolearn.bench.page import growth
from echolearn.bench.page import page as tables
from echolearn.bench.responses import responses
from echolearn.bench.robot import robot
from echolearn.bench.sets import generating, growing
from echolearn.bench.start import start
from echolearn.bench.steps import steps
from echolearn.checks import check, check_list, suggest
from echolearn.comparison import report
from echolearn.dataset.plans import Plan, ScatteredPlan
from echolearn.evaluation.rows import to_csv
from echolearn.localization.localizer import Localizer
from echolearn.runtime.processes import processes
from echolearn.storage import manifests
from echolearn.storage.files import clean, json_bytes, one_line, write_atomic
from echolearn.storage.marked_page import Markers, around, write_between

STAGES: dict[str, Callable[[Setting], Iterable[Measurement]]] = {
    "rir": responses,
    "localize": localizers,
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
REPETITIONS = "stage variant parameter value measure unit repetition result".split()
"""Columns of `repetitions.csv`."""

SCRATCH = ".scratch-"
"""What folders begin with that are removed in the end."""

Point = tuple[float, float, float, float]
Panels = dict[str, dict[str, list[Point]]]


class StagesFailed(Exception):
    """Some stages failed; each has been reported."""


def bench(
    *,
    plan: Plan,
    growing: ScatteredPlan,
    localizers: Mapping[str, Localizer],
    runs: Path,
    stages: Sequence[str] = tuple(STAGES),
    page: Path | None = None,
    scaling: Path | None = None,
    command: str | None = None,
    **often: Any,
) -> Path:
    """Time the stages, write everything into `runs/bench`, and print the tables.

    Args:
        plan, growing, localizers, runs, often: see `Setting`.
        stages: which ones, by name.
        page: a Markdown page whose tables of times, between markers, are replaced; None leaves it.
        scaling: a file whose plan of a large set, between markers, is replaced; needs the stage
            `rows`.
        command: what does it again, for the manifest.

    Returns:
        The folder.

    Raises:
        BadValue: an unknown stage, a page without its markers, a setting out of range.
        StagesFailed: some did; what the others found is in the folder.
    """
    check_list("stages", stages)
    check(
        len(stages) > 0,
        "stages",
        "[]",
        allowed=f"some of {', '.join(STAGES)}",
        hint="a benchmark replaces the last",
    )
    for stage in stages:
        check(
            stage in STAGES,
            "stages",
            stage,
            allowed=f"of {', '.join(STAGES)}",
            hint=suggest(str(stage), [*STAGES]),
        )
    for path, markers in ((page, PAGE), (scaling, SCALING)):
        if path is not None:
            around(path, markers)
    needed = scaling is None or "rows" in stages
    check(
        needed,
        "stages",
        list(stages),
        allowed="with rows among them",
        hint="scaling= is written from it",
    )
    folder, before = Path(runs) / "bench", os.getloadavg()[0]
    setting = Setting(plan, growing, localizers, Path(runs), folder, **often)
    for killed in folder.glob(f"{SCRATCH}*"):
        shutil.rmtree(killed, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=SCRATCH, ignore_cleanup_errors=True) as place:
        wanted = [stage for stage in STAGES if stage in stages]
        found, failed = measured(wanted, replace(setting, place=Path(place)))
    machine = describe(load_before=before)
    write(folder, results(found, machine), manifests.command_entry(command))
    sys.stdout.write(f"{tables(found, machine)}\n\n")
    if failed:
        raise StagesFailed(
            f"{', '.join(failed)}: failed; no page was changed, {folder} holds the others"
        )
    if page is not None:
        write_between(page, tables(found, machine, brief=True), PAGE)
    if scaling is not None:
        write_between(scaling, outlook(found, machine, workers=setting.workers), SCALING)
    return folder


def measured(stages: Sequence[str], setting: Setting) -> tuple[list[Measurement], list[str]]:
    """Return what the stages find, in a process with one thread, and those that failed, each after
    a line about it.
    """
    found, failed = list[Measurement](), list[str]()
    with processes(1) as pool:
        for stage in stages:
            print(f"bench {stage}", file=sys.stderr, flush=True)
            try:
                found += pool.submit(_run, stage, setting).result()
            except KeyboardInterrupt:
                for worker in active_children():
                    worker.terminate()  # a stage takes minutes; its own processes end with it
                raise
            except Exception as error:
                failed.append(stage)
                print(
                    f"bench {stage}: {type(error).__name__}: {one_line(error)}",
                    file=sys.stderr,
                    flush=True,
                )
    return found, failed


def _run(stage: str, setting: Setting) -> list[Measurement]:
    return list(STAGES[stage](setting))


def results(found: Sequence[Measurement], machine: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of a benchmark by name."""
    drawn = figures_of(found)
    parts = [tables(found, machine), *(f"![{Path(name).stem}]({name})" for name in drawn)]
    return drawn | {
        "bench.md": ("\n\n".join(parts) + "\n").encode(),
        "bench.csv": to_csv((exact(m.row()) for m in found), COLUMNS),
        "repetitions.csv": every(found),
        "machine.json": json_bytes(machine),
    }


def write(folder: Path, files: Mapping[str, bytes], about: Mapping[str, str]) -> None:
    """Write the results in place of older ones, and then their manifest."""
    clean(folder)
    for old in (folder / "figures").glob("*.svg"):
        old.unlink()
    for name, content in files.items():
        write_atomic(folder / name, content)
    manifests.finish(folder, {"kind": "benchmark", **about}, files)


def every(found: Iterable[Measurement]) -> bytes:
    """Return `repetitions.csv`: one row for each repetition of each measurement."""
    rows = [
        exact(
            {key: getattr(m, key) for key in REPETITIONS[:6]}
            | {"repetition": number, "result": value}
        )
        for m in found
        for number, value in enumerate(m.repetitions)
    ]
    return to_csv(rows, REPETITIONS)


def exact(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with seven significant digits of each figure, as microseconds need; nothing for
    NaN.
    """
    floats = {key: value for key, value in row.items() if isinstance(value, float)}
    return {**row, **{key: "" if isnan(value) else f"{value:.7g}" for key, value in floats.items()}}


def describe(*, load_before: float) -> dict[str, Any]:
    """Return the machine, what it can use of it, and how busy it was."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    busy = {"load_before": round(load_before, 2), "load_after": round(os.getloadavg()[0], 2)}
    return (
        report.machine()
        | busy
        | {"memory_gib": round(memory, 1), "usable_cores": len(os.sched_getaffinity(0))}
    )


AXES = {
    "t60": "reverberation time / s",
    "microphones": "microphones",
    "azimuths": "directions of the grid",
}
HEIGHTS = {
    "rir": "all responses of a position / s",
    "localize": "one observation / s",
    "rows": "rows per second",
    "memory": "peak memory / MiB",
}
"""What the axes of figures say, by parameter and by figure."""


def figures_of(found: Sequence[Measurement]) -> dict[str, bytes]:
    """Return the figures of growth, by file name: times of responses and localizers, rows per
    second, memory.
    """
    from echolearn.comparison import figures

    drawn: dict[str, Panels] = {}
    for line in growth(found):
        panel = drawn.setdefault(line[0].stage, {}).setdefault(AXES[line[0].parameter], {})
        panel[line[0].variant] = points(line)
    for m in found:
        if m.stage == "rows" and m.measure not in ("wall", "size"):
            kind, _, label = m.measure.rpartition(", ")
            line = [
                other for other in found if (other.stage, other.measure) == (m.stage, m.measure)
            ]
            unit = 2**20 if kind else 1
            scaled = [
                (x, middle / unit, low / unit, high / unit) for x, middle, low, high in points(line)
            ]
            named = label if kind else {"rate": "whole call", "steady rate": "once started"}[label]
            drawn.setdefault(kind or "rows", {}).setdefault("rows generated", {})[named] = scaled
    texts = {
        kind: figures.powers(
            panels, ylabel=HEIGHTS.get(kind, f"{kind} / s"), level=kind in ("rows", "memory")
        )
        for kind, panels in drawn.items()
    }
    return {f"figures/{name}.svg": text.encode() for name, text in texts.items()}


def points(line: Sequence[Measurement]) -> list[Point]:
    """Return a series as points of a figure: value, median, quartiles."""
    return [(float(m.value), *m.spread) for m in line]
