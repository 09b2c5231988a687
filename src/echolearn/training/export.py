"""From a finished run to a bundle: the folder that a robot loads (`robot.bundle` has the format).

    run + set + scene --bundle_contents--> files and description --write--> folder --load--> proved

What the files hold is in `bundle_contents`. A bundle is finished only once it has been loaded as a
robot does.
"""

from collections.abc import Mapping, Sequence
from glob import escape
from pathlib import Path
from typing import Any

from echolearn.acoustics.types import MicArray, Probe
from echolearn.checks import BadValue, check, check_name, check_whole
from echolearn.classifiers.operating_point import BALANCED, Aim, choose_cut, point_of, read_aim
from echolearn.dataset.labelled_set import Dataset
from echolearn.robot import bundle, schema, scorer
from echolearn.robot.reference import Reference
from echolearn.storage import manifests
from echolearn.storage.advice import assignment, command_line, repair_hint
from echolearn.storage.files import clean, load_json, write_atomic
from echolearn.storage.identity import digest
from echolearn.storage.kinds import check_kind
from echolearn.storage.once import locked
from echolearn.training.bundle_contents import bundle_description, bundle_files, map_figures
from echolearn.training.card import card as card_of
from echolearn.training.predictions import validation_rows
from echolearn.training.runs import Run, read_run
from echolearn.training.walks import reference_of
from echolearn.training.wall_card import wall_card

RUN = "must be a folder that echolearn train wrote"
COMPARISON = "must be a folder that echolearn compare wrote"


def export(
    *,
    run: Path | None,
    best: Path | None,
    array: MicArray,
    probe: Probe,
    runs: Path,
    name: str | None = None,
    aim: str | None = None,
    resamples: int = 1000,
    reference: Dataset | None = None,
    card: Path | None = None,
    evidence: Sequence[str] = (),
    command: str | None = None,
) -> Path:
    """Write the bundle of a run, prove that it loads, and return its folder; once made, it is kept.

    Args:
        run, best: folder of a finished run, or of a comparison whose chosen run is exported.
        array, probe: what the run's set was made with.
        runs, name: the bundle goes to `runs/bundles/<name>`; named after its run unless given.
        aim: what the cut shall do on validation rows; None leaves the run's (`operating_point`).
        resamples: bootstrap draws behind the intervals of its metrics.
        reference: set of simulated walks of the training kind (`walks`), if robots shall ask.
        card, evidence: Markdown page about the bundle, if wanted; comparisons that it shows.
        command: what makes the bundle again.

    Raises:
        BadValue: what is missing, damaged, not the set's, cannot travel, is out of reach, or taken.
    """
    check_whole("resamples", resamples, low=20, high=100_000)
    wanted = None if aim is None else read_aim(aim)
    source = find_run(run, best)
    folder = _folder(runs, source.identity if name is None else name)
    # Everything is put together before the folder is touched: what fails leaves nothing.
    dataset = set_of(source)
    cut = cut_for(source, dataset, aim=wanted)
    about = bundle_description(cut, dataset, array=array, probe=probe, resamples=resamples)
    # A comparison speaks of the maps that the run's own cut leaves.
    maps = map_figures(Path(best), cut) if best and cut.threshold == source.threshold else []
    about["metrics"]["maps"] = maps
    about |= {"name": folder.name, **manifests.command_entry(command)}
    files = bundle_files(cut, dataset, probe=probe)
    if reference is not None:
        _refer(about, files, told=reference_of(cut.inputs, dataset, walks=reference))
    _write_once(folder, about, files=files, run=cut)
    if card:
        _write_card(card, folder, plan=dataset.manifest["plan"], evidence=evidence)
    return folder


def _folder(runs: Path, name: str) -> Path:
    """Return the folder of a bundle, whose name is checked."""
    check_name("name", name)
    return Path(runs) / "bundles" / name


def _write_once(
    folder: Path, about: Mapping[str, Any], *, files: Mapping[str, bytes], run: Run
) -> None:
    """Write a bundle unless it is there.

    Args:
        folder: of the bundle.
        about: what `bundle.json` says.
        files: the others, by name.
        run: whose it is.
    """
    with locked(folder, waiting=f"{folder.name}: waiting for another command that exports it"):
        check_free(folder, run)
        if not _holds(folder, about, files=files):
            _write(folder, about, files=files)


def _refer(about: dict[str, Any], files: dict[str, bytes], *, told: Reference) -> None:
    """Add a reference to the content of a bundle.

    Args:
        about: what `bundle.json` says.
        files: the others, by name.
        told: the reference.
    """
    about |= {"schema": schema.WITH_REFERENCE, "reference": told.about()}
    files[schema.REFERENCE] = told.to_bytes()


def _write_card(
    card: Path, folder: Path, *, plan: Mapping[str, Any], evidence: Sequence[str]
) -> None:
    """Write the page about a bundle.

    Args:
        card: its file.
        folder: of the bundle.
        plan: that its set was made by.
        evidence: folders of comparisons whose figures it shows.
    """
    told = [Path(name) for name in evidence]
    about = load_json(folder / manifests.BUNDLE)
    write = wall_card if about["schema"] == schema.OF_WALLS else card_of
    page = write(about, plan=plan, evidence=told)
    write_atomic(Path(card), page.encode())


