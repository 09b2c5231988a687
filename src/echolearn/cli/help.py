"""What `--help` says: of everything, or of one command, with the keys of what was chosen for it.

conf/<command>.yaml and the files of its groups --> text; a file's comments explain its keys
"""

from collections.abc import Mapping, Sequence

from echolearn.cli.own import file_of, folders, options_of

HELP = """usage: echolearn <command> [key=value ...] [options]

{summary}

commands:
{commands}

options:
  --help       of a command: its groups and keys, and those of what is chosen
  --version    show the version
  --cfg        show the whole configuration instead of running it; with --resolve without ${{...}},
               with --package=classifier that part; --cfg=hydra or all: Hydra's own, too
  --info       show how Hydra puts it together: defaults, defaults-tree, config, searchpath, plugins
  -m           run once for every combination: seed=0,1,2 classifier=svm_pair,trees_features;
               also --multirun
  --           with -m: another sweep follows; what stands before the first -- holds for all
  -j N         with -m: do N jobs at a time, each in a process of its own; or let a launcher of
               Hydra do them: hydra/launcher=joblib, set by hydra.launcher.<key>=<value>
  --config-dir=<folder>   look there as well, for options of groups and for modules that they name;
               also by the variable ECHOLEARN_CONFIG
  --config-name=<name>    of the command's own file, if it is not <command>.yaml
  --traceback  show where in the code an error arose
  -sc          complete words with the tab key: eval "$(echolearn -sc install=bash)", or zsh, fish

Values are written in Hydra's override grammar: key=[1,2] is one list; with -m the values of
'classifier=glob(svm_*)', 'seed=range(3)' and seed=0,1 are swept over; 'tune' searches
'classifier.lr=interval(1e-4,1e-2)'. What lies under runs is named by its name or its folder.
"""

EXPLAINED = ("plan", "localizer", "classifier")
"""Groups whose chosen file is shown even where nothing was typed about them."""


def overview(commands: Mapping[str, str]) -> str:
    """Return the text of `echolearn --help`, of commands and what each does."""
    import echolearn

    lines = [f"  {name:10}{does}" for name, does in commands.items()]
    summary = (echolearn.__doc__ or "").split("\n")[0]
    return HELP.format(summary=summary, commands="\n".join(lines)).rstrip()


def explain(command: str, does: str, *, words: Sequence[str] = ()) -> str:
    """Return the text of `echolearn <command> --help`: what it does, its groups, its keys.

    Args:
        command: its name.
        does: what it does.
        words: overrides, of which those that choose an option have its keys explained.
    """
    if command == "verify":
        return f"usage: echolearn verify <folder> ...\n\n{does}"
    text = f"usage: echolearn {command} [key=value ...] [-m]\n\n{does}"

    # The file begins with its groups, "- localizer@place: option", and goes on with its keys.
    head, _, keys = (folders()[0] / f"{command}.yaml").read_text().partition("\n\n")
    listed = head.partition("defaults:\n")[2].splitlines()
    pairs = [line.strip(" -").partition(": ") for line in listed]
    chosen = {place: option for place, _, option in pairs if place != "_self_"}
    groups = dict.fromkeys(place.partition("@")[0] for place in chosen)
    if groups:
        text += f"\n\ngroups, as in {command} group=option:\n"
    for group in groups:
        text += f"\n  {group:12}{', '.join(options_of(group))}"
    return f"{text}\n\nkeys:\n\n{keys.rstrip()}\n{_keys_of(chosen, words)}".rstrip()


def _keys_of(chosen: Mapping[str, str], words: Sequence[str]) -> str:
    """Return the files of chosen options, each under the words that choose it.

    Args:
        chosen: usual option of each group.
        words: overrides, which may choose others.
    """
    pairs = [word.partition("=") for word in words]
    typed = {key: value for key, _, value in pairs if key in chosen or options_of(key)}
    text = ""
    for group, option in {
        **{key: chosen[key] for key in EXPLAINED if key in chosen},
        **typed,
    }.items():
        file = file_of(f"{group.partition('@')[0]}/{option}")
        if file is not None:
            body = "\n".join(f"  {line}" for line in file.read_text().rstrip().splitlines())
            text += f"\nkeys of {group}={option}, as in {group}.<key>=<value>:\n\n{body}\n"
    return text
