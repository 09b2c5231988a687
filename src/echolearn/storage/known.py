"""What was made or examined here: digests of manifests, in a list beside the user's other state.

    $XDG_STATE_HOME/echolearn/known     <SHA-256> made
                                        <SHA-256> examined

`~/.local/state` stands for a variable that is not set. Whatever a folder says of itself, a stranger
may have written; this list is outside of it. What was made here may be advised to be made again by
its command, and a bundle that is on the list needs no examination. A list that cannot be read or
written remembers nothing, which costs time and advice but no work.
"""

import os
from contextlib import suppress
from pathlib import Path

MADE = "made"
EXAMINED = "examined"


def remember(digest: str, how: str) -> None:
    """Add a manifest's SHA-256 to the list, as `MADE` or `EXAMINED`."""
    if is_known(digest, how):
        return
    with suppress(OSError, RuntimeError):
        path = _place()
        path.parent.mkdir(parents=True, exist_ok=True)
        # One write at the end of the file: lines of two processes do not mix.
        with path.open("ab", buffering=0) as file:
            file.write(f"{digest} {how}\n".encode())


def is_known(digest: str, *ways: str) -> bool:
    """Tell whether a manifest's SHA-256 is on the list in one of these ways."""
    try:
        lines = _place().read_bytes().splitlines()
    except (OSError, RuntimeError):  # the latter where there is no home
        return False
    return any(f"{digest} {how}".encode() in lines for how in ways)


def _place() -> Path:
    """Return where the list is; the standard wants a relative variable to be ignored."""
    given = os.environ.get("XDG_STATE_HOME", "")
    state = Path(given) if os.path.isabs(given) else Path.home() / ".local" / "state"
    return state / "echolearn" / "known"
