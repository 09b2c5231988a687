"""Carry a study out: estimates value by value, and what is counted from them.

What the localizers get right at one value is one shard of the study's folder, so an interrupted
study goes on with the value it was at. Estimates are not thrown away: a study of another content is
never replaced; intervals (`resamples`) and files of an older format are made anew from them.

Each metric is a share of all recordings. Intervals are a bootstrap over positions; where all or
none of the recordings are right, Wilson's. A localizer that refuses the recordings of an array with
a dead microphone (S-NLS, if it is microphone 1) is wrong in them. One that refuses an array has no
share.
"""

import math
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.arrays import limits
from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check, check_name, check_whole
from echolearn.evaluation import stats
from echolearn.evaluation.rows import Row
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import digest, plain
from echolearn.storage.once import once
from echolearn.studies import curves
from echolearn.studies.accuracy import METRICS
from echolearn.studies.estimates import write_estimates
from echolearn.studies.study import CHANCE, Study


def run_study(
    study: Study,
    *,
    name: str,
    runs: Path,
    workers: int = 1,
    resamples: int = 1000,
    command: str | None = None,
) -> Path:
    """Carry out a study, or what is missing of it; write table and figures, return the folder.

    Args:
        study: what to vary.
        name: names the folder under `runs/study`.
        runs: folder of everything generated.
        workers: processes; the result does not depend on their number.
        resamples: bootstrap draws behind every interval.
        command: what makes the study again, for its manifest; None says nothing about it.

    Raises:
        BadValue: an argument out of range, or a study of that name made with other settings.
    """
    check_name("name", name)
    check_whole("workers", workers, low=1, high=1024)
    check_whole("resamples", resamples, low=20, high=100_000)
    folder = Path(runs) / "study" / name
    about = {"kind": "study", "format": curves.FORMAT, "study": plain(study)}
    about["resamples"] = resamples

    def make() -> str:
        """Make what is missing of the study, then its table and figures; return the table."""
        for place in (folder, folder / "figures"):
            clean(place)
        estimates = folder / _shards_of(about["study"])
        clean(estimates)
        _write_missing(study, estimates, name=name, workers=workers)
        rows = accuracy_rows(study, estimates, resamples=resamples)
        files = curves.study_files(name, vary=study.vary, rows=rows)
        for file, content in files.items():
            write_atomic(folder / file, content)
        manifests.finish(folder, about | manifests.command_entry(command), files=files)
        return files["study.md"].decode()

    finished = partial(_finished, folder, about)
    table = once(folder, finished=finished, make=make, doing="makes this study")
    print(table, *sorted(folder.glob("figures/*.svg")), sep="\n")
    return folder


def _write_missing(study: Study, estimates: Path, *, name: str, workers: int) -> None:
    """Write the shards of a study that are missing.

    Args:
        study: what is varied.
        estimates: folder of the shards, one for each value.
        name: of the study, for the display of progress.
        workers: processes, at most.
    """
    missing = manifests.missing_shards(estimates, len(study.values))
    done = len(study.values) - len(missing)
    with processes(max(1, min(workers, len(missing)))) as pool:
        jobs = [pool.submit(write_estimates, study, estimates, index=index) for index in missing]
        for job in track(jobs, f"study {name}", unit="values", done=done):
            job.result()


def _shards_of(study: Any) -> str:
    """Return the name of the folder with the shards of a study, given as plain containers."""
    return f"estimates-{digest(study)}"


def _finished(folder: Path, about: Mapping[str, Any]) -> str | None:
    """Return the table of this study if it is finished; raise `BadValue` if there is another."""
    there = {path.name for path in folder.glob("estimates-*")}
    manifest: Mapping[str, Any] = {}
    # Of one that is not finished, or damaged, the shards alone tell what it is.
    with suppress(BadValue):
        manifest = manifests.load_manifest(folder)
        there.add(_shards_of(manifest.get("study")))
    check(
        there <= {_shards_of(about["study"])},
        "name",
        folder.name,
        allowed="must be a new name, or that of a study with the same settings",
        hint=f"{folder} has other settings or is of an earlier version; remove it to make it anew",
    )
    with suppress(BadValue):
        manifests.verify(folder)
        if about.items() <= manifest.items():
            return manifests.listed_bytes(folder, manifest, names=["study.md"])["study.md"].decode()
    return None


def accuracy_rows(study: Study, folder: Path, *, resamples: int) -> list[Row]:
    """Return the share of each metric with its interval, one row per value, localizer and metric.

    Args:
        study: what was varied.
        folder: of the shards, one per value.
        resamples: bootstrap draws behind every interval.
    """
    rows = []
    for index, value in enumerate(study.values):
        table = np.load(folder / manifests.shard_name(index), allow_pickle=False)
        weights = stats.cluster_weights(table["position"], resamples=resamples)
        array = study.condition(value).array
        remark = "" if array is None else limits(array)
        for column, name in enumerate([*study.localizers, CHANCE]):
            for metric, right in zip(METRICS, table["hit"][:, column].T, strict=True):
                row = [name, value, metric, *share(right, weights), len(right)]
                row += [remark] if study.vary == "array" else []
                rows.append(dict(zip(curves.columns(study.vary), row, strict=True)))
    return rows


def share(right: Array, weights: Array) -> stats.Interval:
    """Return a share of recordings, right (B,), with its interval by `weights` (resamples, B)."""
    if np.isnan(right).any():
        return stats.Interval(math.nan, math.nan, math.nan)
    if right.min() == right.max():
        # Every resample would be the same: the bootstrap knows no uncertainty here.
        return stats.wilson(round(right.sum()), len(right))
    return stats.interval(
        lambda each: right.mean() if each is None else each @ right / each.sum(axis=-1), weights
    )
