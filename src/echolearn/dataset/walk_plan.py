"""A plan of walks: what a robot hears along paths that know nothing of the walls around them.

    path --room around it--> room, true poses --odometry--> told poses --simulation--> recordings

One row is a walk. The path is drawn first, then the room around it, each side at a distance of its
own (`drawn_rooms`); only `spiral`, the walk of `simulation.walk`, follows walls, so that what that
gives away can be measured. Where a room is given, the path wanders through it at the margins.
"""

from dataclasses import dataclass, field

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import size_of
from echolearn.acoustics.types import Array, Room
from echolearn.checks import Range, check, check_fields, check_list, check_name, check_range
from echolearn.dataset.drawn_rooms import CLEARANCE, OUTLINES, room_around
from echolearn.dataset.roles import ROLES
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.odometry import MODELS, in_own_frame, told_poses, turned_path
from echolearn.simulation.paths import PATHS, wandering
from echolearn.simulation.realism import Realism
from echolearn.simulation.scene import Scene
from echolearn.simulation.walk import CLEARANCE as NEAREST
from echolearn.simulation.walk import LEAST, WEAVE, trajectory

SPIRAL = "spiral"
"""The path that follows walls."""

RANGES: dict[str, Range] = {
    "seed": (0, 10**9),
    "rows": (1, 10**6, "walks"),
    "poses": (2, 10_000),
    "shard_rows": (1, 256, "walks"),
}
"""Least and largest value of a field that is a whole number."""

DRAWN: dict[str, Range] = {
    "extent": (0.5, 50.0, "m"),
    "stride": (0.01, 2.0, "m"),
    "margin": (CLEARANCE, 20.0, "m"),
    "height": (2.0, 20.0, "m"),
    "t60": (0.01, 10.0, "s"),
    "wall_factor": (0.0, 1.0, ""),
    "snr_db": (-100.0, 100.0, "dB"),
    "odometry_error": (0.0, 1.0, "m"),
}
"""Bounds of a field that is a range from which each walk draws."""


@dataclass(frozen=True)
class Stroll:
    """One walk to be made.

    Attributes:
        room: the room.
        poses: true x, y, z in m and heading in rad, shape (P, 4).
        told: x, y in m and heading in rad as the odometry tells them, shape (P, 3).
        snr_db: SNR of every recording.
        drawn: what else was drawn, by name.
    """

    room: AnyRoom
    poses: Array
    told: Array
    snr_db: float
    drawn: dict[str, str | float]


