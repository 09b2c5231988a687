"""How long a command takes to answer at all, beside Python's own start."""

import subprocess
import sys
from collections.abc import Iterator
from functools import partial

from echolearn.bench.measurement import Measurement, Setting
from echolearn.runtime.timing import Contestant

BARE = "python -c pass"


def start(setting: Setting) -> Iterator[Measurement]:
    """Time `echolearn --help` and an empty Python program, as processes."""
    programs = {
        "echolearn --help": program("-m", "echolearn", "--help"),
        BARE: program("-c", "pass"),
    }
    yield from setting.compare("start", programs)


def program(*words: str) -> Contestant:
    """Return a Python program as a process of its own."""
    line = [sys.executable, *words]
    work = partial(subprocess.run, line, check=True, stdout=subprocess.DEVNULL)
    return Contestant(work, warm=False)
