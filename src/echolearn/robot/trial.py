"""The process that may be lost over a bundle or run from elsewhere (`examination`).

limits, then `model.replay`, of a run `model.try_run` --> its digest, or why it is refused
"""

import json
import math
import resource
import sys
from pathlib import Path

from echolearn.checks import BadValue
from echolearn.robot.examination import MEMORY, SECONDS
from echolearn.robot.model import replay, try_run
from echolearn.storage import manifests


def limit() -> None:
    """Limit what this process may use from now on."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    until = math.ceil(usage.ru_utime + usage.ru_stime) + SECONDS
    # A second more, lest the signal be one that says nothing.
    resource.setrlimit(resource.RLIMIT_CPU, (until, until + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    pages = Path("/proc/self/statm")
    # Where the system does not tell what a process has, it does not limit addresses either.
    if pages.is_file():
        most = int(pages.read_text().split()[0]) * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def answer() -> None:
    """Load the bundle or run of the first argument under limits, and print what came of it."""
    folder = Path(sys.argv[1])
    is_bundle = (folder / manifests.BUNDLE).is_file()
    found = {"digest": "", "refusal": ""}
    limit()
    try:
        found["digest"] = str(replay(folder)[0].about["sha256"]) if is_bundle else try_run(folder)
    except BadValue as error:
        found["refusal"] = str(error)
    except MemoryError:
        found["refusal"] = f"{folder}: needs more than {MEMORY >> 20} MiB of memory"
    print(json.dumps(found))


if __name__ == "__main__":
    answer()
