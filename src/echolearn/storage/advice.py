"""Commands that messages advise: as they were typed, and still right in another folder.

    key, value --assignment--> key=value, or key='value' as Hydra's grammar wants it
    command, folder that it made --anywhere--> the same command for whoever stands somewhere else

What a command has made names the command in its manifest, with paths as they were typed. From
another folder these lead elsewhere, so they are told in full then. A folder that lies where no
command would have put it has been moved: nothing is known of the paths around it.
"""

import os
import re
import shlex
from collections.abc import Mapping
from glob import escape
from importlib import import_module
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue
from echolearn.storage import known

MEND = "make it again as it was made"
"""What to do about a damaged file whose manifest names no `command`."""

PLACES = {
    "generate": "data",
    "train": "train",
    "tune": "tune",
    "survey": "survey",
    "import": "survey",
    "compare": "compare",
    "study": "study",
    "export": "bundles",
    "check": "check",
    "map": "maps",
    "live": "maps",
    "fit": "fit",
    "label": "data",
    "bench": "bench",
}
"""Folders under `runs` in which commands make theirs; `bench` writes there itself."""

PATHS = ("survey", "bundle", "run", "best", "readme", "page", "folder", "diffuse.source.path")
"""Keys of files and folders besides `runs`."""


def assignment(key: str, value: str) -> str:
    """Return a word of the command line that sets a key to a text, whatever is in it."""
    if re.fullmatch(r"[A-Za-z0-9_./-]+", value) and value.lower() != "null":
        return f"{key}={value}"
    # Backslashes count only before a quote, the one at the end included, and before ${.
    escaped = re.sub(r"(\\*)('|\Z)", lambda found: 2 * found[1] + found[2], value)
    escaped = escaped.replace("'", "\\'").replace("${", "\\${")
    return f"{key}='{escaped}'"


def text_of(value: str) -> str:
    """Return the text that a value of a word stands for: without quotes, if it has any."""
    if len(value) < 2 or value[0] != value[-1] or value[0] not in "'\"":
        return value
    mark = value[0]
    inner = value[1:-1].replace("\\${", "${")
    return re.sub(
        rf"(\\+)({mark}|\Z)", lambda found: found[1][: len(found[1]) // 2] + found[2], inner
    )


def shell(word: str) -> str:
    """Return a word quoted for a shell, by double quotes where they will do."""
    return shlex.quote(word) if {*word} & {*'"$`\\!'} else f'"{word}"'


def is_command(text: object) -> bool:
    """Tell whether a text is one command line of echolearn and nothing else, quoted for a shell."""
    if not isinstance(text, str) or not text.startswith("echolearn ") or not text.isprintable():
        return False
    try:
        return shlex.join(shlex.split(text)) == text
    except ValueError:
        return False


def own_command(manifest: Mapping[str, Any]) -> str:
    """Return the command in a manifest that was made here, or nothing.

    That of a stranger, which could do whatever a command line can, is never repeated.
    """
    command = manifest.get("command")
    own = known.is_known(str(manifest.get("sha256")), known.MADE)
    return str(command) if own and is_command(command) else ""


def data_frame() -> Any:
    """Return `pandas.DataFrame`; no library of echolearn's needs pandas, so it may not be here.

    Raises:
        BadValue: it is not.
    """
    try:
        return import_module("pandas").DataFrame
    except ModuleNotFoundError:
        raise BadValue("to_pandas: needs pandas; pip install pandas") from None


def repair_hint(manifest: Mapping[str, Any], folder: Path) -> str:
    """Return how to mend what is in a folder: by its manifest's command, if it was made here."""
    command = own_command(manifest)
    return f"run again: {anywhere(command, folder)}" if command else MEND


def command_line(name: str, *words: str, runs: Path) -> str:
    """Return a command line for a shell; `runs` is named unless it is the usual one.

    Args:
        name: of the command.
        words: that follow it.
        runs: folder of everything generated.
    """
    last = [] if Path(runs) == Path("runs") else [assignment("runs", str(runs))]
    return shlex.join(["echolearn", name, *words, *last])


def anywhere(command: str, folder: Path) -> str:
    """Return a command that makes a folder where it is, from where we are.

    Args:
        command: what has made it, in whatever folder that was typed.
        folder: what it has made.
    """
    program, name, *words = shlex.split(command)
    place = Path(os.path.abspath(folder))
    kind = place if name == "bench" else place.parent
    if kind.name != PLACES.get(name):
        return command
    runs = kind.parent
    typed = {word.partition("=")[0]: text_of(word.partition("=")[2]) for word in words}
    base = _typed_in(runs, typed.get("runs", "runs"))
    if base == Path.cwd():
        return command

    told = [word for word in words if not word.startswith("runs=")]
    for index, word in enumerate(told):
        key = word.partition("=")[0]
        if base and key in PATHS and typed[key] not in ("", "null"):
            path = os.path.normpath(base / typed[key])
            # A name leads to the same from everywhere.
            named = "/" not in typed[key] and any(runs.glob(f"*/{escape(typed[key])}"))
            if not named or os.path.exists(path):
                told[index] = assignment(key, path)
    return shlex.join([program, name, *told, assignment("runs", str(runs))])


def _typed_in(runs: Path, typed: str) -> Path | None:
    """Return the folder in which `runs` was called as it was typed; None if that is not known."""
    ending = Path(os.path.normpath(typed)).parts
    if not ending or ".." in ending or runs.parts[-len(ending) :] != ending:
        return None
    if Path(typed).is_absolute():
        return None
    return Path(*runs.parts[: -len(ending)])
