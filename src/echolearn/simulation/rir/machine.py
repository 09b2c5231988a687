"""Machine code of the loops of `images`, compiled once and kept.

    loops.py --Numba--> LLVM's language --LLVM--> machine code --file--> every process after

Numba takes a third of a second to import and set up, half of what a process needs until its first
row; the code that it makes is a few kilobytes. So that is kept, as a file which LLVM alone loads in
milliseconds: beside the package's own byte code, or where that cannot be written in the user's
cache; where neither can, each process compiles anew. The file's name says what it depends on: the
sources, LLVM and the processor. A damaged one is made again.
"""

import ctypes
import os
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding as llvm

from echolearn.checks import BadValue
from echolearn.storage import files

TAPS = 8  # width of psi, in samples of the grid
STEP_BITS = 7
STEPS = 1 << STEP_BITS  # rows in the table of psi, for one sample of the grid

FLOATS, DOUBLES, WHOLES = (
    np.ctypeslib.ndpointer(kind, flags="C_CONTIGUOUS")
    for kind in (np.float32, np.float64, np.int32)
)
WHOLE, NUMBER, CHECKSUM = ctypes.c_int64, ctypes.c_double, 32
AXES = (DOUBLES, WHOLE) * 3
ARGUMENTS = (
    FLOATS,
    WHOLE,
    WHOLE,
    FLOATS,
    FLOATS,
    WHOLE,
    WHOLE,
    NUMBER,
    *AXES,
    FLOATS,
    FLOATS,
    WHOLES,
)
"""Of `loops.respond`; an array of another kind, or with gaps, is refused before it is touched."""


@lru_cache
def respond() -> Callable[..., None]:
    """Return `loops.respond`, from the first place that keeps it, or else newly compiled and kept
    there.

    It checks the kinds of its arguments, not their sizes, and lets other threads run.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    name = f"loops-{identity()}.o"
    code = next((code for place in places() if (code := kept(place / name))), None)
    if code is None:
        code = compiled()
        keep(code, name)
    return linked(code)


def identity() -> str:
    """Return what names the machine code: a digest of all that it depends on."""
    here, cpu = Path(__file__), (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    sources = b"".join(path.read_bytes() for path in (here, here.with_name("loops.py")))
    return sha256(
        repr((sources, llvm.llvm_version_info, llvm.get_process_triple(), cpu)).encode()
    ).hexdigest()[:16]


def places() -> list[Path]:
    """Return the folders where the code may be kept, the best one first; a user without a home has
    but one.
    """
    found = [Path(__file__).parent / "__pycache__"]
    with suppress(RuntimeError):  # as `expanduser` says that there is no home
        found.append(
            Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "echolearn"
        )
    return found


def kept(path: Path) -> bytes | None:
    """Return the code in a file that begins with its checksum; None if there is none, or it is
    damaged.
    """
    with suppress(OSError):
        content = path.read_bytes()
        if sha256(content[CHECKSUM:]).digest() == content[:CHECKSUM]:
            return content[CHECKSUM:]
    return None


def keep(code: bytes, name: str) -> None:
    """Write the code, its checksum before it, to the first place that can be written, if any."""
    for place in places():
        with suppress(BadValue):
            files.write_atomic(place / name, sha256(code).digest() + code)
            break


def compiled() -> bytes:
    """Return the machine code of `loops.respond` for this processor, as an object file."""
    from echolearn.simulation.rir import loops

    symbol, text = loops.translated()
    module = llvm.parse_assembly(text)
    module.get_function(symbol).name = "respond"
    needed = {
        f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")
    }
    assert needed <= {"sqrt"}, (
        f"loops: need {needed} of Numba, which is not there when they are loaded"
    )
    return bytes(machine().emit_object(module))


def machine() -> llvm.TargetMachine:
    """Return this processor, as Numba describes it to LLVM."""
    about = {
        "cpu": llvm.get_host_cpu_name(),
        "features": llvm.get_host_cpu_features().flatten(),
        "opt": 3,
    }
    return llvm.Target.from_default_triple().create_target_machine(
        **about, codemodel="jitdefault", jit=True
    )


def linked(code: bytes) -> Callable[..., None]:
    """Return the function in an object file; it keeps alive what owns the code."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    kind = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *ARGUMENTS)
    call, returned = kind(engine.get_function_address("respond")), ctypes.create_string_buffer(16)
    nowhere = ctypes.addressof(
        returned
    )  # Numba's functions are given where to put a result and an error

    def respond(*arguments: Any, _alive: Any = (engine, returned)) -> None:
        call(nowhere, nowhere + 8, *arguments)

    return respond
