"""What lies under `runs`, by its name or by its folder: the same for every command and key.

given --a folder of this kind, or a path with a slash?--> it
      --runs/<place>/<given>, or the only <given>-... there?--> that

A name without its digest, or the beginning of a run's name, is enough where no other begins so.
"""

from glob import escape
from pathlib import Path

from echolearn.checks import check
from echolearn.storage.kinds import KINDS, folder_kind

MARKS = {kind.place: kind.mark for kind in KINDS.values()}
"""File by which a finished folder is known, for each place under `runs`."""


def folder_named(given: str | Path, place: str, *, runs: Path, key: str = "folder") -> Path:
    """Return the folder that a name or a path stands for; where there is none, the path itself.

    Args:
        given: name or path.
        place: folder under `runs` where such folders lie.
        runs: folder of everything generated.
        key: what names it on the command line.

    Raises:
        BadValue: the beginning of several names.
    """
    whole = folder_called(given, place, runs=runs)
    if whole is not None:
        return whole
    begun = (Path(runs) / place).glob(f"{escape(str(given))}-*/{MARKS[place]}")
    found = sorted(each.parent for each in begun) if str(given) else []
    shown = ", ".join(each.name for each in found)
    allowed = "must be the beginning of one name"
    check(len(found) <= 1, key, given, allowed=allowed, hint=f"there are {shown}")
    return found[0] if found else Path(given)


def folder_called(given: str | Path, place: str, *, runs: Path) -> Path | None:
    """Return the folder that a path or a whole name stands for, if it is one.

    Args:
        given, place, runs: as those of `folder_named`.
    """
    path = Path(given)
    # Of a folder that is here, what it is shows in it: another of that name may lie under `runs`.
    if "/" in str(given) or ((path / MARKS[place]).is_file() and _may_lie(path, place)):
        return path
    exact = Path(runs) / place / path
    return exact if str(given) and exact.is_dir() else None


def _may_lie(folder: Path, place: str) -> bool:
    """Tell whether a folder may be one of a place under `runs`: it does not say anything else."""
    found = folder_kind(folder)
    return not found or KINDS[found].place == place


def all_named(given: str, *, runs: Path) -> list[str]:
    """Return the folders under `runs` that have a name; of a path, or where there is none, itself.

    Args:
        given: name or path.
        runs: folder of everything generated.
    """
    if not given or "/" in given or Path(given).exists():
        return [given]
    return sorted(map(str, Path(runs).glob(f"*/{escape(given)}/"))) or [given]
