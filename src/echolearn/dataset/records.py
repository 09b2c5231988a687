"""What a set holds of observations: a record per echo, simulated, estimated, described, labelled.

A record has the columns and tensors of `features`, the labels

- `reflector` (the paper's): |estimated - true TOA| < 10 samples for some reflecting wall; of several echoes of one
  observation no two for the same wall (`matching`),
- `on_map`: the map point (TOA and DOA together) lies within 0.10 m of the room's outline,

and what the estimator did not know: SNR, gain, T60, room, pose, true TOAs, and `group`, the
    position's number,
by which every split is made; SDNR only in sets with diffuse noise, pings only where several are
averaged.

Where a plan's localizer finds R > 1 echoes, an observation has R records one after the other,
strongest first, with the number `echo` from 0 and the `wall` that each was matched with, its place
in `truth_toa`, or -1.

Where it whitens, it is handed a recording of the noise alone, made for each observation apart:
    levels differ from row
to row, so rows are then estimated one by one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import (
    check_inside,
    distance_to_outline,
    outline,
    true_echoes,
    wall_points,
)
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.dataset.plans import Plan, Spot
from echolearn.evaluation.matching import TOA_TOLERANCE_SAMPLES, UNMATCHED, match_echoes
from echolearn.evaluation.metrics import MAP_TOLERANCE
from echolearn.localization.localize import localize
from echolearn.simulation.observe import NOISE_SECONDS, add_noise, noise_alone
from echolearn.simulation.scene import Scene


class Heard(NamedTuple):
    """A recording (M, N), where it was made, and the noise alone (M, K) if the localizer asks for
    it.
    """

    spot: Spot
    samples: Array
    noise: Array | None


def records(plan: Plan, rows: range) -> Array:
    """Return the records of the observations `rows` of a plan as a structured array, shape (B *
    R,).
    """
    heard = list(_observe(plan, rows))
    blocks = [[one] for one in heard] if _whitens(plan) else [heard]
    return np.concatenate([_records(plan, block) for block in blocks])


def _whitens(plan: Plan) -> bool:
    return bool(getattr(plan.localizer, "whiten", False))


def _records(plan: Plan, heard: Sequence[Heard]) -> Array:
    """Return the records of observations that share what is known of the noise."""
    scene, noise = plan.scene, heard[0].noise
    samples = np.stack([each.samples for each in heard])
    observation = Observation(samples, scene.probe, scene.array, scene.speed_of_sound)
    if noise is not None:
        psd, covariance = signals.noise_psd(noise), signals.noise_covariance(noise)
        observation = replace(observation, noise_psd=psd, noise_covariance=covariance)
    echoes, described = localize(observation, plan.localizer)
    spots = tuple(each.spot for each in heard)
    each_echo = tuple(spot for spot in spots for _ in range(echoes.toa.shape[1]))
    columns = described | _context(each_echo) | labels(spots, echoes, scene)
    dtype = [(name, value.dtype, value.shape[1:]) for name, value in columns.items()]
    table = np.empty(len(each_echo), dtype=dtype)
    for name, value in columns.items():
        table[name] = value
    return table


def _observe(plan: Plan, rows: range) -> Iterator[Heard]:
    """Yield what is heard for each row; rows of one position share its responses."""
    drawn = ((row, stream(plan.seed, "observation", row)) for row in rows)
    spots = ((row, plan.spot(row, rng), rng) for row, rng in drawn)
    for _, same in groupby(spots, key=lambda known: known[1].group):
        received = None
        for row, spot, rng in same:
            check_inside(spot.room, spot.pose, array=plan.scene.array)
            received = plan.scene.received(spot.room, spot.pose) if received is None else received
            samples = _record(received, plan.scene, spot, rng)
            yield Heard(spot, samples, _noise(plan, spot, row) if _whitens(plan) else None)


def _record(received: Array, scene: Scene, spot: Spot, rng: np.random.Generator) -> Array:
    return add_noise(received, scene, levels=spot.levels, rng=rng, gain_db=spot.gain_db)


def _noise(plan: Plan, spot: Spot, row: int) -> Array:
    """Return a recording of the noise alone, at the levels and the gain of one row."""
    rng = stream(plan.seed, "noise alone", row)
    alone = noise_alone(
        spot.room,
        spot.pose,
        scene=plan.scene,
        seconds=NOISE_SECONDS,
        levels=spot.levels,
        rng=rng,
    )
    return 10.0 ** (spot.gain_db / 20.0) * alone


def _context(spots: tuple[Spot, ...]) -> dict[str, Array]:
    return {
        "snr_db": np.array(
            [np.inf if spot.levels.snr_db is None else spot.levels.snr_db for spot in spots]
        ),
        **(
            {}
            if spots[0].levels.sdnr_db is None
            else {"sdnr_db": np.array([spot.levels.sdnr_db for spot in spots])}
        ),
        **(
            {}
            if spots[0].levels.pings == 1
            else {"pings": np.array([spot.levels.pings for spot in spots])}
        ),
        "gain_db": np.array([spot.gain_db for spot in spots]),
        "t60": np.array([spot.room.t60 for spot in spots]),
        "room": np.array([spot.room.size for spot in spots]),
        "position": np.array([spot.pose.position for spot in spots]),
        "heading": np.array([spot.pose.heading for spot in spots]),
        "group": np.array([spot.group for spot in spots]),
    }


def labels(spots: tuple[Spot, ...], echoes: Echoes, scene: Scene) -> dict[str, Array]:
    """Return the labels of echoes (B, R), heard at B spots: arrays of B * R rows, observation by
    observation.
    """
    shape, tolerance = echoes.toa.shape, TOA_TOLERANCE_SAMPLES / scene.probe.sample_rate
    truth, wall, on_map = (
        np.full((*shape, 6), np.nan),
        np.empty(shape, dtype=int),
        np.empty(shape, dtype=bool),
    )
    for row, spot in enumerate(spots):
        toa = true_echoes(
            spot.room, spot.pose, array=scene.array, speed_of_sound=scene.speed_of_sound
        ).toa
        truth[row, :, : len(toa)] = toa
        wall[row] = match_echoes(toa, echoes.toa[row], tolerance=tolerance)
        points = wall_points(
            echoes.toa[row],
            echoes.azimuth[row],
            echoes.elevation[row],
            position=spot.pose.position,
            heading=spot.pose.heading,
            array=scene.array,
            speed_of_sound=scene.speed_of_sound,
        )
        on_map[row] = distance_to_outline(points, outline(spot.room)) <= MAP_TOLERANCE
    ranks = np.broadcast_to(np.arange(shape[1]), shape)
    several = {"echo": ranks.ravel(), "wall": wall.ravel()} if shape[1] > 1 else {}
    known = {
        "reflector": wall.ravel() != UNMATCHED,
        "on_map": on_map.ravel(),
        "truth_toa": truth.reshape(-1, 6),
    }
    return known | several
