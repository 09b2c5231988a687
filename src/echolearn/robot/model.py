"""Models from strangers at work: onnxruntime, on one core, in limited memory and time.

    read_bundle --open--> compute: inputs (B, *shape) -> confidences (B,), golden ones among them

It has an arena of `MEMORY` bytes, and folds no constants while it opens a model, which could make
one of any size. A model that was examined has computed 32 inputs within the limits of that; what it
makes of others may still depend on their values, so each call has a deadline: computing time of its
thread, since a busy machine is no fault of the model's. onnxruntime stops between two operators.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numpy as np

# Before it is imported: onnxruntime would keep files about its use in the home folder.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.robot import untrusted_models
from echolearn.robot.bundle import Bundle, read_bundle
from echolearn.robot.schema import GOLDEN, LIMITS
from echolearn.storage import manifests
from echolearn.storage.files import one_line

Compute = Callable[[Array], Array]

_calls: list[tuple[int, float, onnxruntime.RunOptions]] = []
"""Calls under way: the clock of each one's thread, what it may show at last, options to stop it."""

TOLERANCE = 1e-5
"""Largest difference in confidence between two machines."""

MEMORY = 256 << 20
"""Bytes that a model may use while it computes."""

SECONDS = 1.0
ROW_SECONDS = 0.01
"""Computing time of one call, and more for each of its inputs, in s; a classifier takes less than a
thousandth for each."""

WATCH = 0.05
"""Time between two looks at the calls that are under way, in s."""

MODEL = "model.onnx"


def replay(folder: Path) -> tuple[Bundle, Compute]:
    """Return a bundle and what its model computes, which includes its golden confidences.

    Raises:
        BadValue: as `read_bundle`, or onnxruntime refuses the model, or it answers otherwise.
    """
    bundle = read_bundle(folder)
    name = f"{folder}/{MODEL}"
    compute = opened(bundle.model, name=name, rank=1 + len(bundle.shape))
    x, expected = bundle.golden
    difference = np.abs(compute(x) - expected)
    shown = f"golden confidences differ by {difference.max():.2g}"
    hint = "this machine computes something else than the one that made the bundle"
    same = bool((difference <= TOLERANCE).all())
    check(same, name, shown, allowed=f"must be at most {TOLERANCE:g}", hint=hint)
    return bundle, compute


def try_run(folder: Path) -> str:
    """Let the model of a trained run compute as many inputs as a bundle has; return its digest.

    Raises:
        BadValue: the model is damaged, not allowed, or cannot compute them.
    """
    manifest = manifests.load_manifest(folder, largest=manifests.FOREIGN)
    size = manifest["files"].get(MODEL, {}).get("bytes", 0)
    check(
        size <= LIMITS[MODEL],
        f"{folder}/{MODEL}",
        f"{size} bytes",
        allowed=f"must be at most {LIMITS[MODEL]} bytes",
    )
    name = f"{folder}/{MODEL}"
    data = manifests.listed_bytes(folder, manifest, names=[MODEL]).get(MODEL, b"")
    untrusted_models.check_onnx(data, name=name)
    session = _session(data, name)
    shape = session.get_inputs()[0].shape[1:] if session.get_inputs() else []
    plain = all(isinstance(size, int) and 0 < size <= 1024 for size in shape)
    allowed = "must be 1 or 2 numbers up to 1024"
    check(plain and 0 < len(shape) < 3, f"{name} input", shape, allowed=allowed)
    _computing(session, name=name, rank=1 + len(shape))(_trials(shape))
    return str(manifest["sha256"])


def _trials(shape: list[int]) -> Array:
    """Return inputs, float32, shape (32, *shape): ordinary ones, zeros, and the largest floats."""
    x = np.random.default_rng(0).standard_normal((GOLDEN, *shape))
    x[-3:] = np.finfo(np.float32).max * np.array([0.0, 1.0, -1.0]).reshape(3, *(1 for _ in shape))
    return x.astype(np.float32)


def opened(data: bytes, *, name: str, rank: int) -> Compute:
    """Return the function that an ONNX file from elsewhere computes, within limits.

    Args:
        data: the file, which `check_onnx` allows.
        name: of the file in errors.
        rank: number of axes of its inputs.

    Raises:
        BadValue: onnxruntime refuses it, or it has other inputs or outputs.
    """
    return _computing(_session(data, name), name=name, rank=rank)


