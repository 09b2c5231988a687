"""How much memory a process has had at most; loads nothing, so it may run beside anything."""

import sys
from pathlib import Path
from resource import RUSAGE_SELF, getrusage


def peak_memory() -> int:
    """Return the high-water mark of this process's resident set, in bytes."""
    status = Path("/proc/self/status")
    if status.is_file():  # getrusage remembers the process that started this one
        [line] = [line for line in status.read_text().splitlines() if line.startswith("VmHWM")]
        return int(line.split()[1]) << 10
    return getrusage(RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
