"""The command line: `echolearn <command> [key=value ...] [options]`.

    words --parse--> options, sweeps --compose--> configurations --COMMANDS--> where the results are

What a command shall do is put together from `conf/<command>.yaml`, its groups and what is typed.
With `-m` it runs once for every combination of the swept values. What it then does stands in
`commands`. Whatever goes wrong ends as one line on stderr and a status that is not zero.
"""

import os
import sys
from argparse import ArgumentError, ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import nullcontext
from itertools import groupby
from pathlib import Path
from signal import SIGPIPE
from typing import Any

from echolearn.cli.commands import COMMANDS, verify_folder
from echolearn.cli.streams import secure_streams

HELP = """usage: echolearn <command> [key=value ...] [options]

{summary}

commands:
{commands}

options:
  --help       of a command: its groups and keys
  --version    show the version
  --cfg        show the whole configuration instead of running it
  -m           run once for every combination: seed=0,1,2 classifier=svm_pair,trees_features
  --           with -m: another sweep follows; what stands before the first -- holds for all
  -j N         with -m: do N jobs at a time, each in a process of its own; or let a launcher of
               Hydra do them: hydra/launcher=joblib, set by hydra.launcher.<key>=<value>
  --traceback  show where in the code an error arose

Values are written in Hydra's override grammar: key=[1,2] is one list, and 'classifier=glob(*)'
sweeps over all options.
"""

OPTIONS = ("-m", "-j", "--cfg", "--help", "--traceback")

ALONE = ("generate", "check", "map")
"""Commands that compute with one thread."""