@dataclass(frozen=True)
class WalkPlan:
    """Random walks in random rooms: what classifiers of walls are trained on.

    Attributes:
        name: names the set's folder.
        seed: seed of everything random in the set.
        rows: number of walks; each has its own path, room and odometry.
        poses: number P of poses of a walk, one recording at each.
        paths: ways to draw a path, of `simulation.paths.PATHS`, and spiral; each walk draws one.
        rooms: outlines, of `drawn_rooms.OUTLINES`; each walk draws one.
        odometry: models of `simulation.odometry`; each walk draws one.
        odometry_error: range of the size of its errors, in m.
        extent: range of each side of the rectangle that a path keeps to, in m.
        stride: range of the way from pose to pose, in m.
        margin: range of the distance from the path to each side of the room, in m.
        height: range of the room's height, in m.
        t60: range in s.
        wall_factor: range of the factor on each wall's reflection coefficient.
        snr_db: range of a uniform SNR, one for each walk.
        window: distances of walls of which the matched filters are kept.
        scene: what the robot carries.
        shard_rows: walks stored in one file.
        role: what the set is for, see `roles.ROLES`; no row depends on it.
        realism: ranges of what is not ideal; the robot is drawn once for a walk, all else anew at
            every pose.
        room: the room of all walks, or None to draw one for each; `margin[0]` is then the distance
            that paths keep from its box, and `rooms`, `extent`, `height`, `t60`, `wall_factor` are
            not looked at.
    """

    name: str
    seed: int
    rows: int
    poses: int
    paths: tuple[str, ...]
    rooms: tuple[str, ...]
    odometry: tuple[str, ...]
    odometry_error: tuple[float, float]
    extent: tuple[float, float]
    stride: tuple[float, float]
    margin: tuple[float, float]
    height: tuple[float, float]
    t60: tuple[float, float]
    wall_factor: tuple[float, float]
    snr_db: tuple[float, float]
    window: SearchWindow
    scene: Scene
    shard_rows: int = 4
    role: str = "training"
    realism: Realism = field(default=Realism())
    room: AnyRoom | None = None

    def __post_init__(self) -> None:
        check_name("plan.name", self.name)
        check(self.role in ROLES, "plan.role", self.role, allowed=f"must be {' or '.join(ROLES)}")
        check_fields("plan", self, ranges=RANGES)
        for name, bounds in DRAWN.items():
            check_range(f"plan.{name}", getattr(self, name), bounds=bounds)
        known = {"paths": (*PATHS, SPIRAL), "rooms": tuple(OUTLINES), "odometry": MODELS}
        for name, names in known.items():
            self._set_names(name, names)
        self.realism.check_scene(self.scene)
        NoiseLevels(self.snr_db[0]).check_scene(self.scene)
        rate = self.scene.probe.sample_rate
        self.window.lags(self.scene.array, rate, speed_of_sound=self.scene.speed_of_sound)

    def _set_names(self, name: str, known: tuple[str, ...]) -> None:
        """Check a choice of names, and keep it as a tuple, so that a list is no other plan."""
        allowed = f"must be some of {', '.join(known)}, each once"
        check_list(f"plan.{name}", getattr(self, name), allowed=allowed)
        names = tuple(str(each) for each in getattr(self, name))
        once = 0 < len(names) == len(set(names)) and set(names) <= set(known)
        check(once, f"plan.{name}", f"[{', '.join(names)}]", allowed=allowed)
        object.__setattr__(self, name, names)

    def __len__(self) -> int:
        return self.rows

    @property
    def most_sides(self) -> int:
        """How many sides a room can have."""
        if isinstance(self.room, PolygonRoom):
            return len(self.room.faces[0])
        return max(OUTLINES[each] for each in self.rooms)

    def stroll(self, rng: np.random.Generator) -> Stroll:
        """Draw a walk."""
        kind = str(rng.choice(self.paths))
        stride = float(rng.uniform(*self.stride))
        if kind == SPIRAL:
            room, poses = self._along_walls(rng)
        elif self.room is not None:
            room, poses = self.room, self._through(self.room, kind, stride=stride, rng=rng)
        else:
            room, poses = self._path_first(kind, stride=stride, rng=rng)

        model = str(rng.choice(self.odometry))
        sigma = 0.0 if model == "exact" else float(rng.uniform(*self.odometry_error))
        plane = poses[:, [0, 1, 3]]
        own = in_own_frame(told_poses(plane, model=model, sigma=sigma, rng=rng), rng=rng)
        snr_db = float(rng.uniform(*self.snr_db))
        drawn: dict[str, str | float] = {
            "path": kind,
            "stride": stride,
            "odometry": model,
            "odometry_error": sigma,
        }
        return Stroll(room, poses, own, snr_db, drawn)

    def _path_first(
        self, kind: str, *, stride: float, rng: np.random.Generator
    ) -> tuple[AnyRoom, Array]:
        """Draw a path, then a room around it."""
        extent = rng.uniform(*self.extent, 2)
        path = PATHS[kind](self.poses, extent=extent, stride=stride, rng=rng)
        # However the robot's way lies to the walls: its passage may be oblique.
        path = turned_path(path, angle=rng.uniform(-np.pi, np.pi), shift=np.zeros(2))
        height = float(rng.uniform(*self.height))
        room, places = room_around(
            path[:, :2],
            str(rng.choice(self.rooms)),
            margin=self.margin,
            height=height,
            t60=float(rng.uniform(*self.t60)),
            wall_factor=self.wall_factor,
            rng=rng,
        )
        level = np.full(self.poses, height * rng.uniform(0.35, 0.65))
        return room, np.column_stack([places, level, path[:, 2]])

    def _through(
        self, room: AnyRoom, kind: str, *, stride: float, rng: np.random.Generator
    ) -> Array:
        """Draw a path through a given room, within the margin of its box."""
        length, width, height = size_of(room)
        margin = self.margin[0]
        inner = np.array([length, width]) - 2.0 * margin
        allowed = f"must leave a place in a room of {length:g} x {width:g} m"
        check(bool((inner > 0).all()), "plan.margin", f"{margin:g} m", allowed=allowed)
        draw = PATHS[kind] if kind != "corridor" else wandering
        path = draw(self.poses, extent=inner, stride=stride, rng=rng)
        level = np.full(self.poses, height / 2.0)
        return np.column_stack([path[:, :2] + margin, level, path[:, 2]])

    def _along_walls(self, rng: np.random.Generator) -> tuple[AnyRoom, Array]:
        """Draw a box, unless a room is given, and the spiral through it."""
        room = self.room
        if room is None:
            sides = np.maximum(rng.uniform(*self.extent, 2) + 2 * (NEAREST + WEAVE), LEAST)
            size = (*sides.tolist(), float(rng.uniform(*self.height)))
            least = 1.2 * Room(size, 10.0).shortest_t60()
            t60 = max(float(rng.uniform(*self.t60)), least)
            room = Room(size, t60, tuple(rng.uniform(*self.wall_factor, 6).tolist()))
        walk = trajectory(room, poses=self.poses, start=float(rng.uniform(-np.pi, np.pi)))
        return room, np.array([[*pose.position, pose.heading] for pose in walk])
