"""What a study is: localizers on the same recordings, while one thing of the scene is varied.

At each value all localizers are given the same recordings, in corners of the room or along walks
through it (`poses`), of one burst or of another at each position: what an estimator makes of noise
of few lines hangs on the burst. `accuracy` says which estimates count as right.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import check_inside
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import BadValue, check, check_list, check_number, check_whole
from echolearn.localization.localizer import Localizer
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.scene import Scene
from echolearn.storage.identity import LATER
from echolearn.studies.poses import PLACES, corner_pose, walk_poses
from echolearn.studies.recordings import FAULTS, Condition, Position

CHANCE = "chance"
VARIED = ("snr_db", "sdnr_db", "t60", "fault", "pings", "stretch", "array")
NAMED = ("fault", "array")
"""What has values that are names, in any order."""

BURSTS = ("one", "each")


@dataclass(frozen=True)
class Study:
    """What is varied, where, and how often.

    Attributes:
        vary: snr_db, sdnr_db, t60, fault, pings, stretch (of noise, one that all recordings
            share), or array.
        values: V values of what is varied, ascending; faults and arrays by name, stretches by
            number.
        room: a shoebox.
        scene: what the robot carries.
        localizers: localizers by name.
        snr_db: received probe over sensor noise unless varied; None is no sensor noise.
        sdnr_db: received probe over diffuse noise unless varied; None is no diffuse noise.
        walls: distances of the two nearest walls of every position in a corner, in m.
        window: search window from which `chance` draws.
        positions: number of positions.
        trials: recordings at each value, shared out evenly over the positions.
        seed: of positions and noise.
        bursts: one, that of the scene, or each: a burst of its own, as long, for every position.
        pings: recordings averaged unless varied, each at the levels above.
        places: corners or walk, see `poses`; a walk keeps its own distances from the walls.
        scenes: by the names of arrays, with vary=array; of each its array is taken.
    """

    vary: str
    values: Sequence[Any]
    room: AnyRoom
    scene: Scene
    localizers: Mapping[str, Localizer]
    snr_db: float | None = 40.0
    sdnr_db: float | None = None
    walls: tuple[float, float] = (1.0, 1.5)
    window: SearchWindow = SearchWindow()
    positions: int = 20
    trials: int = 100
    seed: int = 0
    bursts: str = "each"
    pings: int = 1
    places: str = "corners"
    scenes: Mapping[str, Scene] | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        for name, known in (("vary", VARIED), ("bursts", BURSTS), ("places", PLACES)):
            given = getattr(self, name)
            check(given in known, name, given, allowed=f"must be one of {', '.join(known)}")
        self._check_values()
        check(len(self.localizers) > 0, "localizers", "{}", allowed="must be at least one")
        hint = "tables and figures call the baseline so"
        free = CHANCE not in self.localizers
        check(free, "localizers", CHANCE, allowed="must have another name", hint=hint)
        check_list("walls", self.walls, length=2, allowed="must be two distances in m")
        for distance in self.walls:
            check_number("walls", distance, low=0.0, high=100.0, unit="m")
        check_whole("positions", self.positions, low=2, high=10_000, hint="intervals need several")
        hint = "each position has at least one"
        check_whole("trials", self.trials, low=self.positions, high=1_000_000, hint=hint)
        check_whole("seed", self.seed, low=0)
        self._check_room()

    def _check_values(self) -> None:
        check_list("values", self.values)
        values = list(self.values)
        check(len(values) > 0, "values", values, allowed="must be at least one value")
        for value in values:
            allowed = "must be numbers, or names with vary=fault or vary=array"
            check(isinstance(value, str | int | float), "values", value, allowed=allowed)
        check(len(set(values)) == len(values), "values", values, allowed="must be each value once")
        for value in values:
            self.condition(value)
        ascending = self.vary in NAMED or sorted(values) == values
        hint = "figures join them in turn"
        check(ascending, "values", values, allowed="must be in ascending order", hint=hint)

    def _check_room(self) -> None:
        walls = list(self.room.walls)
        allowed = "must have at least one wall that reflects"
        check(any(walls), "room.walls", walls, allowed=allowed)
        varied = (self.condition(value).array for value in self.values)
        arrays = {array or self.scene.array for array in varied}
        for pose, array in product(self.poses(), arrays):
            try:
                check_inside(self.room, pose, array=array)
            except BadValue as error:
                # The user gave distances, not this pose: the refusal has to name their key.
                at = f"places={self.places} puts the robot outside the room: {error}"
                raise BadValue(f"walls={list(self.walls)} m: {at}") from None

    def condition(self, value: Any) -> Condition:
        """Return what a value stands for.

        Raises:
            BadValue: out of range, a T60 that the room cannot have, an unknown fault.
        """
        levels = NoiseLevels(self.snr_db, self.sdnr_db, self.pings)
        usual = Condition(self.room, levels)
        if self.vary == "fault":
            allowed = f"must be names of faults: {', '.join(FAULTS)}"
            check(value in FAULTS, "values", value, allowed=allowed)
            varied = replace(usual, fault=FAULTS[value])
        elif self.vary == "array":
            scenes = self.scenes or {}
            allowed = f"must be names of scenes: {', '.join(scenes)}"
            check(value in scenes, "values", value, allowed=allowed)
            varied = replace(usual, array=scenes[value].array)
        elif self.vary == "t60":
            varied = replace(usual, room=replace(self.room, t60=value))
        elif self.vary == "stretch":
            check_whole("values", value, low=0, hint="stretches of noise go by number")
            varied = replace(usual, stretch=value)
        else:
            varied = replace(usual, levels=replace(levels, **{self.vary: value}))
        varied.levels.check_scene(self.scene)
        return varied

    def poses(self) -> list[Pose]:
        """Return where the robot stands, one pose per position."""
        if self.places == "walk":
            return walk_poses(self.room, count=self.positions, seed=self.seed)
        if not isinstance(self.room, Room):
            raise BadValue(f"places={self.places}: must be walk where the room is no box")
        return [
            corner_pose(self.room, walls=self.walls, seed=self.seed, number=number)
            for number in range(self.positions)
        ]

    def position(self, number: int, pose: Pose) -> Position:
        """Return a position of the study, with the burst that is emitted there."""
        if self.bursts == "one":
            return Position(number, pose, self.scene)
        probe = self.scene.probe
        seed = int(stream(self.seed, "burst", number).integers(10**9))
        burst = noise_probe(seed=seed, burst=len(probe.samples), length=probe.length).samples
        scene = replace(self.scene, probe=replace(probe, samples=burst))
        return Position(number, pose, scene)
