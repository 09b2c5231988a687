"""Hear a recorded survey as one localizer does: its echoes, their columns, their points on the map."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import distance_to_outline
from echolearn.acoustics.signals import joint_db
from echolearn.acoustics.types import Array, Echoes
from echolearn.checks import BadValue
from echolearn.evaluation import metrics, stats
from echolearn.evaluation.scoring import Heard, Sheet
from echolearn.localization.localize import localize
from echolearn.localization.localizer import Localizer
from echolearn.mapping.echo_map import echo_map
from echolearn.survey import reader


def hear(folder: Path, localizer: Localizer, *, name: str, resamples: int) -> Heard:
    """Localize and describe every recording of a survey.

    Raises:
        BadValue: the survey has no outline to be judged against.
    """
    survey = reader.read(folder)
    if survey.walls is None:
        raise BadValue(f"{folder}/survey.yaml: no walls; an outline is needed to judge a map")
    described = [_describe(survey, localizer, block) for block in reader.blocks(survey)]
    columns = {
        key: np.concatenate([block[key] for _, block in described]) for key in described[0][1]
    }
    echoes = Echoes(
        *(np.concatenate([getattr(each, f.name) for each, _ in described]) for f in fields(Echoes))
    )
    found = echo_map(echoes, survey.poses, array=survey.array, speed_of_sound=survey.speed_of_sound)
    poses = np.repeat(np.arange(len(survey.poses)), localizer.echoes)
    sheet = Sheet(
        name,
        distance_to_outline(found.points, survey.walls) <= metrics.TOLERANCE,
        poses,
        np.full(len(poses), _ratio_db(survey.conditions)),
        stats.cluster_weights(poses, resamples=resamples),
        str(survey.conditions.get("noise", "unknown")),
    )
    return Heard(sheet, found.points, found.poses, survey.walls, columns)


def _ratio_db(conditions: Mapping[str, Any]) -> float:
    """Return the received probe over all noises together, to 0.1 dB; NaN where nothing is known of
    it.
    """
    known = [
        float(conditions[key]) for key in ("snr_db", "sdnr_db") if conditions.get(key) is not None
    ]
    return (
        round(float(joint_db(*known)), 1) + 0.0 if known else np.nan
    )  # 0.0 turns -0.0 into 0.0, as names have it


def _describe(
    survey: reader.Survey, localizer: Localizer, block: range
) -> tuple[Echoes, dict[str, Array]]:
    """Return the echoes of some poses, fields (B, R), and their description, rows pose by pose."""
    observation = survey.observe(block)
    return localize(observation, localizer)
