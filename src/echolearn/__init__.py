"""Decide which echoes a robot should believe.

A loudspeaker inside a microphone array emits a known noise burst. Estimators turn each recording
into a time of arrival (TOA) and a direction of arrival (DOA), hence a point on a map; a classifier
learns which of these points are real reflectors. The method is that of Saqib, Marchegiani and
Jensen, "A machine learning framework for acoustic reflector mapping"; `docs/paper.md` resolves what
the paper leaves open.

Conventions, valid everywhere:

- SI units; a quantity in another unit carries it in its name (`snr_db`, `lag_samples`).
- Axis letters: B observations, M microphones, N samples, T frames, F frequency bins, A azimuths, L
  lags, R echoes, W walls, P poses or points, K feature columns. Time is the last axis; "..." are
  leading batch axes.
- Azimuth is measured anticlockwise from the robot's heading, elevation from the array's axis (pi/2
  is in the array's plane). Rooms span [0, size] and walls are ordered x=0, x=max, y=0, y=max,
  floor, ceiling.
- Times of arrival are those at microphone 1, `array.positions[0]`, counted from the emission.
- The label `reflector` is True for a wall (the paper's class 0), False for a spurious estimate
  (class 1).

This module imports nothing that takes time, so `import echolearn` costs nothing; the names of
`PUBLIC` are loaded when they are first used (`docs/library.md`).
"""

import sys
from importlib import import_module

if sys.platform == "win32":
    # Locks, signals and limits of memory are those of POSIX.
    raise ImportError("echolearn needs Linux or macOS; on Windows, install it in WSL")

__version__ = "0.2.0"

PUBLIC = {
    "MicArray": "acoustics.types.MicArray",
    "Observation": "acoustics.types.Observation",
    "PolygonRoom": "acoustics.polygon_room.PolygonRoom",
    "Pose": "acoustics.types.Pose",
    "Room": "acoustics.types.Room",
    "filter": "cli.by_name.filter_named",
    "localize": "robot.by_name.localize_named",
    "open_bundle": "comparison.opening.bundle_named",
    "open_run": "comparison.opening.run_named",
    "open_set": "comparison.opening.set_named",
    "open_survey": "comparison.opening.survey_named",
    "plot": "comparison.plotting.plot",
    "simulate": "simulation.by_hand.simulate",
}
"""What `import echolearn as el` offers, and where each stands; `__init__.pyi` tells their types."""


def __getattr__(name: str) -> object:
    """Return a public name, loaded now."""
    if name not in PUBLIC:
        known = f"it has {', '.join(PUBLIC)}"
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; {known}")
    module, _, attribute = PUBLIC[name].rpartition(".")
    return getattr(import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    """Return the names that this module has or can load."""
    return sorted([*globals(), *PUBLIC])
