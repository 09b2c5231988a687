"""A recorded survey as a labelled set: what `train` and `compare` take like a simulated one.

    survey --examine, mend--> recordings --localized--> echoes, columns
    walls or truth.csv --true_echoes_of--> Truth --label_echoes--> labels --> set

Of walls, first echoes are those of mirror images that nothing stands before (`acoustics.sides`),
floor and ceiling among them where the height is known. A row is doubtful whose label a small error
of poses or walls would turn: its miss is within `NEAR` of the tolerance, or two true echoes are
as near to it. Rows of one place share a `group`, by which every split is made.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from echolearn.acoustics.geometry import microphone_positions, turned, wrap
from echolearn.acoustics.sides import distance_to_outline, first_echoes, mirror_images
from echolearn.acoustics.types import Array, Echoes, MicArray, Pose, Truth
from echolearn.checks import check, check_choice, check_name, check_number
from echolearn.comparison.conditions import joint_snr_db
from echolearn.comparison.finding import survey_digest
from echolearn.comparison.localized import localized, opened_survey
from echolearn.comparison.recorded import health_of, is_examined
from echolearn.dataset.labelled_set import FORMAT, RECORDED
from echolearn.dataset.records import structured
from echolearn.dataset.roles import ROLES
from echolearn.evaluation.labelling import MAP_TOLERANCE, label_echoes
from echolearn.evaluation.matching import TOA_TOLERANCE_SAMPLES
from echolearn.localization.localizer import Localizer
from echolearn.mapping.echo_map import echo_map
from echolearn.storage import manifests
from echolearn.storage.identity import plain
from echolearn.storage.once import locked
from echolearn.survey.floor_plan import floor_size
from echolearn.survey.survey import Survey

APART = 0.1
"""m within which poses are of one place."""

NEAR = 0.2
"""Share of a tolerance by which a miss may differ from it, or from that of another echo, and the
label is doubtful."""

SHOWN = 5
"""Doubtful rows that are printed."""


def label_survey(
    folder: Path,
    *,
    localizer: Localizer,
    runs: Path,
    name: str | None = None,
    role: str = "training",
    height: float | None = None,
    further: Sequence[str] = (),
    beside: Sequence[Path] = (),
    command: str | None = None,
) -> Path:
    """Write the labelled set of recorded surveys, and return its folder; once made, it is kept.

    Args:
        folder: of the survey.
        localizer: estimates the echoes.
        runs: folder of everything generated; the set goes to `runs/data`.
        name: of the set; that of the survey's folder unless given.
        role: what the set is for, of `roles.ROLES`.
        height: of the room in m, where floor and ceiling shall count; `truth.csv` needs none.
        further: names of columns and tensors that are wanted besides those of every set.
        beside: folders of further surveys by the same robot, whose rows follow; a place is one
            place in all of them.
        command: what makes the set again.

    Raises:
        BadValue: a survey that `map` would refuse, or of which nothing tells the truth.
    """
    name = name or Path(folder).resolve().name
    check_name("name", name)
    check_choice("role", role, *ROLES)
    if height is not None:
        check_number("height", height, low=0.5, high=200.0, unit="m")
    surveys = [_opened(each, localizer) for each in (folder, *beside)]
    survey = surveys[0]
    plan = _plan(survey, localizer, name=name, role=role, further=further)
    plan |= {} if height is None else {"height": float(height)}
    if beside:
        _check_one_robot(surveys)
        plan["beside"] = [survey_digest(each.folder) for each in surveys[1:]]
    place = Path(runs) / "data" / manifests.set_name({"format": FORMAT, "plan": plan})
    rows = partial(labelled_rows, *surveys, localizer=localizer, height=height, further=further)
    _write_once(place, rows, plan=plan, array=survey.array, command=command)
    _tell(place)
    return place


def _write_once(
    place: Path,
    rows: Callable[[], tuple[Array, list[tuple[int, int, str]]]],
    *,
    plan: dict[str, Any],
    array: MicArray,
    command: str | None,
) -> None:
    """Write a set unless it is there.

    Args:
        place: its folder.
        rows: makes its records, and tells the doubtful ones.
        plan: what its manifest says of how it was made.
        array: what the robot heard with.
        command: what makes it again.
    """
    with locked(place):
        if manifests.is_finished(place):
            return
        table, doubtful = rows()
        manifests.write_shard(place, 0, array=table)
        about = {"kind": "set", "format": FORMAT, "rows": len(table), "plan": plan}
        about |= {"microphones": array.positions.tolist(), "doubtful": doubtful}
        about |= manifests.command_entry(command)
        manifests.finish(place, about, files=[manifests.shard_name(0)])


def _plan(
    survey: Survey, localizer: Localizer, *, name: str, role: str, further: Sequence[str]
) -> dict[str, Any]:
    """Return what the manifest of the set says of how it was made, as that of a simulated one.

    Args:
        survey: what was recorded.
        localizer: estimates the echoes.
        name, role, further: as those of `label_survey`.
    """
    scene = {
        "array": plain(survey.array),
        "probe": plain(survey.emitted),
        "speed_of_sound": survey.speed_of_sound,
        "noise": {"kind": RECORDED},
        "diffuse": None,
    }
    return {
        "kind": RECORDED,
        "name": name,
        "role": role,
        "scene": scene,
        "window": plain(localizer.window),
        "localizer": plain(localizer),
        "sdnr_db": None,
        "further": list(further),
        "survey": survey_digest(survey.folder),
    }


def _tell(place: Path) -> None:
    """Print how many rows a set has, and which are doubtful."""
    manifest = manifests.load_manifest(place)
    doubtful = manifest["doubtful"]
    print(f"{place.name}: {manifest['rows']} rows, {len(doubtful)} doubtful")
    for row, index, why in doubtful[:SHOWN]:
        print(f"  row {row}, pose {index}: {why}")
    if len(doubtful) > SHOWN:
        print(f"  and {len(doubtful) - SHOWN} more: doubtful in {place / manifests.MANIFEST}")


def _opened(folder: Path, localizer: Localizer) -> Survey:
    """Return a survey as `map` hears it."""
    health = health_of(folder) if is_examined(folder) else None
    return opened_survey(folder, health, window=localizer.window)


def _check_one_robot(surveys: Sequence[Survey]) -> None:
    """Raise `BadValue` unless all surveys were recorded by the same robot."""
    first = surveys[0]
    for each in surveys[1:]:
        robots = [plain([one.array, one.emitted, one.speed_of_sound]) for one in (first, each)]
        allowed = f"must be of the array, burst and speed of sound of {first.folder}"
        check(robots[0] == robots[1], "beside", each.folder, allowed=allowed)


def labelled_rows(
    *surveys: Survey, localizer: Localizer, height: float | None, further: Sequence[str]
) -> tuple[Array, list[tuple[int, int, str]]]:
    """Return the records of surveys, a structured array (P R,), and which rows are doubtful.

    Args:
        surveys: what was recorded, mended.
        localizer: estimates R echoes of each of P poses.
        height, further: as those of `label_survey`.

    Raises:
        BadValue: they do not tell the truth in one way.
    """
    found: list[dict[str, Array]] = []
    doubtful: list[tuple[int, int, str]] = []
    for survey in surveys:
        columns, doubts = _labelled(survey, localizer, height=height, further=further)
        begun = sum(len(each["toa"]) for each in found)
        said = f"{survey.folder.name}: " if len(surveys) > 1 else ""
        doubtful += [(begun + row, index, f"{said}{why}") for row, index, why in doubts]
        found.append(columns)
    alike = len({frozenset(each) for each in found}) == 1
    allowed = "must be surveys that tell their truth in the same way, by truth.csv or by walls"
    check(alike, "beside", [each.folder.name for each in surveys], allowed=allowed)

    # What is not there is NaN, and surveys may have different numbers of true echoes.
    most = max(each["truth_toa"].shape[1] for each in found)
    for each in found:
        lacking = ((0, 0), (0, most - each["truth_toa"].shape[1]))
        each["truth_toa"] = np.pad(each["truth_toa"], lacking, constant_values=np.nan)
    joined = {name: np.concatenate([each[name] for each in found]) for name in found[0]}
    poses = sum(map(len, surveys))
    joined["group"] = np.repeat(place_groups(*surveys), len(joined["toa"]) // poses)
    return structured(joined), doubtful


def _labelled(
    survey: Survey, localizer: Localizer, *, height: float | None, further: Sequence[str]
) -> tuple[dict[str, Array], list[tuple[int, int, str]]]:
    """Return the columns of a survey, each (P R, ...), and which rows are doubtful.

    Args:
        survey: what was recorded, mended.
        localizer: estimates R echoes of each of P poses.
        height, further: as those of `label_survey`.
    """
    truths = survey.truth or true_echoes_of(survey, height)
    echoes, columns = localized(survey, localizer, further=further)
    columns = dict(columns)
    count, each = echoes.toa.shape
    rate = survey.emitted.sample_rate
    found = label_echoes(truths, echoes, sample_rate=rate, array=survey.array)
    columns |= {key: np.repeat(value, each, axis=0) for key, value in _context(survey).items()}
    columns["reflector"] = np.asarray(found.by_time)
    if found.strict is not None:
        columns["time_and_direction"] = found.strict
    off = None
    if survey.walls is not None and survey.mapped:
        off = _off_walls(survey, echoes)
        columns["on_map"] = off <= MAP_TOLERANCE
    columns["truth_toa"] = np.repeat(_padded(truths), each, axis=0)
    if each > 1:
        columns["echo"] = np.tile(np.arange(each), count)
    late = np.abs(columns["truth_toa"] - columns["toa"][:, None]) * rate / TOA_TOLERANCE_SAMPLES
    doubts = [
        (row, survey.numbers[row // each], why)
        for row, why in _doubtful(late, None if off is None else off / MAP_TOLERANCE)
    ]
    return columns, doubts


def true_echoes_of(survey: Survey, height: float | None = None) -> tuple[Truth, ...]:
    """Return the first echoes of a survey's walls at each pose.

    Args:
        survey: with an outline.
        height: of the room in m; None leaves floor and ceiling out.

    Raises:
        BadValue: a survey without an outline, or whose poses are not those of a map.
    """
    known = survey.walls is not None and survey.mapped
    allowed = "must be the floor plan, or there must be a truth.csv, to label echoes by"
    check(known, f"{survey.folder}/survey.yaml walls", None, allowed=allowed)
    poses = range(len(survey))
    return tuple(_truth_at(survey, pose, height=height) for pose in poses)


def _truth_at(survey: Survey, pose: int, *, height: float | None) -> Truth:
    """Return the first echoes at a pose; arguments as those of `true_echoes_of`."""
    walls, here = np.asarray(survey.walls), survey.poses[pose]
    source = loudspeaker_at(survey, pose)
    first = microphone_positions(survey.array, here)[0]
    heard = np.isfinite(first_echoes(walls, source, microphones=first[None])[0])
    level = mirror_images(walls, source[:2])[heard]
    images = np.column_stack([level, np.full(len(level), source[2])])
    if height is not None:
        upright = np.array([-source[2], 2.0 * height - source[2]])
        images = np.concatenate([images, np.column_stack([np.tile(source[:2], (2, 1)), upright])])
    toward = images - here.position - turned(survey.array.centre, here.heading)
    distance = np.linalg.norm(toward, axis=1)
    return Truth(
        toa=np.linalg.norm(images - first, axis=1) / survey.speed_of_sound,
        azimuth=wrap(np.arctan2(toward[:, 1], toward[:, 0]) - here.heading),
        elevation=np.arccos(toward[:, 2] / distance),
    )


def loudspeaker_at(survey: Survey, pose: int) -> Array:
    """Return where the loudspeaker stood at a pose, shape (3,), in m, in the room's frame."""
    here: Pose = survey.poses[pose]
    position = np.asarray(here.position, dtype=float)
    if survey.loudspeakers is None:
        return position
    return position + turned(survey.loudspeakers[pose], here.heading)


