"""A survey whose echoes were scored, as what the writers of map files take."""

from echolearn.acoustics.types import Echoes, EchoMap
from echolearn.mapping.accuracy import accuracy_of
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.survey.survey import Survey


def mapped_walk(
    walk: Survey, echoes: Echoes, *, found: EchoMap, azimuths: int, resolution: float
) -> MappedWalk:
    """Return a walk with its echoes and their map.

    Args:
        walk: what was recorded.
        echoes: fields (P, R), robot frame.
        found: their P * R points.
        azimuths: directions of the localizer's grid.
        resolution: side of a cell of the occupancy grid, in m.
    """
    return MappedWalk(
        echoes=echoes,
        map=found,
        poses=walk.poses,
        numbers=walk.numbers,
        outline=walk.walls,
        resolution=resolution,
        accuracy=accuracy_of(
            walk.emitted,
            walk.array,
            azimuths=azimuths,
            speed_of_sound=walk.speed_of_sound,
            heading_bias_sd=walk.heading_bias_sd,
        ),
        placed=walk.mapped,
    )
