"""What a set holds of observations: a record per echo, simulated, localized, described, labelled.

    rows --plan--> spots --simulation--> recordings --localize--> echoes and their columns
         --context, labels--> structured array

A record has the columns and tensors of `localization.features`, those besides that its plan asks
for (`further`), the labels

- `reflector` (the paper's): |estimated - true TOA| < 10 samples for some reflecting wall; of
  several echoes of one observation no two for the same wall (`evaluation.matching`),
- `on_map`: the map point (TOA and DOA together) lies within 0.10 m of the room's outline,
- `time_and_direction`: time as for `reflector`, and within 10 degrees of that wall's direction, as
  far as the array tells it;
  derived when a set is read (`derived`), and held in rooms that are no boxes, and where the
  array's middle is not its loudspeaker,

and what the localizer did not know: SNR, gain, T60, room, pose, true TOAs, and `group`, the number
of the position, by which every split is made; SDNR only in sets with diffuse noise, pings only
where several are averaged.

Where a plan's localizer finds R > 1 echoes, an observation has R records one after the other,
strongest first, with the number `echo` from 0 and the `wall` that each was matched with, its place
in `truth_toa`, or -1.

Where it whitens, it is given a recording of the noise alone, made for each observation for itself.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.rooms import check_inside, outline, size_of, true_echoes
from echolearn.acoustics.signals import noise_covariance, noise_psd
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Observation
from echolearn.dataset import derived
from echolearn.dataset.plans import Plan, Spot
from echolearn.dataset.torch_filters import filters_of
from echolearn.evaluation.labelling import on_map
from echolearn.evaluation.matching import (
    TOA_TOLERANCE_SAMPLES,
    UNMATCHED,
    agree,
    match_echoes,
)
from echolearn.localization.columns import COLUMNS, TENSORS
from echolearn.localization.localize import localize
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.observe import NOISE_SECONDS, add_noise, noise_alone
from echolearn.simulation.scene import Scene


def records(plan: Plan, rows: range) -> Array:
    """Return the records of observations of a plan, a structured array of shape (B * R,).

    Args:
        plan: says what is observed.
        rows: numbers of the B observations; each depends on the plan and its own number alone.
    """
    # What is known of the noise differs from row to row, so such rows are localized one by one.
    if plan.localizer.whiten and len(rows) > 1:
        return np.concatenate([records(plan, range(row, row + 1)) for row in rows])

    observation, spots = recordings_of(plan, rows)
    names = (*COLUMNS, *TENSORS, *plan.further)
    echoes, columns = localize(
        observation, plan.localizer, names=names, filters=filters_of(plan.matched_filters)
    )
    estimates = np.stack([echoes.toa, echoes.azimuth, echoes.elevation], axis=-1)
    contexts = [_context(spot) for spot in spots]
    for name in contexts[0]:
        values = np.array([context[name] for context in contexts])
        columns[name] = np.repeat(values, estimates.shape[1], axis=0)
    known = labels(estimates, spots, plan=plan)
    columns |= {name: np.concatenate([each[name] for each in known]) for name in known[0]}
    return structured(columns)


def recordings_of(plan: Plan, rows: range) -> tuple[Observation, list[Spot]]:
    """Return what was recorded for some observations of a plan, and where each was made.

    Args:
        plan: says what is observed; one that whitens observes one row at a time.
        rows: numbers of the B observations.

    Returns:
        Samples (B, M, N) with what a localizer may know, and B spots.
    """
    scene = plan.scene
    spots: list[Spot] = []
    samples = np.empty((len(rows), len(scene.array), scene.probe.length))
    for number, row in enumerate(rows):
        rng = stream(plan.seed, "observation", row)
        spot = plan.spot(row, rng)
        real, spot = _real(spot, plan, row=row)

        # Responses take most of the time; successive rows of one position share them if they can.
        # Those of a walk have a group, too, but places of their own.
        own = spot.drawn or plan.poses > 1
        if own or not spots or spot.group != spots[-1].group:
            check_inside(spot.room, spot.pose, array=scene.array)
            received = real.received(spot.room, spot.pose)
        add_noise(
            received,
            real,
            levels=spot.levels,
            rng=rng,
            gain_db=spot.gain_db,
            out=samples[number],
        )
        spots.append(spot)

    observation = Observation(samples, scene.probe, scene.array, scene.speed_of_sound)
    if plan.localizer.whiten:
        rng = stream(plan.seed, "noise alone", rows[0])
        observation = _with_noise(observation, spots[0], scene=real, rng=rng)
    return observation, spots


def _real(spot: Spot, plan: Plan, *, row: int) -> tuple[Scene, Spot]:
    """Return the scene of a row with what is not ideal about it, and the spot that tells it."""
    if plan.realism.clean:
        return plan.scene, spot
    rng = stream(plan.seed, "realism", row)
    # One robot makes a walk: its parts are drawn at the first pose.
    first = row - row % plan.poses
    robot = None if plan.poses == 1 else stream(plan.seed, "realism", first)
    scene, drawn = realistic(plan.scene, plan.realism, rng=rng, robot=robot)
    return scene, replace(spot, gain_db=spot.gain_db + drawn["gain_db"], drawn=drawn)


def _with_noise(
    observation: Observation, spot: Spot, *, scene: Scene, rng: np.random.Generator
) -> Observation:
    """Return an observation with what a recording of the noise alone, made there, tells of it."""
    alone = noise_alone(
        spot.room, spot.pose, scene=scene, seconds=NOISE_SECONDS, levels=spot.levels, rng=rng
    )
    amplified = 10.0 ** (spot.gain_db / 20.0) * alone
    return replace(
        observation,
        noise_psd=noise_psd(amplified),
        noise_covariance=noise_covariance(amplified),
    )


def _context(spot: Spot) -> dict[str, Any]:
    """Return what the localizer did not know of an observation."""
    levels = spot.levels
    context: dict[str, Any] = {"snr_db": math.inf if levels.snr_db is None else levels.snr_db}
    if levels.sdnr_db is not None:
        context["sdnr_db"] = levels.sdnr_db
    if levels.pings > 1:
        context["pings"] = levels.pings
    context.update(spot.drawn)
    return context | {
        "gain_db": spot.gain_db,
        "t60": spot.room.t60,
        "room": size_of(spot.room),
        "position": spot.pose.position,
        "heading": spot.pose.heading,
        "group": spot.group,
    }


def labels(estimates: Array, spots: list[Spot], *, plan: Plan) -> list[dict[str, Array]]:
    """Return the labels of the echoes of each observation, arrays of R rows.

    Args:
        estimates: TOA in s, azimuth and elevation in rad of each echo, shape (B, R, 3).
        spots: where they were observed, B of them.
        plan: gives array, sample rate and speed of sound, and what all rows have in common.
    """
    points = wall_points(
        *np.moveaxis(estimates, -1, 0),
        position=np.array([spot.pose.position for spot in spots])[:, None],
        heading=np.array([spot.pose.heading for spot in spots])[:, None],
        array=plan.scene.array,
        speed_of_sound=plan.scene.speed_of_sound,
    )
    each = zip(estimates, points, spots, strict=True)
    return [_labels(found, at, spot=spot, plan=plan) for found, at, spot in each]


def _labels(estimates: Array, points: Array, *, spot: Spot, plan: Plan) -> dict[str, Array]:
    """Return the labels of the echoes of one observation, arrays of R rows.

    Args:
        estimates: of its echoes, shape (R, 3), as for `labels`.
        points: of the map, shape (R, 2), in m.
        spot: where it was made.
        plan: as for `labels`.
    """
    scene = plan.scene
    toa, azimuth, elevation = estimates.T
    true = true_echoes(spot.room, spot.pose, array=scene.array, speed_of_sound=scene.speed_of_sound)
    truth = true.toa
    tolerance = TOA_TOLERANCE_SAMPLES / scene.probe.sample_rate
    wall = match_echoes(truth, toa, tolerance=tolerance)
    padded = np.full(plan.most_echoes, np.nan)
    padded[: len(truth)] = truth
    found = {
        "reflector": wall != UNMATCHED,
        "on_map": on_map(points, outline(spot.room)),
        "truth_toa": np.tile(padded, (len(toa), 1)),
    }
    if scene.array.centre.any() or not plan.boxes:
        near = agree(true, azimuth=azimuth, elevation=elevation, array=scene.array)
        both = match_echoes(truth, toa, tolerance=tolerance, allowed=near)
        found[derived.NAME] = both != UNMATCHED
    return found | {"echo": np.arange(len(toa)), "wall": wall} if len(toa) > 1 else found


def structured(columns: Mapping[str, Array]) -> Array:
    """Return columns of equal length as one structured array, a field for each."""
    fields = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    table = np.empty(len(columns["toa"]), dtype=fields)
    for name, column in columns.items():
        table[name] = column
    return table
