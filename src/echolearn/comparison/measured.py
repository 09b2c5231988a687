"""Recorded surveys as rows to be judged: every echo, true or not, instead of the map they leave.

    surveys of one kind (room, array, protocol), at any SNR --localize--> MeasuredRows

Labels come from `truth.csv`: within 10 samples and 10 degrees of a true echo, one to one, and
within 10 samples alone; where directions are not known, by time alone. Without that table, from the
outline in `survey.yaml`: the echo's point lies within 0.10 m of a wall. Rows of one place of the
loudspeaker (column `place` of `poses.csv`), or else of one pose, are resampled together.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.types import Array, Echoes
from echolearn.checks import BadValue, check
from echolearn.comparison.conditions import joint_snr_db, room_of
from echolearn.comparison.localized import is_measured, localized, opened_survey
from echolearn.evaluation import stats
from echolearn.evaluation.labelling import Labels, joined, label_echoes, on_map
from echolearn.evaluation.rows import LabelledRows, MeasuredRows, Recordings
from echolearn.localization.localizer import Localizer
from echolearn.mapping.echo_map import echo_map
from echolearn.survey import reader
from echolearn.survey.health import Health
from echolearn.survey.survey import Survey


class Unheard(BadValue):
    """A localizer that cannot work on what was recorded."""


def is_mapped(folder: Path) -> bool:
    """Tell whether a survey leaves a map that can be judged by the outline of its room."""
    survey = reader.read_survey(folder)
    return survey.mapped and (survey.walls is not None or survey.truth is None)


def grouped(folders: Mapping[str, Path]) -> dict[str, list[Path]]:
    """Return recorded surveys by the name under which they are judged together.

    Those with `truth.csv` of one room, array, probe and protocol differ in noise alone.

    Args:
        folders: folders of surveys by name.
    """
    found = defaultdict(list)
    for name, folder in folders.items():
        if not is_measured(folder):
            continue
        survey = reader.read_survey(folder)
        alone = survey.truth is None or "room" not in survey.conditions
        title = folder.name if alone else room_of(survey.conditions, name)
        if survey.conditions.get("protocol") == "none":
            title += ", as they are"
        key = title, survey.array, survey.probe.sample_rate, survey.probe.length
        found[key].append((folder.name, folder))
    named: dict[str, list[Path]] = {}
    for (title, *_), surveys in found.items():
        # Of two kinds of recordings in one room the second is called after its first survey.
        known = surveys[0][0] if title in named else title
        named[known] = [folder for _, folder in surveys]
    return named


def measured_rows(
    group: str,
    folders: Sequence[Path],
    *,
    localizer: Localizer,
    name: str,
    resamples: int,
    further: Collection[str] = (),
    healths: Mapping[Path, Health] = MappingProxyType({}),
) -> MeasuredRows:
    """Localize and describe every recording of some surveys, and label its echoes.

    Args:
        group: name under which they are judged.
        folders: their folders.
        localizer: estimates the echoes.
        name: name of the localizer.
        resamples: bootstrap draws over the places.
        further: names of columns and tensors that are wanted besides those of every set.
        healths: what their recordings say about themselves (`recorded`); others stay as they are.

    Raises:
        BadValue: a survey without `truth.csv` and outline, or one that the localizer cannot work
            on.
    """
    heard = []
    for folder in folders:
        survey = opened_survey(folder, healths.get(folder), window=localizer.window)
        heard.append(localized_echoes(survey, localizer, further=further))
    strict = joined([each.labels.strict for each in heard])
    by_time = joined([each.labels.by_time for each in heard])
    reference = by_time if strict is None else strict
    check(reference is not None, "surveys", group, allowed="must tell the truth in one way")
    about = heard[0].survey.conditions
    noise = str(about.get("noise", "unknown"))
    room = room_of(about, group)
    source = Recordings(group, kind="measured", noise=noise, room=room, localizer=name)
    labelled = _labelled(heard, np.asarray(reference), source=source, resamples=resamples)
    label = "reflector" if strict is None else "on_map"
    return MeasuredRows(
        labelled,
        label="time_and_direction" if strict is not None and by_time is not None else label,
        by_time=by_time,
        columns={
            key: np.concatenate([each.columns[key] for each in heard]) for key in heard[0].columns
        },
        places=len(np.unique(labelled.groups)),
    )


def _labelled(
    heard: Sequence["LocalizedEchoes"], reference: Array, *, source: Recordings, resamples: int
) -> LabelledRows:
    """Return the echoes of some surveys with their labels.

    Args:
        heard: what was found in each survey.
        reference: which echoes of all of them are true, shape (B,), bool.
        source: where they come from.
        resamples: bootstrap draws over the places.
    """
    places = [place for each in heard for place in each.places]
    groups = np.unique(places, return_inverse=True)[1]
    return LabelledRows(
        source,
        reference=reference,
        groups=groups,
        joint_snr_db=np.concatenate([each.levels for each in heard]),
        weights=stats.cluster_weights(groups, resamples=resamples),
    )


class LocalizedEchoes(NamedTuple):
    """The echoes of one survey, B rows.

    Attributes:
        survey: the survey.
        labels: which of them are true.
        columns: what classifiers look at, by name, shape (B, ...).
        places: name of the place of each.
        levels: joint SNR of each, shape (B,), in dB.
    """

    survey: Survey
    labels: Labels
    columns: Mapping[str, Array]
    places: Sequence[str]
    levels: Array


def localized_echoes(
    survey: Survey, localizer: Localizer, *, further: Collection[str] = ()
) -> LocalizedEchoes:
    """Return the echoes of a survey, described and labelled.

    Args:
        survey: what was recorded.
        localizer: estimates the echoes.
        further: names of columns and tensors that are wanted besides those of every set.

    Raises:
        BadValue: nothing tells which are true, or the localizer cannot work on it (`Unheard`).
    """
    try:
        echoes, columns = localized(survey, localizer, further=further)
    except BadValue as error:
        raise Unheard(str(error)) from None
    count = echoes.toa.shape[1]
    places = [place for place in places_of(survey) for _ in range(count)]
    levels = np.full(len(places), joint_snr_db(survey.conditions))
    return LocalizedEchoes(survey, labels_of(survey, echoes), columns, places, levels)


def labels_of(survey: Survey, echoes: Echoes) -> Labels:
    """Return which echoes of a survey are true, pose by pose.

    Raises:
        BadValue: nothing tells.
    """
    if survey.truth is not None:
        # In samples of what is read, as the label of sets counts.
        rate = survey.emitted.sample_rate
        return label_echoes(survey.truth, echoes, sample_rate=rate, array=survey.array)
    place = f"{survey.folder}/survey.yaml"
    allowed = "must be the room's outline, or there must be a truth.csv, to judge echoes by"
    known = survey.walls is not None and survey.mapped
    check(known, f"{place} walls", None, allowed=allowed)
    about: Any = {"array": survey.array, "speed_of_sound": survey.speed_of_sound}
    points = echo_map(echoes, survey.poses, **about).points
    return Labels(on_map(points, np.asarray(survey.walls)), None)


def places_of(survey: Survey) -> list[str]:
    """Return the place of each pose: what `poses.csv` calls it, or else the pose itself."""
    named = survey.further.get("place")
    if named is not None:
        return list(named)
    return [f"{survey.folder.name} {number}" for number in survey.numbers]
