"""Output that nobody takes is lost, and nothing else: a closed or full stderr stops no work."""

import io
import os
import sys
from contextlib import suppress
from typing import Any


class Lossy(io.FileIO):
    """A file to which writing always succeeds."""

    def write(self, data: Any, /) -> int:
        """Write what can be written, and say that all was."""
        with suppress(OSError):
            super().write(data)
        return len(data)


def secure_streams() -> None:
    """Open stdout and stderr where they are closed, and let stderr lose what cannot be written."""
    for name in ("stdout", "stderr"):
        # Else the next file that is opened would get the number, and with it what is said.
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    # A test or a notebook that has put something in its place keeps it.
    given: Any = sys.stderr
    own = given is sys.__stderr__
    if own:
        raw: Any = Lossy(given.fileno(), "w", closefd=False)
        sys.stderr = io.TextIOWrapper(
            raw, encoding=given.encoding, errors="backslashreplace", write_through=True
        )
