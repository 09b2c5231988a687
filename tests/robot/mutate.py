"""Tries every mutation in one process, `python tests/mutate.py <bundle> <survey> <place>`, and
tells what came of it.

Prints JSON: for each mutation what the library said, what `echolearn verify` said, and its seconds;
    and the most memory
that this process has had.
"""

import contextlib
import io
import json
import resource
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

from bundle_mutants import BUNDLES, Mutate
from echolearn.bench.memory import peak_memory
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.robot import scorer
from echolearn.robot.survey_map import map_survey
from survey_mutants import SURVEYS

Outcome = dict[str, object]


def attempt(mutate: Mutate, source: Path, place: Path, work: Callable[[Path], object]) -> Outcome:
    """Mutate a copy, and return what `work` and `verify` say of it, and how long both took."""
    shutil.rmtree(place, ignore_errors=True)
    folder = shutil.copytree(source, place / "given")
    mutate(folder)
    began, said = time.perf_counter(), ""
    try:
        work(folder)
    except BadValue as error:
        said = str(error)
    taken = time.perf_counter() - began
    began, lines = time.perf_counter(), io.StringIO()
    with contextlib.redirect_stderr(lines), contextlib.redirect_stdout(io.StringIO()):
        status = main(["verify", str(folder)])
    verifying = time.perf_counter() - began
    left = sorted(path.name for path in (place / "out").rglob("*"))
    return {
        "said": said, "verify": lines.getvalue(), "status": status, "seconds": max(taken, verifying), "left": left
    }  # fmt: skip


def everything(packed: Path, walk: Path, place: Path) -> dict[str, Outcome]:
    """Return the outcomes of all mutations, by kind and name."""
    found = {}
    for name, (mutate, _) in BUNDLES.items():
        found[f"bundle: {name}"] = attempt(mutate, packed, place / "bundle", scorer.load)
    for name, (mutate, _) in SURVEYS.items():
        out = place / "survey" / "out"
        found[f"survey: {name}"] = attempt(
            mutate, walk, place / "survey", lambda folder, out=out: map_survey(survey=folder, bundle=packed, runs=out)  # type: ignore[misc]
        )  # fmt: skip
    return found


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    outcomes = everything(*map(Path, sys.argv[1:]))
    print(json.dumps({"outcomes": outcomes, "memory": peak_memory()}))