def find_run(run: Path | None, best: Path | None) -> Run:
    """Return the run in a folder, or the one that a comparison has chosen; one of the two is None.

    Raises:
        BadValue: both or neither are given, or what is given is not there.
    """
    allowed = "must be a run's folder, or give best=<a comparison's folder>, not both"
    check((run is None) != (best is None), "run", run, allowed=allowed)
    return run_chosen_by(best) if best else open_run(Path(run or ""))


def open_run(folder: Path) -> Run:
    """Return a finished run, every file of it proved.

    Raises:
        BadValue: not a folder that `train` wrote, or one that is damaged or of another version.
    """
    check_kind("run", folder, wanted="run", allowed=RUN)
    folder = folder.resolve()
    check((folder / manifests.METRICS).is_file(), "run", folder, allowed=RUN)
    return read_run(folder)


def run_chosen_by(comparison: Path) -> Run:
    """Return the run that a comparison has chosen by validation rows alone.

    Raises:
        BadValue: not a folder that `compare` wrote, or one that is damaged or outdated.
    """
    hint = "make paper makes runs/compare/paper, or: echolearn compare"
    check_kind("best", comparison, wanted="comparison", allowed=COMPARISON, hint=hint)
    folder = comparison.resolve()
    manifest = manifests.verify(folder)
    check(manifest.get("kind") == "comparison", "best", folder, allowed=COMPARISON)
    again = repair_hint(manifest, folder)
    check(
        "chosen" in manifest,
        "best",
        folder,
        allowed=COMPARISON,
        hint=f"made by echolearn 0.1; {again}",
    )

    # A run that was trained again since may be a worse one than the comparison has seen.
    found = open_run(folder.parents[1] / "train" / manifest["chosen"])
    same = found.metrics["model"]["sha256"] == manifest["inputs"]["runs"][found.identity]
    allowed = "must be a comparison of the runs that are there"
    check(same, "best", folder, allowed=allowed, hint=again)
    return found


def set_of(run: Run) -> Dataset:
    """Return the set that a run was trained on, from beside the run."""
    return Dataset(set_folder(run))


def set_folder(run: Run) -> Path:
    """Return the folder of the set that a run was trained on, beside the run.

    Raises:
        BadValue: it is not there.
    """
    place = run.folder.parents[1] / "data"
    for path in sorted(place.glob(f"{escape(run.model.trained_on)}-*/{manifests.MANIFEST}")):
        if digest(manifests.load_manifest(path.parent)["files"]) == run.data_digest:
            return path.parent
    make = command_line("generate", assignment("plan", run.model.trained_on), runs=place.parent)
    raise BadValue(f"run={run.folder}: its set must be under {place}; make it: {make}")


def cut_for(run: Run, dataset: Dataset, *, aim: Aim | None) -> Run:
    """Return a run with the cut that an aim calls for on its own validation rows.

    Args:
        run: finished run.
        dataset: set that it was trained on.
        aim: what the cut shall do; None leaves the run's.

    Raises:
        BadValue: a precision out of reach.
    """
    # Chosen again by the exported model, the run's own cut would differ by rounding.
    if aim is None or run.metrics.get("operating_point", {"aim": BALANCED})["aim"] == str(aim):
        return run
    point = choose_cut(*validation_rows(run, dataset), aim=aim)
    told = {"threshold": point.threshold, "operating_point": point_of(point)}
    return Run(run.folder, {**run.metrics, **told})


def check_free(folder: Path, run: Run) -> None:
    """Raise `BadValue` if the folder is something else than an older bundle of the same run."""
    if not folder.exists() or not any(folder.iterdir()):
        return
    try:
        other = bundle.read_bundle(folder).about["run"]
    except BadValue:
        # A bundle that was interrupted or damaged has names of its own only, and may be mended.
        names = {path.name for path in folder.glob("[!.]*")}
        other = (
            run.identity if names <= {*schema.LIMITS, schema.REFERENCE, manifests.BUNDLE} else ""
        )
    content = f"the bundle of {other}" if other else "something else"
    allowed = "must be a new name, or that of this run's bundle"
    hint = f"{folder} holds {content}"
    check(other == run.identity, "name", folder.name, allowed=allowed, hint=hint)


def _holds(folder: Path, about: Mapping[str, Any], *, files: Mapping[str, bytes]) -> bool:
    """Tell whether a folder holds exactly this bundle, and that loads."""
    try:
        found = scorer.load(folder).bundle.about
    except BadValue:
        return False
    same = {**found, **about} == found
    return same and all((folder / name).read_bytes() == data for name, data in files.items())


def _write(folder: Path, about: Mapping[str, Any], *, files: Mapping[str, bytes]) -> None:
    clean(folder)
    for name, content in files.items():
        write_atomic(folder / name, content)
    manifests.finish(folder, about, files=files, last=manifests.BUNDLE)

    # A bundle that is refused on a robot is not finished.
    try:
        scorer.load(folder)
    except BadValue:
        (folder / manifests.BUNDLE).unlink()
        raise
