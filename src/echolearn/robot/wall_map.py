"""A survey mapped wall by wall, by a bundle of a classifier of walls.

    recordings (B, M, N) --matched filters--> HeardWalk --verdicts--> walls, and points on them

Every pose that heard a hypothesis by itself gives it a point, the foot of its perpendicular on the
track, believed as much as the wall is, times the probability that this pose heard it. Where too few
poses did, all that have the line in their window give it their foot on the line: what is known of
such a wall is what all of them say together. Points of walls that are believed are kept.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.bistatic import echo_direction, echo_path
from echolearn.acoustics.geometry import direction, wrap
from echolearn.acoustics.signals import energy_under_probe, matched_filter
from echolearn.acoustics.types import Array, Echoes, EchoMap, Observation
from echolearn.checks import check
from echolearn.localization.faults import check_recordings
from echolearn.mapping.mapped_walk import JudgedWalls, MappedWalk
from echolearn.mapping.walls import Line
from echolearn.robot.by_block import block_by_block, concatenated
from echolearn.robot.scorer import Scorer
from echolearn.robot.walk_map import mapped_walk
from echolearn.survey.survey import Survey
from echolearn.walls.track import Track, hearing
from echolearn.walls.verdicts import WallClassifier, WallVerdicts, verdicts
from echolearn.walls.walk import MARGIN, HeardWalk, lags_needed


@dataclass(frozen=True, eq=False)
class Sound:
    """What is kept of recordings of P poses.

    Attributes:
        outputs: matched filters, shape (P, M, L), as `HeardWalk` wants them.
        scores: normalised correlation of microphone 1 with the probe, shape (P, L).
    """

    outputs: Array
    scores: Array


def check_together(walk: Survey) -> None:
    """Raise `BadValue` unless the poses of a survey can be heard together."""
    allowed = "must have poses to sum over"
    hint = "its echoes are times and directions only (map: false): name a bundle of echoes, point"
    check(walk.mapped, "survey", walk.folder, allowed=allowed, hint=hint)
    allowed = "must carry its loudspeaker"
    hint = "it moves on its own there: name a bundle of echoes, point"
    check(walk.loudspeakers is None, "survey", walk.folder, allowed=allowed, hint=hint)


def sound_of(scorer: Scorer, observation: Observation) -> Sound:
    """Return what is kept of recordings, samples (B, M, N) without the direct path.

    Raises:
        BadValue: another robot than the bundle's, or recordings that cannot be analysed.
    """
    scorer.mount(observation)
    window = scorer.bundle.localizer.window
    check_recordings(observation, window, beyond=MARGIN)
    rate, speed = observation.probe.sample_rate, observation.speed_of_sound
    about = {"sample_rate": rate, "speed_of_sound": speed}
    first, last = lags_needed(window, observation.array, **about)
    lags = {"first": first, "last": last}
    outputs = matched_filter(observation.samples, observation.probe, **lags)
    energy = energy_under_probe(observation.samples[:, 0], observation.probe, **lags)
    largest = np.sqrt(np.maximum(energy * observation.probe.energy, 1e-30))
    # Half the digits are far below any noise, and half the memory.
    return Sound(outputs.astype(np.float32), (outputs[:, 0] / largest).astype(np.float32))


def heard_walk(scorer: Scorer, walk: Survey, *, outputs: Array) -> HeardWalk:
    """Return what a classifier of walls is told of a survey.

    Args:
        scorer: its bundle at work.
        walk: the survey, recorded as the bundle wants it.
        outputs: matched filters of the poses, shape (P, M, L).
    """
    poses = np.array([[*pose.position[:2], pose.heading] for pose in walk.poses])
    # Of the array as it is mounted here: a turned one hears from turned directions.
    return HeardWalk(
        outputs,
        poses,
        scorer.bundle.localizer.window,
        walk.array,
        walk.emitted.sample_rate,
        walk.speed_of_sound,
    )


def classifier_of(scorer: Scorer) -> WallClassifier:
    """Return the classifier of a bundle of walls."""
    bundle = scorer.bundle
    count = bundle.hypotheses or 1
    return WallClassifier(bundle.inputs, scorer.compute, bundle.threshold, count)


def score_walls(scorer: Scorer, walk: Survey, *, resolution: float = 0.05) -> MappedWalk:
    """Hear a survey as a whole, and map the walls that a bundle of walls believes in.

    Args:
        scorer: the bundle at work.
        walk: recorded as the bundle wants it.
        resolution: side of a cell of the occupancy grid, in m.

    Raises:
        BadValue: a recording that cannot be analysed; names its file.
    """
    sound = block_by_block(walk, lambda block: sound_of(scorer, walk.observe(block)))
    return wall_mapped(scorer, walk, sound=concatenated(sound), resolution=resolution)


def wall_mapped(scorer: Scorer, walk: Survey, *, sound: Sound, resolution: float) -> MappedWalk:
    """Return the map of the walls that a classifier believes in.

    Args:
        scorer: a bundle of walls at work.
        walk: the survey.
        sound: of its poses.
        resolution: side of a cell of the occupancy grid, in m.
    """
    heard = heard_walk(scorer, walk, outputs=sound.outputs)
    said = verdicts(heard, classifier_of(scorer))
    points = _points(said)
    stood = heard.poses[points.poses, :2]
    belief = said.confidence[points.number] * hearing(points.response)
    mapped = mapped_walk(
        walk,
        _echoes(heard, points, scores=sound.scores),
        found=EchoMap(points.places, belief, said.believed[points.number], stood),
        azimuths=len(heard.azimuths),
        resolution=resolution,
    )
    lines = [line for track in said.walls for line in stretches_of(track)]
    judged = JudgedWalls(
        points.poses, lines, **vars(said.found), confidence=said.confidence, believed=said.believed
    )
    return replace(mapped, judged=judged)


class _Points(NamedTuple):
    """Points that poses give hypotheses: N poses, places (N, 2), J, numbers of the hypotheses."""

    poses: Array
    places: Array
    response: Array
    number: Array


def _points(said: WallVerdicts) -> _Points:
    """Return the points of all tracks, pose by pose, of one pose the strongest evidence first."""
    told = [track.told for track in said.tracks]
    number = np.repeat(np.arange(len(told)), [int(each.sum()) for each in told])
    parts = [
        (track.poses[each], track.places[each], track.response[each])
        for track, each in zip(said.tracks, told, strict=True)
    ]
    nothing = np.empty(0, dtype=int), np.empty((0, 2)), np.empty(0)
    poses, places, response = (np.concatenate(each) for each in zip(nothing, *parts, strict=True))
    order = np.argsort(poses, kind="stable")
    return _Points(poses[order], places[order], response[order], number[order])


def _echoes(heard: HeardWalk, points: _Points, *, scores: Array) -> Echoes:
    """Return the echoes of points, fields (N,).

    Args:
        heard: the walk.
        points: where its poses heard walls.
        scores: normalised correlations of microphone 1, shape (P, L).
    """
    x, y, heading = heard.poses[points.poses].T
    toward = points.places - np.stack([x, y], axis=1)
    azimuth = np.arctan2(toward[:, 1], toward[:, 0]) - heading
    normal = direction(azimuth, np.pi / 2.0)
    distance = np.linalg.norm(toward, axis=1)
    toa = echo_path(distance, normal, array=heard.array) / heard.speed_of_sound
    seen = echo_direction(distance, normal, array=heard.array)
    lag = np.rint(toa * heard.sample_rate).astype(int) - heard.first
    score = scores[points.poses, np.clip(lag, 0, scores.shape[1] - 1)].astype(float)
    return Echoes(
        toa=toa,
        score=score,
        # Many microphones and poses tell of it, and none its amplitude.
        gain=np.full(len(toa), np.nan),
        azimuth=wrap(np.arctan2(seen[:, 1], seen[:, 0])),
        elevation=np.arccos(seen[:, 2]),
        power=points.response**2,
    )


def stretches_of(track: Track) -> list[Line]:
    """Return a wall as lines, one for each of its stretches."""
    return [replace(track.line, start=start, end=end) for start, end in track.stretches]
