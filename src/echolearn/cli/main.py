"""The commands: `echolearn <command> [overrides]`.

Hydra composes what a command shall do from `conf/<command>.yaml`, its groups and the overrides;
with `-m` the command runs once for every combination of the swept values. What it then does stands
in `commands`. Whatever goes wrong ends as one line on stderr and a status that is not zero.
"""

import os
import sys
from argparse import ArgumentError, ArgumentParser, Namespace
from collections.abc import Sequence
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import Any

from echolearn.cli.commands import COMMANDS, verify_folder

HELP = """usage: echolearn <command> [key=value ...] [options]

{summary}

commands:
{commands}

options:
  --help       of a command: its groups and keys
  --cfg        show the whole configuration instead of running it
  -m           run once for every combination: seed=0,1,2 classifier=svm_pair,trees_features
  --           with -m: another sweep follows; what stands before the first -- holds for all
  -j N         of these, N at a time; or hydra/launcher=joblib, submitit_slurm ... with hydra.launcher.<key>=<value>
  --traceback  show where in the code an error arose

More than this is in Hydra's override grammar: key=[1,2] is one list, 'classifier=glob(*)' sweeps over all options.
"""


DIRECTORS = {
    "generate": (
        "echolearn.dataset.generate",
        "echolearn.simulation.rir.images",
        "echolearn.localization.methods.gated",
    )
}
"""Commands that let other processes compute, and what these will import, which their director does
for all."""

OPTIONS = ("-m", "-j", "--cfg", "--help", "--traceback")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; return 0, 1 if it failed, 2 if it cannot be understood, 130 if
    interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    trace = "--traceback" in words
    try:
        dispatch([word for word in words if word != "--traceback"], trace=trace)
    except KeyboardInterrupt:
        print(
            "error: interrupted; the same command continues with what is finished", file=sys.stderr
        )
        return 130
    except BrokenPipeError:  # whoever read our output, `head` say, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        from echolearn.cli.config import UsageError
        from echolearn.cli.sweeps import complaint

        print(complaint(error, trace=trace), file=sys.stderr, flush=True)
        return 2 if isinstance(error, UsageError) else 1
    return 0


def dispatch(words: Sequence[str], *, trace: bool) -> None:
    """Find the command, and run or explain it."""
    command, rest = (words[0], words[1:]) if words else ("--help", [])
    if command in ("--help", "-h"):
        print(overview())
    elif command not in (*COMMANDS, "verify"):
        from echolearn.checks import suggest
        from echolearn.cli.config import UsageError

        raise UsageError(
            f"{command}: there is no such command; {suggest(command, [*COMMANDS, 'verify'])}"
        )
    elif "--help" in rest or "-h" in rest:
        print(explain(command))
    elif command == "verify":
        verify_all(rest, trace=trace)
    elif command in DIRECTORS:
        from echolearn.runtime.processes import single_threads

        with (
            single_threads()
        ):  # before a library is there that would begin threads: then this process can be forked
            run(command, rest, trace=trace)
    else:
        run(command, rest, trace=trace)


def overview() -> str:
    """Return the text of `echolearn --help`."""
    import echolearn

    lines = [
        f"  {name:10}{(function.__doc__ or '').strip()}"
        for name, function in [*COMMANDS.items(), ("verify", verify_folder)]
    ]
    return HELP.format(
        summary=(echolearn.__doc__ or "").split("\n")[0], commands="\n".join(lines)
    ).rstrip()


def explain(command: str) -> str:
    """Return the text of `echolearn <command> --help`: what it does, its groups, its keys."""
    from echolearn.cli import config

    if command == "verify":
        return f"usage: echolearn verify <folder> ...\n\n{verify_folder.__doc__}"
    head, _, keys = (config.folder() / f"{command}.yaml").read_text().partition("\n\n")
    listed = head.partition("defaults:\n")[2].splitlines()
    groups = [line.strip(" -").partition(":")[0].partition("@")[0] for line in listed]
    options = {
        g: ", ".join(sorted(path.stem for path in (config.folder() / g).glob("*.yaml")))
        for g in groups
        if g != "_self_"
    }
    lines = [f"  {group:12}{names}" for group, names in options.items()]
    usage = f"usage: echolearn {command} [key=value ...] [-m]\n\n{COMMANDS[command].__doc__}"
    chosen = f"\n\ngroups, as in {command} group=option:\n" + "\n".join(lines) if lines else ""
    return f"{usage}{chosen}\n\nkeys:\n\n{keys}"


