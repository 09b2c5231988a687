"""Localize a survey as one localizer does: its echoes, their columns, their points on the map."""

from collections import defaultdict
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes
from echolearn.checks import BadValue
from echolearn.comparison.conditions import joint_snr_db, room_of
from echolearn.evaluation import stats
from echolearn.evaluation.labelling import on_map
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Recordings
from echolearn.localization.columns import COLUMNS, TENSORS
from echolearn.localization.localize import localize
from echolearn.localization.localizer import Localizer, returned
from echolearn.mapping.echo_map import echo_map
from echolearn.survey.health import Health, as_found
from echolearn.survey.reader import read_survey
from echolearn.survey.survey import Survey, blocks

SIMULATED = "simulated.json"
"""File by which a simulated walk is known; its map is evaluated, and nothing else."""


def is_measured(folder: Path) -> bool:
    """Tell whether the echoes of a survey are to be judged one by one: it was recorded."""
    return not (Path(folder) / SIMULATED).is_file()


def opened_survey(folder: Path, health: Health | None, *, window: SearchWindow) -> Survey:
    """Return a survey whose recordings are mended when read.

    Args:
        folder: of the survey.
        health: what its recordings say about themselves; None leaves them as they are.
        window: where echoes are sought.
    """
    survey = replace(read_survey(folder), window=window)
    return survey if health is None else as_found(survey, health)


def localize_survey(
    folder: Path,
    localizer: Localizer,
    *,
    name: str,
    resamples: int,
    further: Collection[str] = (),
    health: Health | None = None,
) -> LocalizedSurvey:
    """Localize and describe every recording of a survey, and label its map points.

    Args:
        folder: folder of the survey, whose name it has.
        localizer: estimates the echoes.
        name: name of the localizer.
        resamples: bootstrap draws over the poses.
        further: names of columns and tensors that are wanted besides those of every set.
        health: what its recordings say about themselves (`recorded`); None takes them as they are.

    Raises:
        BadValue: the survey has no outline to be evaluated against.
    """
    survey = opened_survey(folder, health, window=localizer.window)
    if survey.walls is None:
        raise BadValue(
            f"{folder}/survey.yaml: it has no walls; without the room's outline no map is evaluated"
        )

    echoes, columns = localized(survey, localizer, further=further)
    about: Any = {"array": survey.array, "speed_of_sound": survey.speed_of_sound}
    every = echo_map(echoes, survey.poses, **about).points

    # An echo is true if its point lies on a wall: time and direction must both be right.
    poses = np.repeat(np.arange(len(survey.poses)), returned(localizer))
    labelled = LabelledRows(
        Recordings(
            Path(folder).name,
            kind="survey",
            noise=str(survey.conditions.get("noise", "unknown")),
            room=room_of(survey.conditions, Path(folder).name),
            localizer=name,
        ),
        reference=on_map(every, survey.walls),
        groups=poses,
        joint_snr_db=np.full(len(poses), joint_snr_db(survey.conditions)),
        weights=stats.cluster_weights(poses, resamples=resamples),
    )
    places = np.array([survey.poses[pose].position[:2] for pose in poses])
    return LocalizedSurvey(labelled, every, places, survey.walls, columns)


def localized(
    survey: Survey, localizer: Localizer, *, further: Collection[str] = ()
) -> tuple[Echoes, dict[str, Array]]:
    """Return the echoes of a survey, fields (P, R), and their columns (P R, ...), by name.

    Args:
        survey: P recordings.
        localizer: estimates R echoes of each.
        further: names of columns and tensors that are wanted besides those of every set.
    """
    names = {*COLUMNS, *TENSORS, *further}
    parts = []
    columns = defaultdict(list)
    # Recordings are localized in blocks, because those of a long walk would not fit into memory.
    for block in blocks(survey):
        echoes, found = localize(survey.observe(block), localizer, names=names)
        parts.append(echoes)
        for key, column in found.items():
            columns[key].append(column)
    fields = zip(*(vars(part).values() for part in parts), strict=True)
    whole = Echoes(*map(np.concatenate, fields))
    return whole, {key: np.concatenate(each) for key, each in columns.items()}
