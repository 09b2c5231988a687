"""Words that the tab key completes: commands, options, groups, their options, keys.

the shell --COMP_LINE--> echolearn -sc query=<shell> --Hydra--> words that may stand there
"""

import os
from collections.abc import Sequence
from glob import escape, glob
from pathlib import Path

from echolearn.cli.config import UsageError
from echolearn.cli.words import TEXTS

BASH = """_echolearn() {
    local IFS=$'\\n'
    COMPREPLY=($(COMP_LINE="${COMP_LINE:0:COMP_POINT}" echolearn -sc query=bash 2>/dev/null))
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -o default -F _echolearn echolearn"""

ZSH = """autoload -Uz compinit && compinit -u
_echolearn() {
    local -a found
    found=("${(@f)$(COMP_LINE="${(j: :)words[1,CURRENT]}" echolearn -sc query=zsh 2>/dev/null)}")
    compadd -S '' -- $found
}
compdef _echolearn echolearn"""

FISH = """function _echolearn
    set -lx COMP_LINE (commandline -cp)
    echolearn -sc query=fish 2>/dev/null
end
complete -c echolearn -f -a '(_echolearn)'"""

SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}
"""What each shell has to evaluate once."""


def complete(words: Sequence[str], *, commands: Sequence[str], options: Sequence[str]) -> str:
    """Return what `echolearn -sc install=<shell>` or `query=<shell>` prints.

    Args:
        words: what follows -sc.
        commands: names of those that have a configuration.
        options: of the command line.

    Raises:
        UsageError: no shell that is known.
    """
    wish, _, shell = (words[0] if len(words) == 1 else "").partition("=")
    if wish not in ("install", "query") or shell not in SCRIPTS:
        raise UsageError("-sc: must be followed by install=bash, install=zsh or install=fish")
    if wish == "install":
        return SCRIPTS[shell]
    return "\n".join(endings(os.environ.get("COMP_LINE", ""), commands=commands, options=options))


def endings(line: str, *, commands: Sequence[str], options: Sequence[str]) -> list[str]:
    """Return the words that may stand at the end of a line, sorted.

    Args:
        line: what has been typed up to the cursor.
        commands: names of those that have a configuration.
        options: of the command line.
    """
    *before, word = line.split(" ")
    before = [each for each in before if each][1:]
    if not before:
        known = [*commands, "verify", "--help", "--version"]
    elif word.startswith("-"):
        known = list(options)
    elif before[0] == "verify":
        known = _paths(word)
    elif before[0] in commands and word.partition("=")[0] in TEXTS:
        key, _, path = word.partition("=")
        known = [f"{key}={found}" for found in [*_paths(path), *_names(key)]]
    elif before[0] in commands:
        known = _by_hydra(before[0], [each for each in before[1:] if "=" in each], word=word)
        # Files beside the commands' are no words of ours.
        known = [
            each for each in known if not each.startswith(tuple(f"{name}/" for name in commands))
        ]
    else:
        known = []
    return sorted(each for each in known if each.startswith(word))


def _by_hydra(command: str, words: Sequence[str], *, word: str) -> list[str]:
    """Return what Hydra knows to go on with.

    Args:
        command: names the primary configuration.
        words: overrides before the cursor.
        word: its beginning.
    """
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.plugins.completion_plugin import DefaultCompletionPlugin

    from echolearn.cli.own import folders, options_of, teach_hydra

    teach_hydra()
    with initialize_config_dir(version_base="1.3", config_dir=str(folders()[0])):
        loader = GlobalHydra.instance().config_loader()
        found = DefaultCompletionPlugin(loader)._query(command, " ".join([*words, word]))
    ours = [each for each in found if not each.startswith("hydra")]
    return [f"{each}=" if options_of(each) else each for each in ours]


def _names(key: str) -> list[str]:
    """Return the names under `runs` that a key takes."""
    place = {"survey": "survey", "bundle": "bundles", "run": "train", "best": "compare"}.get(key)
    return [path.name for path in Path("runs").glob(f"{place}/*/") if place]


def _paths(beginning: str) -> list[str]:
    """Return files and folders whose path begins so; a folder's ends with a slash."""
    return [f"{path}/" if Path(path).is_dir() else path for path in glob(f"{escape(beginning)}*")]
