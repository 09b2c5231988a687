"""Localize a survey as one localizer does: its echoes, their columns, their points on the map."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.signals import joint_db
from echolearn.checks import BadValue, is_number
from echolearn.evaluation import stats
from echolearn.evaluation.map_metrics import MAP_TOLERANCE
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Recordings
from echolearn.localization.localize import localize
from echolearn.localization.localizer import Localizer
from echolearn.mapping.echo_map import echo_map
from echolearn.survey import reader
from echolearn.survey.survey import blocks


def localize_survey(
    folder: Path, localizer: Localizer, *, name: str, resamples: int
) -> LocalizedSurvey:
    """Localize and describe every recording of a survey, and label its map points.

    Args:
        folder: folder of the survey, whose name it has.
        localizer: estimates the echoes.
        name: name of the localizer.
        resamples: bootstrap draws over the poses.

    Raises:
        BadValue: the survey has no outline to be evaluated against.
    """
    survey = replace(reader.read_survey(folder), window=localizer.window)
    if survey.walls is None:
        raise BadValue(
            f"{folder}/survey.yaml: it has no walls; without the room's outline no map is evaluated"
        )

    points = []
    columns = defaultdict(list)
    about: Any = {"array": survey.array, "speed_of_sound": survey.speed_of_sound}
    # Recordings are localized in blocks, because those of a long walk would not fit into memory.
    for block in blocks(survey):
        echoes, found = localize(survey.observe(block), localizer)
        placed = echo_map(echoes, survey.poses[block.start : block.stop], **about)
        points.append(placed.points)
        for key, column in found.items():
            columns[key].append(column)

    # An echo is true if its point lies on a wall: time and direction must both be right.
    every = np.concatenate(points)
    poses = np.repeat(np.arange(len(survey.poses)), localizer.echoes)
    labelled = LabelledRows(
        Recordings(
            Path(folder).name,
            kind="survey",
            noise=str(survey.conditions.get("noise", "unknown")),
            room=_room(survey.conditions, Path(folder).name),
            localizer=name,
        ),
        reference=distance_to_outline(every, survey.walls) <= MAP_TOLERANCE,
        groups=poses,
        joint_snr_db=np.full(len(poses), _joint_snr_db(survey.conditions)),
        weights=stats.cluster_weights(poses, resamples=resamples),
    )
    places = np.array([survey.poses[pose].position[:2] for pose in poses])
    joined = {key: np.concatenate(parts) for key, parts in columns.items()}
    return LocalizedSurvey(labelled, every, places, survey.walls, joined)


def _room(conditions: Mapping[str, Any], name: str) -> str:
    """Return what tables call the room of a survey, such as "8x6x5"; if unknown, the survey."""
    room = conditions.get("room", name)
    if isinstance(room, list) and all(is_number(side) for side in room):
        return "x".join(f"{side:g}" for side in room)
    return str(room)


def _joint_snr_db(conditions: Mapping[str, Any]) -> float:
    """Return the received probe over all noises together, to 0.1 dB; NaN where it is unknown."""
    levels = [conditions.get("snr_db"), conditions.get("sdnr_db")]
    known = [float(level) for level in levels if level is not None]
    if not known:
        return np.nan
    # Adding 0.0 turns -0.0 into 0.0, which is written as "0".
    return round(float(joint_db(*known)), 1) + 0.0
