"""How often are planted faults found? `python tests/planted_faults.py [walks of each] [fault ...]`.

Sound walks (`sound_walks.py`) are spoiled in one way each, at levels from 40 to -10 dB, with white
noise or under rotors. Printed is in how many of them the fault is named by its own word, mended or
refused, and in how many something else is said; the rest is silent. What sound walks are accused
of, `sound_walks.py` counts.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey.examining import examine
from echolearn.survey.mending import taken_off
from recorded_walks import PROBE, write
from sound_walks import drawn

LEVELS = (40, 20, 10, 0, -10)

Spoil = Callable[[Array, np.random.Generator], Array]


class Fault(NamedTuple):
    """A fault that is planted.

    Attributes:
        direct: whether the recordings hold the direct path.
        spoil: spoils recordings (P, M, N).
        words: one of which names it.
        poses: of the walks: fewest, and more than most.
    """

    direct: bool
    spoil: Spoil
    words: tuple[str, ...]
    poses: tuple[int, int] = (8, 25)


def lost(walk: Array, rng: np.random.Generator) -> Array:
    """Lose a buffer of one recording while the direct path arrives, silence at its end."""
    walk = walk.copy()
    count = int(rng.choice([64, 128, 256, 512, 1024]))
    place = int(rng.uniform(0.1, 0.9) * len(PROBE.samples))
    pose = rng.integers(len(walk))
    rest = walk[pose, :, place + count :]
    walk[pose, :, place:] = np.pad(rest, ((0, 0), (0, count)))
    return walk


def wrapped(walk: Array, rng: np.random.Generator) -> Array:
    """Let the loudest samples come out at the other end of the range."""
    return (rng.uniform(1.1, 1.5) / np.abs(walk).max() * walk + 1) % 2 - 1


def exchanged(walk: Array, rng: np.random.Generator) -> Array:
    """Exchange two microphones, from the beginning or from some recording on."""
    walk = walk.copy()
    pair = rng.choice(walk.shape[1], 2, replace=False)
    start = int(rng.choice([0, len(walk) // 2]))
    walk[start:, pair] = walk[start:, pair[::-1]]
    return walk


def late(walk: Array, rng: np.random.Generator) -> Array:
    """Begin all recordings late, each by another lag."""
    lags = rng.integers(1, 400, len(walk))
    return np.stack([taken_off(each, -lag) for each, lag in zip(walk, lags, strict=True)])


def one_late(walk: Array, rng: np.random.Generator) -> Array:
    """Delay one channel by a few samples."""
    walk = walk.copy()
    m = rng.integers(walk.shape[1])
    walk[:, m] = taken_off(walk[:, m], -float(rng.integers(1, 20)))
    return walk


def turned(walk: Array, rng: np.random.Generator) -> Array:
    """Turn the sign of one channel."""
    walk = walk.copy()
    walk[:, rng.integers(walk.shape[1])] *= -1
    return walk


def leaking(walk: Array, rng: np.random.Generator) -> Array:
    """Let one channel leak into another."""
    mixing = np.eye(walk.shape[1])
    first, second = rng.choice(walk.shape[1], 2, replace=False)
    mixing[first, second] = rng.uniform(0.15, 0.5)
    return mixing @ walk


FAULTS = {
    "buffer lost": Fault(True, lost, ("lost within", "missing in")),
    "wrapped": Fault(True, wrapped, ("overflowed",)),
    "wrapped, removed": Fault(False, wrapped, ("overflowed",)),
    "exchanged": Fault(False, exchanged, ("changed places",), (24, 41)),
    "exchanged, present": Fault(True, exchanged, ("changed places",), (24, 41)),
    "late": Fault(True, late, ("later than geometry", "taken off")),
    "one channel late": Fault(True, one_late, ("direct path at microphone",)),
    "one turned": Fault(True, turned, ("wired the other way",)),
    "one turned, removed": Fault(False, turned, ("wired the other way",)),
    "leaking": Fault(False, leaking, ("crosstalk",)),
}


def said_of(fault: Fault, seed: int, *, snr_db: float, rotors: bool) -> list[str]:
    """Draw a walk, plant a fault, and return what is said of it."""
    walk, poses = drawn(seed, snr_db=snr_db, rotors=rotors, direct=fault.direct, poses=fault.poses)
    spoilt = fault.spoil(walk, np.random.default_rng(seed + 1))
    with tempfile.TemporaryDirectory() as folder:
        found = examine(write(Path(folder), spoilt, direct=fault.direct, poses=poses))
    return [*found.refused, *found.mended, *found.noticed]


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    print(f"of {count} walks each: named, something else said")
    levels = "".join(f"{f'{level} dB':>10}" for level in LEVELS)
    print(f"{'fault':20} {'noise':8}{levels}")
    for name in sys.argv[2:] or FAULTS:
        fault = FAULTS[name]
        for rotors in (False, True):
            cells = []
            for level, snr_db in enumerate(LEVELS):
                seeds = [1000 * level + each for each in range(count)]
                said = [said_of(fault, seed, snr_db=snr_db, rotors=rotors) for seed in seeds]
                named = [any(w in line for line in lines for w in fault.words) for lines in said]
                other = sum(bool(lines) and not n for lines, n in zip(said, named, strict=True))
                cells.append(f"{sum(named):>7},{other:>2}")
            print(f"{name:20} {'rotors' if rotors else 'white':8}{''.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
