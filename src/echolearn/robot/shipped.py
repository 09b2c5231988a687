"""Bundles by name: those made here, then those that come with echolearn.

    bundle=point --> runs/bundles/point, else echolearn/bundles/point

Whatever is a folder with a `bundle.json`, or has a `/` in it, is a path. Bundles that come along
are as trusted as the code beside which they lie: they need no examination (`examination`).
docs/cards has what each is worth.
"""

import json
from functools import cache
from pathlib import Path

from echolearn.checks import check, suggest
from echolearn.storage.kinds import elsewhere
from echolearn.storage.manifests import BUNDLE

FOLDER = Path(__file__).parents[1] / "bundles"
"""Where they lie."""

ALLOWED = "must be a folder that echolearn export wrote, or the name of a bundle"


def find_bundle(
    given: str | Path, runs: Path, *, key: str = "bundle", allowed: str = ALLOWED
) -> Path:
    """Return the folder of a bundle that a path or a name stands for.

    Args:
        given: path of a folder, or a name.
        runs: folder of everything generated.
        key: what names it on the command line.
        allowed: what may be named, for the message.

    Raises:
        BadValue: a name that no bundle has.
    """
    path = Path(given)
    if "/" in str(given) or (path / BUNDLE).is_file():
        return path
    places = [Path(runs) / "bundles" / path, FOLDER / path]
    found = [place for place in places if (place / BUNDLE).is_file()]
    made = {place.parent.name for place in (Path(runs) / "bundles").glob(f"*/{BUNDLE}")}
    # A folder that is no bundle is refused by whoever reads it, who knows why.
    if not found and not path.exists():
        hint = elsewhere(str(given), wanted="bundle", runs=runs)
        hint = hint or suggest(str(given), sorted(made | {*digests()}))
        check(False, key, given, allowed=allowed, hint=hint)
    return next(iter(found), path)


@cache
def digests() -> dict[str, str]:
    """Return the digests of the bundles that come along, by name."""
    found = sorted(FOLDER.glob(f"*/{BUNDLE}"))
    return {path.parent.name: str(json.loads(path.read_bytes())["sha256"]) for path in found}