Job = tuple[str, dict[str, Any]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, and return its exit status.

    That is 0, 1 if it failed, 2 if it cannot be understood, 130 if it was interrupted, 141 if
    nobody reads its output any more.
    """
    secure_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    trace = "--traceback" in words
    try:
        dispatch([word for word in words if word != "--traceback"], trace=trace)
        # Here, not when Python ends, whether anybody reads it can still be answered for.
        sys.stdout.flush()
    except KeyboardInterrupt:
        hint = "the same command continues with what is finished"
        print(f"error: interrupted; {hint}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read our output, `head` say, has seen enough; what was to be done is not done.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + SIGPIPE
    except Exception as error:
        from echolearn.cli.config import UsageError
        from echolearn.cli.sweeps import complaint

        print(complaint(error, trace=trace), file=sys.stderr, flush=True)
        return 2 if isinstance(error, UsageError) else 1
    return 0


def dispatch(words: Sequence[str], *, trace: bool) -> None:
    """Find the command, and run or explain it."""
    command, *rest = words or ["--help"]
    if command in ("--help", "-h"):
        print(overview())
    elif command == "--version":
        from echolearn import __version__

        print(__version__)
    elif command not in (*COMMANDS, "verify"):
        from echolearn.checks import suggest
        from echolearn.cli.config import UsageError

        advice = suggest(command, [*COMMANDS, "verify"])
        raise UsageError(f"{command}: there is no such command; {advice}")
    elif "--help" in rest or "-h" in rest:
        print(explain(command))
    elif command == "verify":
        verify_folders(rest, trace=trace)
    else:
        from echolearn.runtime.processes import single_threads

        # The workers of `generate` compute with one thread each. If numpy, which now loads, begins
        # no threads here either, this process can fork them, which saves each its imports. Those of
        # `check` and `map` would wait for one another: their matrices are small.
        with single_threads() if command in ALONE else nullcontext():
            run(command, rest, trace=trace)


def overview() -> str:
    """Return the text of `echolearn --help`."""
    import echolearn

    functions = {**COMMANDS, "verify": verify_folder}
    lines = [f"  {name:10}{function.__doc__}" for name, function in functions.items()]
    summary = (echolearn.__doc__ or "").split("\n")[0]
    return HELP.format(summary=summary, commands="\n".join(lines)).rstrip()


def explain(command: str) -> str:
    """Return the text of `echolearn <command> --help`: what it does, its groups, its keys."""
    from echolearn.cli.config import folder

    if command == "verify":
        return f"usage: echolearn verify <folder> ...\n\n{verify_folder.__doc__}"
    text = f"usage: echolearn {command} [key=value ...] [-m]\n\n{COMMANDS[command].__doc__}"

    # The file begins with its groups, "- localizer@place: option", and goes on with its keys.
    head, _, keys = (folder() / f"{command}.yaml").read_text().partition("\n\n")
    listed = head.partition("defaults:\n")[2].splitlines()
    groups = dict.fromkeys(line.strip(" -").partition(":")[0].partition("@")[0] for line in listed)
    groups.pop("_self_", None)
    if groups:
        text += f"\n\ngroups, as in {command} group=option:\n"
    for group in groups:
        options = sorted(path.stem for path in (folder() / group).glob("*.yaml"))
        text += f"\n  {group:12}{', '.join(options)}"
    return f"{text}\n\nkeys:\n\n{keys}"


def verify_folders(folders: Sequence[str], *, trace: bool) -> None:
    """Verify every folder, and say what is wrong with which.

    Raises:
        UsageError: no folder, or an option.
    """
    from echolearn.cli.config import UsageError
    from echolearn.cli.sweeps import run_all

    if not folders:
        raise UsageError("verify: name one or more folders, as in: echolearn verify runs/data/*")
    for folder in folders:
        if folder.startswith("-"):
            hint = f"verify takes folders, ./{folder} if it is one"
            raise UsageError(f"{folder}: there is no such option; {hint}")
    if len(folders) == 1:
        print(verify_folder(folders[0]))
    else:
        run_all(verify_folder, [(folder, folder) for folder in folders], trace=trace)


def run(command: str, words: Sequence[str], *, trace: bool) -> None:
    """Run a command once, or with `-m` for every combination; or show what it would do.

    Args:
        command: name of the command.
        words: overrides and options that follow it.
        trace: whether errors show their traceback.

    Raises:
        UsageError: a slip in an option or an override.
    """
    from echolearn.cli.sweeps import run_all, say

    options, launcher, sweeps = parse(words)
    jobs = composed(command, sweeps, options=options)
    if options.cfg:
        import yaml

        for _, config in jobs:
            print(yaml.safe_dump(config, sort_keys=False), end="")
    elif options.m:
        place = Path(jobs[0][1]["runs"]) / "sweeps"
        work = COMMANDS[command]
        run_all(work, jobs, workers=options.j, launcher=launcher, place=place, trace=trace)
    else:
        say(COMMANDS[command](jobs[0][1]))


def composed(command: str, sweeps: Sequence[Sequence[str]], *, options: Namespace) -> list[Job]:
    """Return the jobs of all sweeps.

    Args:
        command: what to do.
        sweeps: overrides of each sweep; one list of them without -m.
        options: those of the command line.

    Raises:
        UsageError: a slip in an override, two jobs of one name, or a folder without a name, which
            would be the current one.
    """
    from echolearn.cli.compose import compose
    from echolearn.cli.config import UsageError
    from echolearn.cli.names import named_apart

    jobs: list[Job] = []
    for sweep in sweeps:
        jobs += compose(command, sweep, many=options.m, resolve=not options.cfg)
    for _, config in jobs:
        if not config["runs"].strip():
            hint = "the current one is runs=."
            raise UsageError(f"runs={config['runs']}: must be the name of a folder; {hint}")
    return jobs if options.cfg else named_apart(command, jobs)


def parse(words: Sequence[str]) -> tuple[Namespace, list[str], list[list[str]]]:
    """Return the options, the overrides for a launcher of Hydra, and the others of each sweep.

    Raises:
        UsageError: an option that does not exist, or has no effect here.
    """
    from echolearn.checks import suggest
    from echolearn.cli.config import UsageError

    parser = ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("-m", action="store_true")
    parser.add_argument("--cfg", action="store_true")
    parser.add_argument("-j", type=int, choices=range(1, 1025), metavar="N", default=1)

    # The word before the first -- keeps the first part from being empty.
    parts = groupby(["first", *words], "--".__eq__)
    [_, *shared], *sweeps = [list(part) for dashes, part in parts if not dashes]
    try:
        options, rest = parser.parse_known_args(shared)
    except ArgumentError:
        hint = "must be followed by the number of processes, from 1 to 1024"
        raise UsageError(f"-j: {hint}") from None
    for word in sum(sweeps, rest):
        if word.startswith("-"):
            raise UsageError(f"{word}: there is no such option; {suggest(word, OPTIONS)}")

    launcher = [word for word in rest if word.startswith(("hydra/launcher=", "hydra.launcher."))]
    needless = [*launcher, *["-j"] * (options.j > 1), *["--"] * bool(sweeps)]
    if needless and not options.m:
        raise UsageError(f"{needless[0]}: is for sweeps over several values; -m is missing")
    common = [word for word in rest if word not in launcher]
    return options, launcher, [[*common, *sweep] for sweep in sweeps or [[]]]
