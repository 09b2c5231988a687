"""The commands: `echolearn <command> [overrides]`; the only importer of hydra.

Hydra composes what a command shall do from `conf/<command>.yaml`, its groups and the overrides; with `-m` the command
runs once for every combination of the swept values. A command here receives plain containers, builds what they
describe, and calls the library. Whatever goes wrong ends as one line on stderr and a status that is not zero.
"""

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from echolearn.dataset import Dataset

Config = dict[str, Any]

HELP = """usage: echolearn <command> [key=value ...] [options]

{summary}

commands:
{commands}

options:
  --help       of a command: its groups and keys
  --cfg        show the whole configuration instead of running it
  -m           run once for every combination: seed=0,1,2 classifier=svm_pair,trees_features
  --traceback  show where in the code an error arose

More than this is in Hydra's override grammar: key=[1,2] is one list, 'classifier=glob(*)' sweeps over all options.
"""


class JobsFailed(Exception):
    """Some jobs of a multirun failed; each has been reported."""


def generate(config: Config) -> None:
    """Make the labelled set of a plan; continues where it was interrupted."""
    from echolearn import dataset
    from echolearn.config import build

    plan, runs = build(config["plan"], "plan"), Path(config["runs"])
    print(dataset.generate(plan, runs=runs, workers=config["workers"], command=config["command"]))


def train(config: Config) -> None:
    """Train a classifier on the set of a plan, calibrate, export and judge it."""
    from echolearn.config import build
    from echolearn.dataset import folder_of
    from echolearn.task import Task
    from echolearn.training import train as fit
    from echolearn.types import check

    runs, about = Path(config["runs"]), config["classifier"]
    folder = folder_of(build(config["plan"], "plan"), runs)
    hint = f"run: echolearn generate plan={config['choice']['plan']}"
    check(folder.is_dir(), "plan", folder.name, allowed=f"a set that exists under {folder.parent}", hint=hint)
    dataset = open_set(folder.resolve())
    task = Task(dataset, **{key: config[key] for key in ("target", "seed", "split", "test_share", "validation_share")})
    result = fit(
        task,
        name=config["name"],
        classifier=lambda: build(about, "classifier"),
        config=about,
        runs=runs,
        folds=config["folds"],
        command=config["command"],
    )
    print(runs / "train" / result["run"])


@cache
def open_set(folder: Path) -> "Dataset":
    """Open a set, once for all the jobs of a multirun."""
    from echolearn.dataset import Dataset

    return Dataset(folder)


def survey(config: Config) -> None:
    """Simulate a robot's walk through a room and store its recordings."""
    from echolearn.config import build, without
    from echolearn.survey import survey as walk

    print(walk(**build(without(config, "choice rir noise runs")), runs=Path(config["runs"])))


def compare(config: Config) -> None:
    """Compare every trained run on every test set and survey: tables, tests, figures, report."""
    from echolearn.compare import compare as judge
    from echolearn.config import build, without

    readme = Path(config["readme"]) if config["readme"] else None
    judge(**build(without(config, "choice command window runs readme")), runs=Path(config["runs"]), readme=readme)


def verify(folders: Sequence[str]) -> None:
    """Re-prove finished folders: the size and checksum of every file."""
    from echolearn import store
    from echolearn.config import UsageError

    if not folders or folders[0].startswith("-"):
        raise UsageError("verify: name one or more folders, as in: echolearn verify runs/data/*")
    for folder in folders:
        print(f"{folder}: whole, {len(store.verify(Path(folder))['files'])} files")


COMMANDS: dict[str, Callable[[Config], None]] = {
    "generate": generate,
    "train": train,
    "survey": survey,
    "compare": compare,
}


