"""Plans: where the robot stands for each row of a set, how loud the noise is, what it carries.

A plan has `name`, `seed`, `role`, `window`, `scene`, `localizer`, `shard_rows`, `realism`,
`further`, `matched_filters`, `boxes`, `most_echoes`, a length and `spot(row, rng)`. `GridPlan` is
the paper's regular grid;
`ScatteredPlan` draws rooms, positions, reverberation, noise and gain at random. On a 0.5 m grid
only three wall distances ever fall into the search window, so a classifier can memorise times of
arrival instead of judging echoes; scattered positions leave nothing to memorise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import bounds, check_inside, inside, most_echoes, size_of
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import (
    BadValue,
    Range,
    check,
    check_choice,
    check_fields,
    check_list,
    check_name,
    check_number,
    check_range,
)
from echolearn.dataset.drawn_rooms import ECHOES, ROOMY, drawn_place, drawn_room
from echolearn.dataset.roles import ROLES
from echolearn.localization.columns import FURTHER
from echolearn.localization.localizer import Localizer
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.realism import Realism
from echolearn.simulation.scene import Scene
from echolearn.storage.identity import LATER

MATCHED_FILTERS = ("compiled", "cuda", "cpu")
"""What can compute matched filters: compiled transforms, or torch on one of its devices."""

RANGES: dict[str, Range] = {
    "seed": (0, 10**9),
    "rows": (1, 10**9),
    "shard_rows": (1, 4096, "rows"),
    "poses": (1, 10_000),
}
"""Least and largest value of a field that is a whole number."""

DECIBEL = (-100.0, 100.0, "dB")
DRAWN = {
    "t60": (0.01, 10.0, "s"),
    "wall_factor": (0.0, 1.0, ""),
    "snr_db": DECIBEL,
    "sdnr_db": DECIBEL,
    "gain_db": DECIBEL,
}
"""Bounds of a field that is a range from which each row draws."""


@dataclass(frozen=True)
class Spot:
    """One observation to be made.

    Attributes:
        room: the room.
        pose: where the robot stands in it.
        levels: levels of the noises, and how many recordings are averaged.
        group: number of the position, which several rows may share.
        gain_db: gain of the recording.
        drawn: what is not ideal about it, by name.
    """

    room: AnyRoom
    pose: Pose
    levels: NoiseLevels
    group: int
    gain_db: float = 0.0
    drawn: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class GridPlan:
    """Positions on a regular grid in one room: the paper's training set.

    Attributes:
        name: names the set's folder.
        seed: seed of everything random in the set.
        room: the room, a box or of any outline.
        step: distance of neighbouring positions, in m.
        margin: distance from every wall to the grid, in m.
        height: height of a single layer in m, or None for layers at every step.
        snr_db: range of a uniform SNR per row, or None where `snr_levels` is given or there is no
            sensor noise.
        snr_levels: SNRs at which every position is recorded, or None.
        window: where echoes are sought.
        scene: what the robot carries.
        localizer: estimates the echoes.
        shard_rows: rows stored in one file.
        sdnr_db: range of a uniform SDNR per row if the scene has diffuse noise, else None.
        pings: number of recordings averaged for each row; the levels are those of one.
        role: what the set is for, see `roles.ROLES`; no row depends on it.
        realism: ranges of what is not ideal; each row draws its own.
        further: names of what rows hold besides the columns and tensors of every set, of `FURTHER`.
        matched_filters: what computes them, of `MATCHED_FILTERS`.
    """

    name: str
    seed: int
    room: AnyRoom
    step: float
    margin: float
    window: SearchWindow
    scene: Scene
    localizer: Localizer
    height: float | None = None
    snr_db: tuple[float, float] | None = (-40.0, 40.0)
    snr_levels: tuple[float, ...] | None = None
    shard_rows: int = 64
    sdnr_db: tuple[float, float] | None = None
    pings: int = 1
    role: str = "grid"
    realism: Realism = field(default=Realism(), metadata=LATER)
    further: tuple[str, ...] = field(default=(), metadata=LATER)
    matched_filters: str = field(default="compiled", metadata=LATER)

    def __post_init__(self) -> None:
        hint = "the paper's grid has 0.5 m"
        check_number("plan.step", self.step, low=0.01, high=100.0, unit="m", hint=hint)
        size = size_of(self.room)
        check_number("plan.margin", self.margin, low=0.0, high=min(size) / 2, unit="m")
        if self.height is not None:
            check_number("plan.height", self.height, low=0.0, high=size[2], unit="m")
        both = f"{self.snr_db}, plan.snr_levels={self.snr_levels}"
        single = self.snr_db is None or self.snr_levels is None
        check(single, "plan.snr_db", both, allowed="must be null, or plan.snr_levels must be")
        for level in self.snr_levels or ():
            check_number("plan.snr_levels", level, low=-100.0, high=100.0, unit="dB")
        _check_common(self, self.snr_levels)
        allowed = "must leave at least one position off all walls"
        check(len(self.positions) > 0, "plan.margin", f"{self.margin:g} m", allowed=allowed)
        check_inside(self.room, Pose(self.positions[0]), array=self.scene.array)

    @cached_property
    def positions(self) -> Array:
        """Positions of the grid, shape (P, 3), in m, z fastest: of its box, those in the room."""
        low, _ = bounds(self.room)
        steps = [int((side - 2 * self.margin) / self.step + 1e-9) for side in size_of(self.room)]
        axes = [self.margin + self.step * np.arange(count + 1) for count in steps]
        if self.height is not None:
            axes[2] = np.array([self.height])
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + low
        if isinstance(self.room, Room):
            return grid
        away = distance_to_outline(grid[:, :2], self.room.faces[0])
        return grid[inside(self.room, grid) & (away >= self.margin - 1e-9)]

    @property
    def poses(self) -> int:
        """Successive rows of one walk: each is for itself."""
        return 1

    @property
    def boxes(self) -> bool:
        """Whether the room is a box."""
        return isinstance(self.room, Room)

    @property
    def most_echoes(self) -> int:
        """How many first-order echoes a place can have."""
        return most_echoes(self.room)

    def __len__(self) -> int:
        return len(self.positions) * len(self.snr_levels or (0,))

    def spot(self, row: int, rng: np.random.Generator) -> Spot:
        """Return what row number `row` observes; `rng` draws what is random about it."""
        levels = self.snr_levels
        group, level = divmod(row, len(levels)) if levels else (row, 0)
        snr_db = levels[level] if levels else _uniform(self.snr_db, rng)
        noise = NoiseLevels(snr_db, _uniform(self.sdnr_db, rng), self.pings)
        return Spot(self.room, Pose(self.positions[group]), noise, group)


@dataclass(frozen=True)
class ScatteredPlan:
    """Random positions and headings in random rooms: what classifiers should be trained on.

    Attributes:
        name: names the set's folder.
        seed: seed of everything random in the set.
        rows: number of observations; each has its own room and position.
        size_low, size_high: room sizes are uniform between these, in m; equal for one room.
        t60: range in s.
        wall_factor: range of the factor on each wall's reflection coefficient.
        margin: distance from every wall to the loudspeaker, in m.
        snr_db: range of a uniform SNR, or None for no sensor noise.
        gain_db: range of a uniform gain of the recording.
        window: where echoes are sought.
        scene: what the robot carries.
        localizer: estimates the echoes.
        shard_rows: rows stored in one file.
        sdnr_db: range of a uniform SDNR if the scene has diffuse noise, else None.
        pings: number of recordings averaged for each row; the levels are those of one.
        role: what the set is for, see `roles.ROLES`; no row depends on it.
        realism: ranges of what is not ideal; each row draws its own.
        further: names of what rows hold besides the columns and tensors of every set, of `FURTHER`.
        matched_filters: what computes them, of `MATCHED_FILTERS`.
        rooms: outlines, of `drawn_rooms.ECHOES`; each row draws one.
        poses: successive rows that share room, levels of noise, gain and robot, as the recordings
            of a walk do, each at a place of its own; 1 draws all of it for each row.
    """

    name: str
    seed: int
    rows: int
    size_low: tuple[float, float, float]
    size_high: tuple[float, float, float]
    t60: tuple[float, float]
    margin: float
    window: SearchWindow
    scene: Scene
    localizer: Localizer
    wall_factor: tuple[float, float] = (1.0, 1.0)
    snr_db: tuple[float, float] | None = (-40.0, 40.0)
    gain_db: tuple[float, float] = (0.0, 0.0)
    shard_rows: int = 64
    sdnr_db: tuple[float, float] | None = None
    pings: int = 1
    role: str = "training"
    realism: Realism = field(default=Realism(), metadata=LATER)
    further: tuple[str, ...] = field(default=(), metadata=LATER)
    matched_filters: str = field(default="compiled", metadata=LATER)
    rooms: tuple[str, ...] = field(default=("box",), metadata=LATER)
    poses: int = field(default=1, metadata=LATER)

    def __post_init__(self) -> None:
        for name, size in (("size_low", self.size_low), ("size_high", self.size_high)):
            check_list(f"plan.{name}", size, length=3, allowed="must be three lengths in m")
        for limits in zip(self.size_low, self.size_high, strict=True):
            check_range("plan.size_low", limits, bounds=(0.5, 200.0, "m"))
        _check_common(self)

        # Wherever it turns, the array must stay inside the smallest room, and a room must exist.
        low = self.scene.array.radius
        hint = f"the array's radius is {low:g} m"
        high = min(self.size_low) / 2
        check_number("plan.margin", self.margin, low=low, high=high, unit="m", hint=hint)
        for size in (self.size_low, self.size_high):
            Room(size, self.t60[0])
        self._set_rooms()

    def _set_rooms(self) -> None:
        """Check the outlines, and that there is a place in each."""
        check_list("plan.rooms", self.rooms, allowed=f"must be some of {', '.join(ECHOES)}")
        names = [str(each) for each in self.rooms]
        once = 0 < len(names) == len(set(names)) and all(each in ECHOES for each in names)
        allowed = f"must be some of {', '.join(ECHOES)}, each once"
        check(once, "plan.rooms", f"[{', '.join(names)}]", allowed=allowed)
        # As a tuple it equals the default, so that a list of boxes alone is no other plan.
        object.__setattr__(self, "rooms", tuple(names))
        if not self.boxes:
            high = ROOMY * min(self.size_low[:2])
            hint = f"of rooms {', '.join(names)} no more than {100 * ROOMY:g} % of a side"
            check_number("plan.margin", self.margin, low=0.0, high=high, unit="m", hint=hint)

    @property
    def boxes(self) -> bool:
        """Whether all rooms are boxes."""
        return self.rooms == ("box",)

    @property
    def most_echoes(self) -> int:
        """How many first-order echoes a place can have in any of the rooms."""
        return max(ECHOES[each] for each in self.rooms)

    def __len__(self) -> int:
        return self.rows

    def spot(self, row: int, rng: np.random.Generator) -> Spot:
        """Return what row number `row` observes; `rng` draws what is random about it."""
        walk = row // self.poses
        shared = rng if self.poses == 1 else stream(self.seed, "walk", walk)
        size = shared.uniform(self.size_low, self.size_high)
        t60 = shared.uniform(*self.t60)
        # Where there is nothing to choose nothing is drawn, as in plans of before.
        outline = self.rooms[shared.integers(len(self.rooms)) if len(self.rooms) > 1 else 0]
        room = drawn_room(outline, size, t60=t60, wall_factor=self.wall_factor, rng=shared)
        position = drawn_place(room, self.margin, rng=rng)
        heading = rng.uniform(-np.pi, np.pi)
        snr_db = _uniform(self.snr_db, shared)
        gain_db = shared.uniform(*self.gain_db)
        levels = NoiseLevels(snr_db, _uniform(self.sdnr_db, shared), self.pings)
        return Spot(room, Pose(position, heading), levels, walk, gain_db)


Plan = GridPlan | ScatteredPlan


def _check_common(plan: Plan, snr_levels: Sequence[float] | None = None) -> None:
    """Raise `BadValue` for what no plan can be."""
    check_name("plan.name", plan.name)
    check(plan.role in ROLES, "plan.role", plan.role, allowed=f"must be {' or '.join(ROLES)}")
    check_choice("plan.matched_filters", plan.matched_filters, *MATCHED_FILTERS)
    check_fields("plan", plan, ranges=RANGES)
    for name, limits in vars(plan).items():
        if name in DRAWN and limits is not None:
            check_range(f"plan.{name}", limits, bounds=DRAWN[name])

    _check_further(plan)
    plan.realism.check_scene(plan.scene)

    # One row speaks for all: either each has a noise at some level, or none has it.
    snr_db, *_ = plan.snr_db or snr_levels or (None,)
    sdnr_db, *_ = plan.sdnr_db or (None,)
    try:
        NoiseLevels(snr_db, sdnr_db, plan.pings).check_scene(plan.scene)
    except BadValue as error:
        raise BadValue(f"plan.{error}") from None
    rate = plan.scene.probe.sample_rate
    plan.window.lags(plan.scene.array, rate, speed_of_sound=plan.scene.speed_of_sound)


def _check_further(plan: Plan) -> None:
    """Raise `BadValue` unless a plan asks for what there is to ask for, once."""
    check_list("plan.further", plan.further, allowed="must be a list of names")
    unknown = [name for name in plan.further if name not in FURTHER]
    allowed = f"must be some of {', '.join(FURTHER)}"
    check(not unknown, "plan.further", unknown, allowed=allowed)
    names = tuple(dict.fromkeys(plan.further))
    # A list of a configuration and a tuple are one plan, of one identity.
    object.__setattr__(plan, "further", names)


def _uniform(limits: tuple[float, float] | None, rng: np.random.Generator) -> float | None:
    """Draw a number, or nothing where there are no limits."""
    return None if limits is None else rng.uniform(*limits)
