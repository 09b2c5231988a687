"""A bundle or run from elsewhere is tried by a process of its own first, which may be lost.

    digest on the list `storage.known`, or shipped? --no--> child (`trial`): answers? --yes--> list

Parsing a stranger's model and computing it is the work of libraries that trust their input. The
child may use `SECONDS` of computing time and `MEMORY` bytes more than it has when it begins, and
may write no file. Computing time, since a busy machine is no fault of the bundle's. What the child
refuses is refused here, and so is a bundle that ends it. The list is kept per user, so that this is
paid once for each bundle. What is on it is loaded by the process that wants it, where each call of
its model has a deadline (`model`), but no whole walk has one: how long that takes, only its user
knows.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from echolearn.checks import BadValue, check, printable
from echolearn.robot.bundle import read_content
from echolearn.robot.shipped import digests
from echolearn.storage import known

TRIAL = "echolearn.robot.trial"
"""Program of the child."""

SECONDS = 2
"""Computing time for a bundle, in s; a classifier takes milliseconds."""

MEMORY = 768 << 20
"""Bytes of addresses that reading and computing may take; the model itself has at most 64 MiB."""


def examined(folder: Path) -> str:
    """Let a child try a bundle that was neither made nor examined here; return its digest.

    Raises:
        BadValue: the child refuses it, or is lost over it.
    """
    digest = str(read_content(folder)["sha256"])
    _examine("bundle", folder, digest=digest)
    return digest


def examine_run(folder: Path, digest: str) -> None:
    """Let a child try the model of a trained run that was neither made nor examined here.

    Args:
        folder: of the run.
        digest: SHA-256 of its manifest.

    Raises:
        BadValue: the child refuses it, or is lost over it.
    """
    _examine("run", folder, digest=digest)


def _examine(kind: str, folder: Path, *, digest: str) -> None:
    if known.is_known(digest, known.MADE, known.EXAMINED) or digest in digests().values():
        return
    began = time.perf_counter()
    _try(kind, folder, digest=digest)
    known.remember(digest, known.EXAMINED)
    spent = f"{time.perf_counter() - began:.1f} s"
    said = f"{kind} {folder.name}: from elsewhere; examined in {spent}, once for all loads"
    print(printable(said), file=sys.stderr, flush=True)


def _try(kind: str, folder: Path, *, digest: str) -> None:
    """Raise `BadValue` unless a child can load the bundle or run of this digest."""
    # The child finds echolearn where this process has found it.
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    child = subprocess.run(
        [sys.executable, "-m", TRIAL, str(folder.absolute())],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
    )
    try:
        found = json.loads(child.stdout)
        refusal = str(found["refusal"]).replace(str(folder.absolute()), str(folder), 1)
    except (ValueError, KeyError, TypeError):
        raise BadValue(f"{folder}: {_end(child)}") from None
    if refusal:
        raise BadValue(refusal)
    allowed = "must stay as it is while it is examined"
    check(found["digest"] == digest, kind, folder, allowed=allowed, hint="load it again")


def _end(child: subprocess.CompletedProcess[bytes]) -> str:
    """Return what became of a child that has not answered."""
    if child.returncode == -signal.SIGXCPU:
        return f"cannot be computed in {SECONDS} s; a classifier takes milliseconds"
    how = f"status {child.returncode}"
    if child.returncode < 0:
        how = signal.Signals(-child.returncode).name
    last = child.stderr[-300:].decode("utf-8", "replace").strip().rpartition("\n")[2]
    return f"cannot be computed: the process that examined it ended by {how}; {last}"
