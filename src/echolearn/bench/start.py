"""How long a command takes to answer at all, beside Python's own start."""

import subprocess
import sys
from collections.abc import Iterator
from functools import partial

from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.runtime.timing import Contestant

HELP, BARE = "echolearn --help", "python -c pass"


def start(setting: Setting) -> Iterator[Measurement]:
    """Time `echolearn --help` and an empty Python program, as processes."""
    lines = {HELP: ("-m", "echolearn", "--help"), BARE: ("-c", "pass")}
    work = partial(subprocess.run, check=True, stdout=subprocess.DEVNULL)
    laps = setting.race(
        {name: Contestant(partial(work, [sys.executable, *words])) for name, words in lines.items()}
    )
    yield from times("start", laps, reference=HELP)
