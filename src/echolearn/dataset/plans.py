"""Plans: where the robot stands for each row of a set, how loud the noise is, what it carries.

A plan has `name`, `seed`, `window`, `scene`, `localizer`, `shard_rows`, a length and `spot(row,
rng)`. `GridPlan` is the paper's regular grid; `ScatteredPlan` draws rooms, positions,
reverberation, noise and gain at random. On a 0.5 m grid only three wall distances ever fall into
the search window, so a classifier can memorise times of arrival instead of judging echoes;
scattered positions leave nothing to memorise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echolearn.acoustics.geometry import SearchWindow, check_inside
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import BadValue, check, check_list, check_name, check_number, check_whole
from echolearn.localization.localizer import Localizer
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.scene import Scene

ROLES = ("training", "grid", "test")
"""What a set is for: `training`, what classifiers should be trained on; `grid`, positions on a grid,
as in the paper, where few distances from the walls can be memorised; `test`, for tests alone."""


@dataclass(frozen=True)
class Spot:
    """One observation to be made: where, how loud the noises are (None: absent), and which position
    it belongs to.
    """

    room: Room
    pose: Pose
    levels: NoiseLevels
    group: int
    gain_db: float = 0.0


@dataclass(frozen=True)
class GridPlan:
    """Positions on a regular grid in one room: the paper's training set.

    Attributes:
        name: names the set's folder.
        seed: of everything random in the set.
        room: the room.
        step: of the grid, in m.
        margin: from every wall to the grid, in m.
        height: of a single layer in m, or None for layers at every step.
        snr_db: range of a uniform SNR per row, or None where `snr_levels` is given or there is no
            sensor noise.
        snr_levels: SNRs that every position is heard at, or None.
        window: where echoes are sought.
        scene: what the robot carries.
        localizer: estimates the echoes.
        shard_rows: rows stored in one file.
        sdnr_db: range of a uniform SDNR per row if the scene has diffuse noise, else None.
        pings: how many recordings are averaged for each row; the levels are those of one.
        role: what the set is for, see `ROLES`; no row depends on it.
    """

    name: str
    seed: int
    room: Room
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

    def __post_init__(self) -> None:
        _check_common(self)
        check_number(
            "plan.step",
            self.step,
            low=0.01,
            high=100.0,
            unit="m",
            hint="the paper's grid has 0.5 m",
        )
        check_number("plan.margin", self.margin, low=0.0, high=min(self.room.size) / 2, unit="m")
        if self.height is not None:
            check_number("plan.height", self.height, low=0.0, high=self.room.size[2], unit="m")
        both = f"{self.snr_db}, plan.snr_levels={self.snr_levels}"
        alone = self.snr_db is None or self.snr_levels is None
        check(alone, "plan.snr_db", both, allowed="one of the two, the other null")
        if self.snr_db is not None:
            check_range("plan.snr_db", self.snr_db, low=-100.0, high=100.0, unit="dB")
        for level in self.snr_levels or ():
            check_number("plan.snr_levels", level, low=-100.0, high=100.0, unit="dB")
        _check_levels(self, self.snr_db or self.snr_levels)
        check_inside(self.room, Pose(self.positions[0]), array=self.scene.array)

    @cached_property
    def positions(self) -> Array:
        """Positions of the grid, shape (P, 3), in m, z fastest."""
        steps = [int((side - 2 * self.margin) / self.step + 1e-9) for side in self.room.size]
        axes = [self.margin + self.step * np.arange(count + 1) for count in steps]
        if self.height is not None:
            axes[2] = np.array([self.height])
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

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
    """Random positions and headings in random rooms: what classifiers should be trained and tested
    on.

    Attributes:
        name: names the set's folder.
        seed: of everything random in the set.
        rows: observations; each has its own room and position.
        size_low, size_high: room sizes are uniform between these, in m; equal for one room.
        t60: range in s.
        wall_factor: range of the factor on each wall's reflection coefficient.
        margin: from every wall to the loudspeaker, in m.
        snr_db: range of a uniform SNR, or None for no sensor noise.
        gain_db: range of a uniform gain of the recording.
        window: where echoes are sought.
        scene: what the robot carries.
        localizer: estimates the echoes.
        shard_rows: rows stored in one file.
        sdnr_db: range of a uniform SDNR if the scene has diffuse noise, else None.
        pings: how many recordings are averaged for each row; the levels are those of one.
        role: what the set is for, see `ROLES`; no row depends on it.
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

    def __post_init__(self) -> None:
        _check_common(self)
        check_whole("plan.rows", self.rows, low=1)
        check_list("plan.size_low", self.size_low, length=3, allowed="three lengths in m")
        check_list("plan.size_high", self.size_high, length=3, allowed="three lengths in m")
        for low, high in zip(self.size_low, self.size_high, strict=True):
            check_range("plan.size_low", (low, high), low=0.5, high=200.0, unit="m")
        check_range("plan.t60", self.t60, low=0.01, high=10.0, unit="s")
        check_range("plan.wall_factor", self.wall_factor, low=0.0, high=1.0)
        if self.snr_db is not None:
            check_range("plan.snr_db", self.snr_db, low=-100.0, high=100.0, unit="dB")
        _check_levels(self, self.snr_db)
        check_range("plan.gain_db", self.gain_db, low=-100.0, high=100.0, unit="dB")
        radius = self.scene.array.radius
        hint = f"the array's radius is {radius:g} m"
        check_number(
            "plan.margin", self.margin, low=radius, high=min(self.size_low) / 2, unit="m", hint=hint
        )
        for size in (self.size_low, self.size_high):
            Room(size, self.t60[0])

    def __len__(self) -> int:
        return self.rows

    def spot(self, row: int, rng: np.random.Generator) -> Spot:
        """Return what row number `row` observes; `rng` draws what is random about it."""
        size = rng.uniform(self.size_low, self.size_high)
        room = Room(tuple(size), rng.uniform(*self.t60), tuple(rng.uniform(*self.wall_factor, 6)))
        position = rng.uniform(self.margin, size - self.margin)
        heading = rng.uniform(-np.pi, np.pi)
        snr_db = _uniform(self.snr_db, rng)
        gain_db = rng.uniform(*self.gain_db)
        levels = NoiseLevels(snr_db, _uniform(self.sdnr_db, rng), self.pings)
        return Spot(room, Pose(position, heading), levels, row, gain_db)