def place_groups(*surveys: Survey) -> Array:
    """Return the number of the place of each pose of all surveys, shape (P,).

    That is what `poses.csv` calls `place`; or else poses belong together that are chained by steps
    of at most `APART` of the robot, or of its loudspeaker where that moves on its own.
    """
    named = [survey.further.get("place") for survey in surveys]
    if all(each is not None for each in named):
        return np.unique(np.concatenate([np.array(each) for each in named]), return_inverse=True)[1]
    points = np.stack(
        [loudspeaker_at(survey, pose) for survey in surveys for pose in range(len(survey))]
    )
    pairs = cKDTree(points).query_pairs(APART, output_type="ndarray")
    count = len(points)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


def _context(survey: Survey) -> dict[str, Array]:
    """Return what the localizer did not know of each pose; unknown is NaN, of sizes 0."""
    count = len(survey)
    unknown = np.full(count, np.nan)
    return {
        "snr_db": np.full(count, joint_snr_db(survey.conditions)),
        "gain_db": np.zeros(count),
        "t60": unknown,
        "room": np.tile([*floor_size(survey.walls), 0.0], (count, 1)),
        "position": np.array([pose.position for pose in survey.poses], dtype=float),
        "heading": np.array([pose.heading for pose in survey.poses], dtype=float),
        "group": np.zeros(count, dtype=np.int64),  # told over all surveys (`labelled_rows`)
    }