def _session(data: bytes, name: str) -> onnxruntime.InferenceSession:
    """Return a model, opened in limited memory."""
    _limit_memory()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # Its complaints come as exceptions, which are told in one line.
    options.log_severity_level = 4
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        return onnxruntime.InferenceSession(
            data,
            options,
            providers=["CPUExecutionProvider"],
            # Folding would compute a giant constant while the model is being opened.
            disabled_optimizers=["ConstantFolding"],
        )
    except Exception as error:  # onnxruntime's own kinds have no common ancestor
        raise BadValue(f"{name}: onnxruntime refuses it ({one_line(error):.200})") from None


def _computing(session: onnxruntime.InferenceSession, *, name: str, rank: int) -> Compute:
    """Return the function that a model computes, which has one input and one output.

    Args:
        session: the model.
        name: of its file in errors.
        rank: number of axes of its inputs.
    """
    ends = [*session.get_inputs(), *session.get_outputs()]
    found = [(end.name, end.type, len(end.shape)) for end in ends]
    wanted = [("x", "tensor(float)", rank), ("confidence", "tensor(double)", 1)]
    check(found == wanted, f"{name} inputs and outputs", found, allowed=f"must be {wanted}")

    def compute(x: Array) -> Array:
        """Return the confidences (B,) of float32 inputs (B, ...)."""
        seconds = SECONDS + ROW_SECONDS * len(x)
        with _deadline(seconds) as options:
            try:
                confidence = np.asarray(session.run(["confidence"], {"x": x}, options)[0])
            except Exception as error:
                reason = one_line(error)
                if options.terminate:
                    reason = f"{len(x)} inputs take more than {seconds:g} s of computing time"
                raise BadValue(f"{name}: cannot be computed ({reason:.200})") from None
        inside = bool(((confidence >= 0) & (confidence <= 1)).all())
        shown = f"shape {confidence.shape}, from 0 to 1: {inside}"
        allowed = f"must be {len(x)} numbers from 0 to 1"
        check(
            inside and confidence.shape == (len(x),), f"{name} confidence", shown, allowed=allowed
        )
        return confidence

    return compute


@contextmanager
def _deadline(seconds: float) -> Iterator[onnxruntime.RunOptions]:
    """Stop onnxruntime when this thread has computed for some seconds.

    Yields:
        Options for `run`; their `terminate` tells whether it was stopped.
    """
    options = onnxruntime.RunOptions()
    clock = _clock()
    call = (clock, time.clock_gettime(clock) + seconds, options)
    _calls.append(call)
    _watcher(os.getpid()).set()
    try:
        yield options
    finally:
        _calls.remove(call)


def _clock() -> int:
    """Return the clock of this thread's computing time; where there is none, the process's."""
    if hasattr(time, "pthread_getcpuclockid"):
        return time.pthread_getcpuclockid(threading.get_ident())
    return time.CLOCK_PROCESS_CPUTIME_ID  # macOS


@cache
def _watcher(process: int) -> threading.Event:
    """Return what wakes the one thread that looks after all calls of a process.

    A thread for each call would take longer than the call. A forked process has no threads but
    the one that forked it, so it gets another.
    """
    awake = threading.Event()
    threading.Thread(target=_watch, args=(awake,), daemon=True).start()
    return awake


def _watch(awake: threading.Event) -> None:
    """Stop each call whose time is spent, as long as the process lives."""
    while awake.wait():
        time.sleep(WATCH)
        awake.clear()
        for clock, until, options in tuple(_calls):
            # Once a call has ended, its thread may have, and its clock with it.
            with suppress(OSError):
                options.terminate = time.clock_gettime(clock) > until
            awake.set()


@cache
def _limit_memory() -> None:
    """Let all sessions of this process that ask for it share one arena of `MEMORY` bytes."""
    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    place = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, onnxruntime.OrtMemType.DEFAULT)
    arena = onnxruntime.OrtArenaCfg({"max_mem": MEMORY, "arena_extend_strategy": 1})
    with suppress(Exception):  # there is one already: the host program's
        onnxruntime.create_and_register_allocator(place, arena)
