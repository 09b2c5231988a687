"""Bundles in a comparison: each is a row beside the runs, scored as a robot scores with it.

    name or folder --load, golden inputs--> Run whose model and metrics are those of `bundle.json`

A bundle is of one run. Where that is there, too, the rows that it held out of its training set are
known; where it is not, the bundle is not judged on that set (`rows.OWN_SET`). Of a bundle the
classifier alone is judged, on the same echoes as all others.
"""

from collections.abc import Sequence
from pathlib import Path

from echolearn.checks import check
from echolearn.comparison.fitting import Robot, robot_of
from echolearn.evaluation.rows import BUNDLE
from echolearn.robot.bundle import Bundle
from echolearn.robot.scorer import load
from echolearn.robot.shipped import find_bundle
from echolearn.training.runs import Run


def opened_bundle(
    names: Sequence[str], runs: Path, *, finished: Sequence[Run]
) -> list[tuple[Run, Robot]]:
    """Return bundles as runs, each with the robot it was made for; golden inputs are replayed.

    Args:
        names: names or folders of bundles.
        runs: folder of everything generated.
        finished: runs, of which one may be that of a bundle.

    Raises:
        BadValue: one is missing, damaged or not allowed, computes something else here, or has the
            name of another.
    """
    found: list[tuple[Run, Robot]] = []
    for name in names:
        folder = find_bundle(name, runs, key="bundles")
        bundle = load(folder).bundle
        hint = "that judges walls, as runs do that walks= compares"
        single = bundle.hypotheses is None
        check(single, "bundles", name, allowed="must judge echoes", hint=hint)
        run = Run(folder, metrics_of(bundle, finished))
        alone = all(run.model != other.model for other, _ in found)
        allowed = "must be bundles of different names"
        hint = f"another one is called {bundle.about['name']} and trained alike"
        check(alone, "bundles", folder, allowed=allowed, hint=hint)
        found.append((run, robot_of(bundle.array, bundle.probe.sample_rate)))
    return found


def metrics_of(bundle: Bundle, runs: Sequence[Run]) -> dict[str, object]:
    """Return what a comparison reads of a run's metrics, of a bundle."""
    about = bundle.about
    data = about["data"]["digest"]
    own = [each for each in runs if (each.identity, each.data_digest) == (about["run"], data)]
    # Sets on which others were trained are tested on held-out rows: on any, of those it never saw.
    like = (own or runs)[0].metrics
    return {
        "name": f"{about['name']} (bundle)",
        "plan": about["data"]["plan"],
        "role": BUNDLE,
        "method": BUNDLE,
        "split": like["split"] if own else "position",
        "test_share": like["test_share"],
        "held_out": bool(own),
        "target": about["label"]["name"],
        "seed": about["seed"],
        "data": data,
        "threshold": bundle.threshold,
        "inputs": list(bundle.inputs),
        "microphones": about["array"],
        "model": {"sha256": about["sha256"]},
    }