OPTIONS = ("-m", "--cfg", "--help", "--traceback")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; return 0, 1 if it failed, 2 if it cannot be understood, 130 if interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    trace = "--traceback" in words
    try:
        dispatch([word for word in words if word != "--traceback"], trace=trace)
    except KeyboardInterrupt:
        print("error: interrupted; the same command continues with what is finished", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever read our output, `head` say, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return complain(error, trace=trace)
    return 0


def complain(error: Exception, *, trace: bool, about: str = "") -> int:
    """Write one line about an error to stderr, after its traceback if wanted; return the exit status."""
    from echolearn.config import UsageError
    from echolearn.types import BadValue

    if trace:
        traceback.print_exception(error)
    kind = "" if isinstance(error, BadValue | UsageError | JobsFailed) else f"{type(error).__name__}: "
    hint = "; pip install 'echolearn[lab]'" if isinstance(error, ModuleNotFoundError) else ""
    print(f"error: {about}{kind}{' '.join(str(error).split())}{hint}", file=sys.stderr, flush=True)
    return 2 if isinstance(error, UsageError) else 1


def dispatch(words: Sequence[str], *, trace: bool) -> None:
    """Find the command, and run or explain it."""
    command, rest = (words[0], words[1:]) if words else ("--help", [])
    if command in ("--help", "-h"):
        print(overview())
    elif command not in (*COMMANDS, "verify"):
        from echolearn.config import UsageError, suggest

        raise UsageError(f"{command}: there is no such command; {suggest(command, [*COMMANDS, 'verify'])}")
    elif "--help" in rest or "-h" in rest:
        print(explain(command))
    elif command == "verify":
        verify(rest)
    else:
        run(command, rest, trace=trace)


def overview() -> str:
    """Return the text of `echolearn --help`."""
    import echolearn

    lines = [
        f"  {name:10}{(function.__doc__ or '').strip()}" for name, function in [*COMMANDS.items(), ("verify", verify)]
    ]
    return HELP.format(summary=(echolearn.__doc__ or "").split("\n")[0], commands="\n".join(lines)).rstrip()


def explain(command: str) -> str:
    """Return the text of `echolearn <command> --help`: what it does, its groups, its keys."""
    from echolearn import config

    if command == "verify":
        return f"usage: echolearn verify <folder> ...\n\n{verify.__doc__}"
    head, _, keys = (config.folder() / f"{command}.yaml").read_text().partition("\n\n")
    groups = [
        line.strip(" -").partition(":")[0].partition("@")[0] for line in head.split("defaults:\n")[1].splitlines()
    ]
    options = {
        g: ", ".join(sorted(path.stem for path in (config.folder() / g).glob("*.yaml")))
        for g in groups
        if g != "_self_"
    }
    lines = [f"  {group:12}{names}" for group, names in options.items()]
    usage = f"usage: echolearn {command} [key=value ...] [-m]\n\n{COMMANDS[command].__doc__}"
    return f"{usage}\n\ngroups, as in {command} group=option:\n" + "\n".join(lines) + f"\n\nkeys:\n\n{keys}"


def run(command: str, words: Sequence[str], *, trace: bool) -> None:
    """Run a command once, or with `-m` for every combination; with `--cfg` show its configuration instead."""
    from echolearn.config import UsageError, compose, suggest

    options = [word for word in words if word.startswith("-")]
    for option in options:
        if option not in OPTIONS:
            raise UsageError(f"{option}: there is no such option; {suggest(option, OPTIONS)}")
    overrides, many = [word for word in words if word not in options], "-m" in options
    jobs = compose(command, overrides, many=many, resolve="--cfg" not in options)
    failed = []
    for name, config in jobs:
        try:
            show(config) if "--cfg" in options else COMMANDS[command](config)
        except Exception as error:
            if not many:
                raise
            complain(error, trace=trace, about=f"{name}: ")
            failed.append(name)
    if failed:
        raise JobsFailed(f"{len(failed)} of {len(jobs)} jobs failed: {'; '.join(failed)}")


def show(config: Config) -> None:
    """Print a configuration."""
    import yaml

    print(yaml.safe_dump(config, sort_keys=False), end="")


if __name__ == "__main__":
    sys.exit(main())
