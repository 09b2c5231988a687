"""Rooms of any outline beside pyroomacoustics, and what they cost: `python tests/polyhedra.py`.

For each room: how many images up to an order both have, and the largest differences of their times
and amplitudes; the T60 of all images' decay beside that of pyroomacoustics' ray tracing, whose rays
know no images; and the time of a response beside that of a box with as much floor and height.
"""

import math
import time
from dataclasses import replace
from pathlib import Path
from sys import path

import numpy as np

path.insert(0, str(Path(__file__).parent / "simulation"))

from test_beams import (  # noqa: E402
    MICROPHONES,
    ROOMS,
    SOURCE,
    images_of,
    in_order,
    polyhedron,
    their_images,
)

from echolearn.acoustics.geometry import circular_array, microphone_positions  # noqa: E402
from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom  # noqa: E402
from echolearn.acoustics.types import Array, Pose, Room  # noqa: E402
from echolearn.simulation.rir.images import Images, lattice  # noqa: E402
from reference import RATE, SPEED  # noqa: E402

HIGHEST = 5
EARLY = 0.02
"""s; rays that meet a microphone near the loudspeaker make no sense."""

DECAY_DB = (-5.0, -35.0)


def differences(room: PolygonRoom) -> tuple[int, float, float]:
    """Return the number of images, and the largest differences in us and in parts of a million."""
    times, gains, count = [0.0], [0.0], 0
    for microphone, theirs in zip(MICROPHONES, their_images(room, highest=HIGHEST), strict=True):
        ours = in_order(images_of(room, microphone, highest=HIGHEST))
        theirs = in_order(theirs)
        assert len(ours) == len(theirs)
        count += len(ours)
        times.append(np.abs(np.sqrt(ours[:, 0]) - np.sqrt(theirs[:, 0])).max() / SPEED * 1e6)
        gains.append(np.abs(ours[:, 1] / theirs[:, 1] - 1.0).max() * 1e6)
    return count, max(times), max(gains)


def decay(energy: Array) -> Array:
    """Return the energy that is still to come, in dB of all (Schroeder)."""
    left = np.cumsum(energy[::-1])[::-1]
    return 10.0 * np.log10(left / left[0] + 1e-30)


def reverberation(energy: Array, step: float) -> float:
    """Return T60 in s, of a line through the decay from -5 to -35 dB."""
    level = decay(np.where(np.arange(len(energy)) * step > EARLY, energy, 0.0))
    inside = (level < DECAY_DB[0]) & (level > DECAY_DB[1])
    slope, _ = np.polyfit(step * np.flatnonzero(inside), level[inside], 1)
    return -60.0 / float(slope)


def energies(room: PolygonRoom) -> Array:
    """Return the energy of the images at the second microphone, by the sample."""
    given = {"scale": 1.0, "reflection": room.reflection(SPEED), "reach": room.t60 * SPEED}
    _, plan, upright = lattice(room, SOURCE, microphones=MICROPHONES[1:2], **given)
    square = plan[0, 0, :, None] + upright[0, 0]
    gain = plan[0, 1, :, None] * upright[0, 1]
    heard = square < given["reach"] ** 2
    at = (np.sqrt(square[heard]) * RATE / SPEED).astype(int)
    return np.bincount(at, gain[heard] ** 2 / square[heard])


def rays(room: PolygonRoom) -> float:
    """Return T60 in s by pyroomacoustics' ray tracing, without scattering."""
    built = polyhedron(room, highest=0)
    built.set_ray_tracing(
        receiver_radius=0.3, n_rays=200_000, energy_thres=1e-9, time_thres=room.t60
    )
    built.add_source(SOURCE)
    built.add_microphone_array(MICROPHONES[1:2].T)
    built.image_source_model()
    built.ray_tracing()
    [energy] = built.rt_histograms[0][0][0]
    return reverberation(energy, built.rt_args["hist_bin_size"])


def seconds(room: AnyRoom) -> float:
    """Return the CPU time of a response to six microphones, the least of five."""
    pose = Pose(SOURCE, 0.3)
    places = microphone_positions(circular_array(), pose)
    taken = []
    for _ in range(6):
        start = time.process_time()
        Images()(room, SOURCE, microphones=places, sample_rate=RATE, speed_of_sound=SPEED)
        taken.append(time.process_time() - start)
    return min(taken[1:])


def main() -> None:
    """Print a line for each room."""
    whole = {"an L whose walls are alike": replace(ROOMS["an L"], walls=())}
    for name, room in (ROOMS | whole).items():
        count, late, loud = differences(room)
        print(f"{name}, {room.dimensions}, T60 {room.t60:g} s")
        print(f"  {count} images up to order {HIGHEST} in both:", end=" ")
        print(f"times within {late:.2g} us, amplitudes within {loud:.2g} ppm")
        found = reverberation(energies(room), 1 / RATE)
        print(f"  T60 of the decay {found:.3f} s, of ray tracing {rays(room):.3f} s")
        side = math.sqrt(room.area)
        box = Room((side, side, room.height), room.t60)
        polygon, cuboid = seconds(room), seconds(box)
        print(f"  a response {1e3 * polygon:.0f} ms, in a box as large {1e3 * cuboid:.0f} ms")


if __name__ == "__main__":
    main()
