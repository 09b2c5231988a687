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
from echolearn.cli.own import VARIABLE, use_own
from echolearn.cli.streams import secure_streams

OPTIONS = (
    *("-m", "--multirun", "-j", "--cfg", "--package", "--resolve", "--info", "--help"),
    *("--version", "--traceback", "--config-dir", "--config-name"),
)

CFG = ("job", "hydra", "all")
"""What may be shown instead of being run: our configuration, Hydra's own, both."""

INFO = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
"""What Hydra tells of how it puts a configuration together."""

VERIFY = "verify"
"""The command that takes folders instead of a configuration."""

ALONE = ("generate", "check", "map", "live")
"""Commands that compute with one thread."""

Job = tuple[str, dict[str, Any]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, and return its exit status.

    That is 0, 1 if it failed, 2 if it cannot be understood, 130 if it was interrupted, 141 if
    nobody reads its output any more.
    """
    secure_streams()
    # A notebook hands down a backend of its own, which this environment may lack.
    os.environ["MPLBACKEND"] = "agg"
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
    own = _own_folder(rest)
    if own:
        use_own(own)
    if command in ("--help", "-h"):
        from echolearn.cli.help import overview

        print(overview({name: _does(name) for name in (*COMMANDS, VERIFY)}))
    elif command == "-sc":
        from echolearn.cli.completion import complete

        print(complete(rest, commands=[*COMMANDS], options=OPTIONS))
    elif command == "--version" or "--version" in rest:
        from echolearn import __version__

        print(__version__)
    elif command not in (*COMMANDS, "verify"):
        from echolearn.checks import suggest
        from echolearn.cli.config import UsageError

        advice = suggest(command, [*COMMANDS, "verify"])
        raise UsageError(f"{command}: there is no such command; {advice}")
    elif "--help" in rest or "-h" in rest:
        from echolearn.cli.help import explain

        print(explain(command, _does(command), words=rest))
    elif command == "verify":
        verify_folders(rest, trace=trace)
    else:
        from echolearn.runtime.processes import single_threads

        # The workers of `generate` compute with one thread each. If numpy, which now loads, begins
        # no threads here either, this process can fork them, which saves each its imports. Those of
        # `check`, `map` and `live` would wait for one another: their matrices are small.
        with single_threads() if command in ALONE else nullcontext():
            run(command, rest, trace=trace)


def _does(command: str) -> str:
    """Return the line on what a command does."""
    function = verify_folder if command == VERIFY else COMMANDS[command]
    return function.__doc__ or ""


def _own_folder(words: Sequence[str]) -> str | None:
    """Return the user's folder that a command line or the environment names."""
    for word, following in zip(words, [*words[1:], ""], strict=False):
        if word in ("--config-dir", "-cd"):
            return following
        if word.startswith("--config-dir="):
            return word.partition("=")[2]
    return os.environ.get(VARIABLE)


def verify_folders(folders: Sequence[str], *, trace: bool) -> None:
    """Verify every folder, named or by its path, and say what is wrong with which.

    Raises:
        UsageError: no folder, or an option.
    """
    from echolearn.cli.config import UsageError
    from echolearn.cli.sweeps import run_all
    from echolearn.robot.shipped import FOLDER, digests
    from echolearn.storage.named import all_named

    if not folders:
        raise UsageError("verify: name one or more folders, as in: echolearn verify runs/data/*")
    for folder in folders:
        if folder.startswith("-"):
            hint = f"verify takes folders, ./{folder} if it is one"
            raise UsageError(f"{folder}: there is no such option; {hint}")
    # One name may be that of a run and of the bundle made of it.
    folders = [place for each in folders for place in all_named(each, runs=Path("runs"))]
    along = digests()
    there = [not Path(each).exists() and each in along for each in folders]
    folders = [
        str(FOLDER / each) if ours else each for each, ours in zip(folders, there, strict=True)
    ]
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
    if options.info:
        from echolearn.cli.compose import show_info

        print(show_info(options.info, options.config_name or command, words=sweeps[0]))
        return
    if options.cfg not in (None, "job"):
        from echolearn.cli.compose import show_hydra

        primary = options.config_name or command
        print(show_hydra(options.cfg, primary, words=sweeps[0], package=options.package))
        return
    jobs = composed(command, sweeps, options=options)
    if options.cfg:
        from echolearn.cli.compose import shown

        for _, config in jobs:
            print(shown(config, options.package), end="")
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
    from echolearn.cli.names import as_one_text, named_apart

    jobs: list[Job] = []
    about = {
        "many": options.m,
        "resolve": options.resolve or not options.cfg,
        "primary": options.config_name,
    }
    for sweep in sweeps:
        if command == "compare" and not options.m:
            sweep = [as_one_text(word) for word in sweep]
        jobs += compose(command, sweep, **about)
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
    parser.add_argument("-m", "--multirun", action="store_true", dest="m")
    parser.add_argument("-c", "--cfg", choices=CFG)
    parser.add_argument("-p", "--package")
    parser.add_argument("--resolve", action="store_true")
    parser.add_argument("-i", "--info", choices=INFO)
    parser.add_argument("-cd", "--config-dir")
    parser.add_argument("-cn", "--config-name")
    parser.add_argument("-j", type=int, choices=range(1, 1025), metavar="N", default=1)

    # The word before the first -- keeps the first part from being empty.
    parts = groupby(["first", *_with_values(words)], "--".__eq__)
    [_, *shared], *sweeps = [list(part) for dashes, part in parts if not dashes]
    try:
        options, rest = parser.parse_known_args(shared)
    except ArgumentError as error:
        name = str(error.argument_name).rpartition("/")[2]
        hint = {
            "-j": "the number of processes, from 1 to 1024",
            "--info": " or ".join(INFO),
            "--cfg": " or ".join(CFG),
        }
        wanted = hint.get(name, "a folder" if name == "--config-dir" else "a name")
        raise UsageError(f"{name}: must be followed by {wanted}") from None
    for word in sum(sweeps, rest):
        if word.startswith("-"):
            raise UsageError(f"{word}: there is no such option; {suggest(word, OPTIONS)}")

    launcher = [word for word in rest if word.startswith(("hydra/launcher=", "hydra.launcher."))]
    needless = [*launcher, *["-j"] * (options.j > 1), *["--"] * bool(sweeps)]
    if options.package and not options.cfg:
        raise UsageError(f"--package={options.package}: is a part of what --cfg shows; add --cfg")
    if needless and not options.m:
        raise UsageError(f"{needless[0]}: is for sweeps over several values; -m is missing")
    common = [word for word in rest if word not in launcher]
    return options, launcher, [[*common, *sweep] for sweep in sweeps or [[]]]


def _with_values(words: Sequence[str]) -> list[str]:
    """Return words in which options whose value may be left out, as Hydra's, have theirs."""
    usual = {"--info": "all", "-i": "all", "--cfg": "job", "-c": "job"}
    found: list[str] = []
    pending = ""
    for word in words:
        if pending and "=" not in word and not word.startswith("-"):
            found[-1] = f"{pending}={word}"
            pending = ""
            continue
        pending = {"-i": "--info", "-c": "--cfg"}.get(word, word) if word in usual else ""
        found.append(f"{pending}={usual[word]}" if pending else word)
    return found
