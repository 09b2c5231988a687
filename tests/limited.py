"""A process of limited memory that does what strangers' files ask for, one job after another.

Whatever is not refused in one line ends the process, and with it the test. It reads jobs as lines
of JSON, and answers each with what was said, its seconds of computing, and the most memory that it
has had.
"""

import contextlib
import json
import os
import resource
import select
import subprocess
import sys
from io import StringIO
from pathlib import Path
from typing import Any

MEMORY = 8 << 30
"""Bytes of addresses that the process may ask for."""

PATIENCE = 600.0
"""Seconds after which a job hangs."""


def replay(folder: str) -> None:
    """Load a bundle as the process that examines it does, but here."""
    from echolearn.robot.model import replay

    replay(Path(folder))


def map_survey(survey: str, bundle: str, runs: str) -> None:
    """Map a survey."""
    from echolearn.robot import survey_map

    survey_map.map_survey(survey=Path(survey), bundle=Path(bundle), runs=Path(runs))


def verify(folder: str) -> None:
    """Verify a folder by the command."""
    from echolearn.checks import BadValue
    from echolearn.cli.main import main

    lines = StringIO()
    with contextlib.redirect_stderr(lines):
        failed = main(["verify", folder])
    if failed:
        assert lines.getvalue().count("\n") == 1 and lines.getvalue().startswith("error: ")
        raise BadValue(lines.getvalue().strip())


class Limited:
    """The process, seen from a test."""

    def __init__(self) -> None:
        command = [sys.executable, __file__]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ
        )
        self.memory = 0

    def __call__(self, job: str, **arguments: object) -> str:
        """Return what is said against a job; an empty text if nothing is."""
        assert self.process.stdin and self.process.stdout
        named = {key: str(value) for key, value in arguments.items()}
        self.process.stdin.write(json.dumps({"job": job, "arguments": named}) + "\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        if not ready:
            self.process.kill()
        found: dict[str, Any] = json.loads(self.process.stdout.readline())
        assert found["seconds"] < 20.0
        self.memory = found["memory"]
        said = str(found["said"])
        assert said.isprintable() and len(said) < 1000
        return said


def main() -> None:
    """Do jobs until there are none."""
    from echolearn.bench.memory import peak_memory
    from echolearn.checks import BadValue
    from echolearn.runtime.timing import cpu_seconds

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    answers, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        given = json.loads(line)
        began, said = cpu_seconds(), ""
        try:
            globals()[given["job"]](**given["arguments"])
        except BadValue as error:
            said = str(error)
        seconds = cpu_seconds() - began
        answer = {"said": said, "seconds": seconds, "memory": peak_memory()}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
