"""Draw what each departure of `realism=measured` does to sound, alone and all together.

    python docs/draw_realism.py [folder]           # runs/realism: realism.png, cost.csv

One robot at one place, each departure at the upper end of its range. For each: the steered response
J(tau, phi), what the array hears from where, with the true echoes as circles; the matched filter of
microphone 1; the spectrum of what it records. The costs are laps taken in turn with clean ones:
responses are everything up to the received probe and the direct path, records whole rows of a set.
"""

import csv
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from scipy import signal

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Pose, Room
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.dataset.records import records
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.observe import observe
from echolearn.simulation.realism import BOUNDS, Realism

GROUPS = {
    "rough walls": "spread scattering",
    "dull walls": "absorption_db",
    "clutter": "scatterers scatterer_radius",
    "microphones": "microphone_db microphone_ripple_db microphone_offset",
    "loudspeaker": "loudspeaker_low loudspeaker_high loudspeaker_ripple_db",
    "directivity": "directivity",
    "latency, residual": "latency_samples residual",
    "coloured noise": "coloured colour_hz",
}
"""The departures that are shown, and the keys of each."""

ROOM = Room((8.0, 6.0, 5.0), 0.6)
POSE = Pose(np.array([1.5, 2.2, 2.4]), 0.4)
LAPS = 30


def chosen() -> dict[str, Realism]:
    """Return the ranges of each line of the figure: one departure at its upper end, or all."""
    [(_, config)] = compose("generate", ["realism=measured"])
    measured = build(config["realism"], "realism")
    lines = {"clean": Realism()}
    for title, keys in GROUPS.items():
        ends = {key: getattr(measured, key)[1] for key in keys.split()}
        lines[title] = Realism(**{key: (end, end) for key, end in ends.items()})
    return lines | {"measured": measured}


def plan() -> Any:
    """Return the scattered plan, for whole rows and its scene."""
    [(_, config)] = compose("generate", ["plan=scattered"])
    return build(config["plan"], "plan")


def draw(lines: Mapping[str, Realism], scene: Any, path: Path) -> None:
    """Draw a row of pictures for each departure."""
    figure, axes = plt.subplots(len(lines), 3, figsize=(13, 2.2 * len(lines)), layout="tight")
    for row, (title, realism) in zip(axes, lines.items(), strict=True):
        there, drawn = realistic(scene, realism, rng=np.random.default_rng(1))
        levels = NoiseLevels(0.0 if title == "coloured noise" else 20.0)
        rng = np.random.default_rng(2)
        heard, truth = observe(ROOM, POSE, scene=there, levels=levels, rng=rng)
        single = replace(heard, samples=heard.samples[None])
        matched = MatchedFilter(single, SearchWindow(0.6, 4.0), azimuths=180)
        pictures(row, matched, truth)
        frequencies, density = signal.welch(heard.samples[0], fs=heard.probe.sample_rate)
        row[2].semilogx(frequencies[1:], 10 * np.log10(density[1:] / density.max()))
        row[2].set(ylim=(-60, 3), ylabel="dB", xlabel="Hz")
        row[0].set_title(title, loc="left", fontweight="bold")
    figure.savefig(path, dpi=70)


def pictures(row: Any, matched: MatchedFilter, truth: Any) -> None:
    """Draw the steered response with the truth, and the matched filter of microphone 1."""
    rate = matched.observation.probe.sample_rate
    first, last = matched.window.lags(matched.observation.array, rate)
    steered = np.abs(matched.steered[0][:180])
    extent = (first, last, -180, 180)
    # The root shows weak echoes beside strong ones.
    row[0].imshow(np.sqrt(steered), origin="lower", aspect="auto", extent=extent, cmap="magma")
    row[0].scatter(
        truth.toa * rate, np.degrees(truth.azimuth), s=90, facecolors="none", edgecolors="cyan"
    )
    row[0].set(xlim=(first, last), ylim=(-180, 180), ylabel="degrees")
    correlation = matched.correlation[0, 0]
    row[1].plot(np.arange(first, first + len(correlation)), correlation, linewidth=0.8)
    for toa in truth.toa * rate:
        row[1].axvline(toa, color="tab:red", linewidth=0.6)
    row[1].set(xlim=(first, last), yticks=[], xlabel="samples")


def costs(lines: Mapping[str, Realism], clean: Any) -> list[dict[str, Any]]:
    """Return the time of each departure over that of clean sound, for responses and records."""
    rows = []
    for title, realism in lines.items():
        real = replace(clean, realism=realism)
        steps = {
            "responses": (lambda row: respond(clean, row), lambda row, r=real: respond(r, row)),
            "records": (
                lambda row: records(clean, range(row, row + 1)),
                lambda row, r=real: records(r, range(row, row + 1)),
            ),
        }
        ratios = {name: round(paired(*both), 2) for name, both in steps.items()}
        rows.append({"departure": title} | ratios)
        print(*rows[-1].values(), sep="\t")
    return rows


def respond(plan: Any, row: int) -> None:
    """Compute the received probe of a row; the direct path too, where each row has its own."""
    spot = plan.spot(row, np.random.default_rng(row))
    scene, drawn = realistic(plan.scene, plan.realism, rng=np.random.default_rng(row))
    scene.received(spot.room, spot.pose)
    if drawn:
        _ = scene.direct


def paired(clean: Callable[[int], object], real: Callable[[int], object]) -> float:
    """Return the median ratio of times of two calls for the same row, taken in turn."""
    ratios = []
    for row in range(-2, LAPS):
        times = []
        for call in (clean, real):
            start = time.process_time()
            call(abs(row))
            times.append(time.process_time() - start)
        ratios.append(times[1] / times[0])
    # The first two have loops compiled and tables made.
    return float(np.median(ratios[2:]))


def main() -> None:
    """Write the figure and the table."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/realism")
    folder.mkdir(parents=True, exist_ok=True)
    assert {key for keys in GROUPS.values() for key in keys.split()} | {"gain_db"} == set(BOUNDS)
    assert {field.name for field in fields(Realism)} > set(BOUNDS)
    lines = chosen()
    scattered = plan()
    draw(lines, scattered.scene, folder / "realism.png")
    table = costs(lines, scattered)
    with (folder / "cost.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, table[0])
        writer.writeheader()
        writer.writerows(table)
    print(folder)


if __name__ == "__main__":
    main()
