"""What a set of walks holds: matched filters, poses and the truth, a record per walk.

    walk --simulation--> recordings (M, N) --matched filter--> r_m over the window, float16

- `outputs`: r_m over the lags that `walls.walk.lags_needed` returns, shape (P, M, L), each pose
  over its root mean square, which is all that evidence looks at. float16 is exact to 5e-4, far
  below the noise, and a quarter of the size.
- `told`: x, y, heading by odometry, in its own frame, shape (P, 3); `poses`: the true ones, x, y,
  z, heading, shape (P, 4).
- `sides`: walls of the floor plan, without doors, shape (S, 2, 2), NaN where there are fewer.
- `snr_db`, `t60`, `path`, `stride`, `odometry`, `odometry_error`, and `group`, the walk's number.

A record depends on the plan's seed and its own number alone.
"""

import numpy as np

from echolearn.acoustics.rooms import check_inside, outline
from echolearn.acoustics.signals import matched_filter
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Pose
from echolearn.dataset.walk_plan import Stroll, WalkPlan
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.observe import add_noise
from echolearn.walls.walk import lags_needed

LONGEST_NAME = 16
"""Bytes of a name in a record."""


def walk_records(plan: WalkPlan, rows: range) -> Array:
    """Return the records of some walks of a plan, a structured array of shape (B,).

    Args:
        plan: says what is walked.
        rows: numbers of the B walks.
    """
    table = np.empty(len(rows), dtype=record_type(plan))
    for record, row in zip(table, rows, strict=True):
        rng = stream(plan.seed, "observation", row)
        stroll = plan.stroll(rng)
        record["outputs"] = _outputs(plan, stroll, row=row, rng=rng)
        # Rooms have different numbers of sides, records one shape.
        sides = outline(stroll.room)
        record["sides"] = np.nan
        record["sides"][: len(sides)] = sides
        known = {"told": stroll.told, "poses": stroll.poses, "snr_db": stroll.snr_db}
        known |= {"t60": stroll.room.t60, "group": row, **stroll.drawn}
        for name, value in known.items():
            record[name] = value
    return table


def record_type(plan: WalkPlan) -> np.dtype:
    """Return the type of a plan's records."""
    scene = plan.scene
    first, last = _lags(plan)
    text = f"S{LONGEST_NAME}"
    numbers = ("snr_db", "t60", "stride", "odometry_error")
    return np.dtype(
        [
            ("outputs", np.float16, (plan.poses, len(scene.array), last - first + 1)),
            ("told", np.float64, (plan.poses, 3)),
            ("poses", np.float64, (plan.poses, 4)),
            ("sides", np.float64, (plan.most_sides, 2, 2)),
            *((name, np.float64) for name in numbers),
            ("path", text),
            ("odometry", text),
            ("group", np.int64),
        ]
    )


def _outputs(plan: WalkPlan, stroll: Stroll, *, row: int, rng: np.random.Generator) -> Array:
    """Return the matched filters of a walk, each pose over its root mean square, (P, M, L).

    Args:
        plan: of the set.
        stroll: the walk.
        row: its number.
        rng: draws the noise.
    """
    scene = plan.scene
    first, last = _lags(plan)
    levels = NoiseLevels(stroll.snr_db)
    found = []
    for number, (x, y, z, heading) in enumerate(stroll.poses):
        pose = Pose(np.array([x, y, z]), float(heading))
        check_inside(stroll.room, pose, array=scene.array)
        # The same robot all along its walk; walls and clutter are drawn anew at every pose.
        robot = stream(plan.seed, "realism", row)
        around = stream(plan.seed, "realism", row, number)
        real, drawn = realistic(scene, plan.realism, rng=around, robot=robot)
        received = real.received(stroll.room, pose)
        gain_db = drawn.get("gain_db", 0.0)
        samples = add_noise(received, real, levels=levels, rng=rng, gain_db=gain_db)
        outputs = matched_filter(samples, scene.probe, first=first, last=last)
        found.append(outputs / np.sqrt(np.mean(np.square(outputs))))
    return np.array(found)


def _lags(plan: WalkPlan) -> tuple[int, int]:
    """Return the first and the last lag that is kept."""
    rate, speed = plan.scene.probe.sample_rate, plan.scene.speed_of_sound
    return lags_needed(plan.window, plan.scene.array, sample_rate=rate, speed_of_sound=speed)
