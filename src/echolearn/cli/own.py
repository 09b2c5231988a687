"""A user's own parts: YAML files in a folder of the user's own, and the modules that they name.

    --config-dir=mine, or ECHOLEARN_CONFIG=mine --> Hydra looks there as well, after our own files
                                               --> Python imports modules from there, last of all

So `mine/classifier/nearest.yaml` is `classifier=nearest`, and its `_target_: nearest.Nearest` the
class in `mine/nearest.py`. What stands there is trusted like what is typed.
"""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hydra.core.config_search_path import ConfigSearchPath

VARIABLE = "ECHOLEARN_CONFIG"
"""Environment variable that names the folder; processes of a sweep inherit it."""


def folder() -> Path:
    """Return the folder of the YAML files: the installed package's, or the repository's."""
    installed = Path(__file__).parents[1] / "conf"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "conf"


def use_own(place: str) -> None:
    """Let a folder give options of groups, and modules.

    Raises:
        BadValue: no such folder, or a file that has the name of one of ours.
    """
    from echolearn.checks import check

    path = Path(place).absolute()
    hint = "is it relative to another folder?"
    check(path.is_dir(), "config-dir", place, allowed="must be a folder", hint=hint)
    own = {file.relative_to(path) for file in path.rglob("*.yaml")}
    ours = {file.relative_to(folder()) for file in folder().rglob("*.yaml")}
    shared = ", ".join(sorted(map(str, own & ours)))
    hint = "which of both would be meant? choose other names"
    allowed = "must have other files than echolearn's own"
    check(not shared, "config-dir", f"{place} with {shared}", allowed=allowed, hint=hint)
    os.environ[VARIABLE] = str(path)
    # Last, so that no module there takes the place of one of a library.
    if str(path) not in sys.path:
        sys.path.append(str(path))


def folders() -> list[Path]:
    """Return the folders in which options of groups are sought, ours first."""
    own = os.environ.get(VARIABLE)
    return [folder(), *([Path(own)] if own else [])]


def options_of(group: str) -> list[str]:
    """Return the names of a group's options."""
    return sorted(file.stem for place in folders() for file in (place / group).glob("*.yaml"))


def file_of(name: str) -> Path | None:
    """Return the file of a name such as `classifier/svm_pair`, if there is one."""
    files = [place / f"{name}.yaml" for place in folders()]
    return next(filter(Path.is_file, files), None)


def search_space(classifier: str) -> tuple[Any, str]:
    """Return what a search over a classifier's settings may try, and the file that says so.

    That is `classifier/search/<name>.yaml`, of the classifier or of the one that it begins with.

    Raises:
        BadValue: neither of them has such a file.
    """
    import yaml

    from echolearn.checks import check

    name = classifier
    while (file := file_of(f"classifier/search/{name}")) is None:
        own = file_of(f"classifier/{name}")
        bases = yaml.safe_load(own.read_text()).get("defaults", []) if own else []
        plain = [base for base in bases if isinstance(base, str) and base != "_self_"]
        allowed = f"must have a file classifier/search/{classifier}.yaml, or space= given"
        check(bool(plain), "classifier", classifier, allowed=allowed)
        name = plain[0]
    return yaml.safe_load(file.read_text()), str(file.name)


def teach_hydra() -> None:
    """Let Hydra look in the user's folder wherever it is started in this process."""
    from hydra.core.plugins import Plugins
    from hydra.plugins.search_path_plugin import SearchPathPlugin

    class OwnFolder(SearchPathPlugin):
        """Adds the user's folder to where Hydra looks."""

        def manipulate_search_path(self, search_path: "ConfigSearchPath") -> None:
            """Append the folder, if there is one."""
            for place in folders()[1:]:
                search_path.append("own", f"file://{place}")

    known = Plugins.instance().discover(SearchPathPlugin)
    if not any(plugin.__name__ == OwnFolder.__name__ for plugin in known):
        Plugins.instance().register(OwnFolder)