Plan = GridPlan | ScatteredPlan


def check_range(
    name: str, limits: tuple[float, float], *, low: float, high: float, unit: str = ""
) -> None:
    """Raise `BadValue` unless `limits` are two ordered numbers within [low, high]."""
    check_list(name, limits, length=2, allowed="two numbers, lowest first")
    for value in limits:
        check_number(name, value, low=low, high=high, unit=unit)
    check(
        limits[0] <= limits[1],
        name,
        list(limits),
        allowed="two numbers, lowest first",
        hint="are they swapped?",
    )


def _uniform(limits: tuple[float, float] | None, rng: np.random.Generator) -> float | None:
    """Draw a number, or nothing where there are no limits."""
    return None if limits is None else rng.uniform(*limits)


def _check_common(plan: Plan) -> None:
    check_name("plan.name", plan.name)
    check_whole("plan.seed", plan.seed, low=0)
    check(plan.role in ROLES, "plan.role", plan.role, allowed=f"one of {', '.join(ROLES)}")
    check_whole("plan.shard_rows", plan.shard_rows, low=1, high=4096, unit="rows")
    if plan.sdnr_db is not None:
        check_range("plan.sdnr_db", plan.sdnr_db, low=-100.0, high=100.0, unit="dB")
    scene = plan.scene
    rate = scene.probe.sample_rate
    plan.window.lags(scene.array, rate, speed_of_sound=scene.speed_of_sound)


def _check_levels(plan: Plan, snr_db: Sequence[float] | None) -> None:
    """Raise `BadValue` unless the plan's noises fit its scene: one of its rows speaks for all."""
    snr_db, sdnr_db = ((levels or (None,))[0] for levels in (snr_db, plan.sdnr_db))
    try:
        NoiseLevels(snr_db, sdnr_db, plan.pings).check_scene(plan.scene)
    except BadValue as error:
        raise BadValue(f"plan.{error}") from None