def verify_all(folders: Sequence[str], *, trace: bool) -> None:
    """Verify every folder, and say what is wrong with which."""
    from echolearn.cli.config import UsageError
    from echolearn.cli.sweeps import run_all

    if not folders:
        raise UsageError("verify: name one or more folders, as in: echolearn verify runs/data/*")
    for folder in folders:
        if folder.startswith("-"):
            raise UsageError(
                f"{folder}: there is no such option; verify takes folders, ./{folder} if it is one"
            )
    if len(folders) == 1:
        print(verify_folder(folders[0]))
    else:
        run_all(verify_folder, [(folder, folder) for folder in folders], trace=trace)


def run(command: str, words: Sequence[str], *, trace: bool) -> None:
    """Run a command once, or with `-m` for every combination; with `--cfg` show its configuration
    instead.
    """
    from echolearn.cli.sweeps import run_all, say

    options, launcher, sweeps = parse(words)
    jobs = composed(command, options, sweeps)
    if options.cfg:
        for _, config in jobs:
            show(config)
    elif options.m:
        place = Path(jobs[0][1]["runs"]) / "sweeps"
        run_all(
            COMMANDS[command], jobs, workers=options.j, launcher=launcher, place=place, trace=trace
        )
    else:
        say(COMMANDS[command](jobs[0][1]))


def composed(
    command: str, options: Namespace, sweeps: Sequence[Sequence[str]]
) -> list[tuple[str, dict[str, Any]]]:
    """Return the jobs of all sweeps, each with a folder to write to; meanwhile what the command
    needs is imported.

    Raises:
        UsageError: a slip in an override, or a folder without a name, which would be the current
            one.
    """
    from echolearn.cli.compose import compose
    from echolearn.cli.config import UsageError
    from echolearn.runtime.processes import meanwhile

    def work() -> list[tuple[str, dict[str, Any]]]:
        return [
            job
            for sweep in sweeps
            for job in compose(command, sweep, many=options.m, resolve=not options.cfg)
        ]

    needed = () if options.cfg else DIRECTORS.get(command, ())
    jobs = meanwhile(work, lambda: [import_module(name) for name in needed]) if needed else work()
    for _, config in jobs:
        if not config["runs"].strip():
            raise UsageError(
                f"runs={config['runs']}: the name of a folder; the current one is runs=."
            )
    return jobs


def parse(words: Sequence[str]) -> tuple[Namespace, list[str], list[list[str]]]:
    """Return the options of a command line, the overrides for a launcher of Hydra, and the others
    of each sweep.

    Raises:
        UsageError: an option that does not exist, or has no effect here.
    """
    from echolearn.checks import suggest
    from echolearn.cli.config import UsageError

    parser = ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    for name in ("-m", "--cfg"):
        parser.add_argument(name, action="store_true")
    parser.add_argument("-j", type=int, choices=range(1, 1025), metavar="N", default=1)
    shared, *sweeps = [
        list(part) for dashes, part in groupby(["", *words], "--".__eq__) if not dashes
    ]
    try:
        options, rest = parser.parse_known_args(shared[1:])
    except ArgumentError:
        raise UsageError(
            "-j: must be followed by the number of processes, from 1 to 1024"
        ) from None
    for word in (word for part in (rest, *sweeps) for word in part):
        if word.startswith("-"):
            raise UsageError(f"{word}: there is no such option; {suggest(word, OPTIONS)}")
    launcher = [word for word in rest if word.startswith(("hydra/launcher=", "hydra.launcher."))]
    needless = [*launcher, *["-j"] * (options.j > 1), *["--"] * bool(sweeps)]
    if needless and not options.m:
        raise UsageError(f"{needless[0]}: is for multiruns; there is no -m")
    common = [word for word in rest if word not in launcher]
    return options, launcher, [[*common, *sweep] for sweep in sweeps or [[]]]


def show(config: dict[str, Any]) -> None:
    """Print a configuration."""
    import yaml

    print(yaml.safe_dump(config, sort_keys=False), end="")