def _off_walls(survey: Survey, echoes: Echoes) -> Array:
    """Return how far the points of echoes are from the floor plan, shape (P R,), in m."""
    about: Any = {"array": survey.array, "speed_of_sound": survey.speed_of_sound}
    points = echo_map(echoes, survey.poses, **about).points
    return distance_to_outline(points, np.asarray(survey.walls))


def _padded(truths: Sequence[Truth]) -> Array:
    """Return the times of true echoes, NaN where a pose has fewer, shape (P, W), in s."""
    most = max(1, *(len(truth.toa) for truth in truths))
    found = np.full((len(truths), most), np.nan)
    for row, truth in zip(found, truths, strict=True):
        row[: len(truth.toa)] = truth.toa
    return found


def _doubtful(late: Array, off: Array | None) -> Iterator[tuple[int, str]]:
    """Yield rows whose label a small error would turn, and why.

    Args:
        late: misses of the true times, in tolerances, NaN for none, shape (B, W).
        off: distances from the floor plan, in tolerances, shape (B,); None: there is none.
    """
    ordered = np.sort(np.where(np.isnan(late), np.inf, late), axis=1)
    first = ordered[:, 0]
    second = ordered[:, 1] if ordered.shape[1] > 1 else np.full(len(ordered), np.inf)
    edge = np.abs(first - 1.0) <= NEAR
    # Infinity less infinity is no number; only where both are near does it matter.
    both = (second <= 1.0) & (np.where(second <= 1.0, second, 0.0) - first <= NEAR)
    beside = np.zeros(len(first), bool) if off is None else np.abs(off - 1.0) <= NEAR
    reasons = (
        (edge, "its time is at the edge of the tolerance"),
        (beside, "its point is at the edge of the tolerance"),
        (both, "two walls are equally near"),
    )
    for row in range(len(first)):
        told = [why for found, why in reasons if found[row]]
        if told:
            yield row, "; ".join(told)
