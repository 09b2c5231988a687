"""What measured sound says of the ranges of `realism=measured`.

    python docs/measured_ranges.py [page]     # prints the table; a page gets it between its markers

Read are the responses that come with echolearn (R3VIVAL, state 000: no panel absorbs), 30 places of
a loudspeaker 1.5 to 3 m from an octahedron of six microphones, and, where pyroomacoustics is there,
its tables of materials. The first 2.5 ms of the direct sound hold neither floor nor ceiling, so
they are what loudspeaker and microphone make of a pulse. Responses are divided by them,

    R(f) = H(f) conj D(f) / (|D(f)|^2 + 0.01 mean |D|^2),

D the mean direct sound of the six, and the microphones are aligned for the direction of a true echo
and averaged. An echo counts if none of another wall is within 1.5 ms of it; that of a panel's face
and of what lies behind it, up to a millisecond later, is one. Of it are measured the energies
within 0.2 ms of its crest and from there to 1 ms after it, less what the same stretches hold before
it, where there is clutter alone; and its spectrum, above 3 kHz and below, over that of the direct
sound. The same is measured of simulated rooms, so that ranges and slice can be compared.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.types import Array, MicArray, Pose, Probe, Room
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.simulation.imperfect_scene import realistic
from echolearn.simulation.noise.white import White
from echolearn.simulation.realism import Realism
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage.marked_page import Markers, write_between
from echolearn.survey.measured import Measurements, Response
from echolearn.survey.sources.r3vival import R3vival

MARKERS = Markers(
    "<!-- measured: written by `python docs/measured_ranges.py` -->",
    "<!-- end of measured -->",
    "page",
)
DIRECT = (-0.0005, 0.0025)
"""s about the direct sound that hold nothing else."""

ALONE = 0.0015
"""s about an echo in which there is no other true one, but of the same wall."""

BESIDE = np.deg2rad(10.0)
"""rad within which two true echoes are of one wall: the face of a panel and what lies behind it."""

CORE = 0.0002
SPREAD = 0.001
"""s about and after an echo's crest."""

CORNER = 3000.0
"""Hz above which sound counts as high, as in `realism.absorption_db`."""

AUDIBLE = (300.0, 9000.0)
"""Hz; below, 3 ms tell nothing, above, resampling has its filter."""


SHORT = 128
FINER = 16
"""Samples that hold the direct sound, and points between two of them at which its crest is read."""

OCTAVES = (125, 250, 500, 1000, 2000, 4000, 8000)
"""Hz, of the tables of materials."""


class Heard(NamedTuple):
    """One place of the loudspeaker.

    Attributes:
        response: what was measured there.
        direct: direct sound at each microphone, zero elsewhere, aligned, shape (6, size).
        whole: responses, as long, aligned for no direction, shape (6, size).
        rate: in Hz.
        speed: of sound, in m/s.
        positions: of the microphones, shape (6, 3), in m.
    """

    response: Response
    direct: Array
    whole: Array
    rate: float
    speed: float
    positions: Array


def heard(measured: Measurements) -> Iterator[Heard]:
    """Yield every place with its direct sound."""
    rate, speed = measured.sample_rate, measured.speed_of_sound
    positions = measured.array.positions
    for response in measured.responses:
        size = 2 * response.samples.shape[-1]
        whole = np.pad(response.samples, [(0, 0), (0, size - response.samples.shape[-1])])
        way = np.linalg.norm(response.loudspeaker - positions, axis=1)
        arrives = (response.emitted + way / speed) * rate
        # As if the sound had left at 1 ms, and all microphones were in the middle.
        aligned = moved(whole, 0.001 * rate - arrives)
        first, last = ((0.001 + edge) * rate for edge in DIRECT)
        inside = (np.arange(size) >= first) & (np.arange(size) < last)
        yield Heard(response, aligned * inside, whole, rate, speed, positions)


def moved(samples: Array, lags: Array) -> Array:
    """Return samples (M, K) later by lags (M,), around the end."""
    phase = np.exp(-2j * np.pi * lags[:, None] * np.fft.rfftfreq(samples.shape[-1]))
    return np.fft.irfft(np.fft.rfft(samples) * phase, samples.shape[-1])


def levels(samples: Array, rate: float) -> tuple[Array, Array]:
    """Return half octaves in Hz, and the level of samples (..., K) in each in dB, (..., F)."""
    edges = AUDIBLE[0] * 2.0 ** (np.arange(0, 10.1) / 2)
    edges = edges[edges <= AUDIBLE[1]]
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequencies = np.fft.rfftfreq(samples.shape[-1], 1 / rate)
    bands = [
        (frequencies >= low) & (frequencies < high)
        for low, high in zip(edges, edges[1:], strict=False)
    ]
    found = np.stack([power[..., band].mean(axis=-1) for band in bands], axis=-1)
    return np.sqrt(edges[1:] * edges[:-1]), 10 * np.log10(found)


def microphones(places: list[Heard]) -> Iterator[tuple[str, str, str]]:
    """Yield what the direct sounds say of the microphones."""
    found = []
    for place in places:
        _, level = levels(place.direct, place.rate)
        way = np.linalg.norm(place.response.loudspeaker - place.positions, axis=1)
        found.append(level + 20 * np.log10(way)[:, None])
    level = np.array(found)
    # What a microphone has in all directions is its own; the rest is the array's body.
    own = level.mean(axis=0) - level.mean(axis=(0, 1))
    gain = own.mean(axis=1)
    yield "`microphone_db`", "standard deviation of the gains", f"{gain.std(ddof=1):.2f} dB"
    ripple = own - gain[:, None]
    yield (
        "`microphone_ripple_db`",
        "of each one's own response about its gain, half octaves from 300 Hz to 9 kHz",
        f"{ripple.std():.2f} dB",
    )
    rest = level - level.mean(axis=1, keepdims=True) - own
    yield (
        "`microphone_ripple_db`",
        "what changes with the direction besides: the array's body",
        f"{rest.std():.2f} dB",
    )
    late = np.array([lags(place) for place in places])
    toward = np.array([place.response.loudspeaker for place in places])
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    late -= late.mean(axis=1, keepdims=True)
    # A microphone that is nearer to the loudspeaker than its table says hears earlier.
    metres = -late * places[0].speed / places[0].rate
    design = toward[:, :2]
    offset, *_ = np.linalg.lstsq(design, metres, rcond=None)
    yield (
        "`microphone_offset`",
        "of a coordinate, from when the direct sound arrives",
        f"{1000 * offset.std():.1f} mm",
    )
    left = metres - design @ offset
    yield "`microphone_offset`", "what no displacement explains", f"{1000 * left.std():.1f} mm"
    zero = np.array([zero_of(place) for place in places])
    yield (
        "`latency_samples`",
        "of the direct sound's crest, from place to place",
        f"{zero.std():.2f} samples",
    )


def lags(place: Heard) -> Array:
    """Return how late each microphone's direct sound is behind the mean one, (6,), in samples."""
    spectrum = np.fft.rfft(place.direct[:, :SHORT], 2 * SHORT)
    likeness = np.fft.irfft(spectrum * spectrum.mean(axis=0).conj(), 2 * SHORT * FINER)
    return np.fft.fftshift(likeness, axes=-1).argmax(axis=-1) / FINER - SHORT


def zero_of(place: Heard) -> float:
    """Return the sample of the crest of the mean direct sound."""
    spectrum = np.fft.rfft(place.direct[:, :SHORT].mean(axis=0), 2 * SHORT)
    return float(np.abs(np.fft.irfft(spectrum, 2 * SHORT * FINER)).argmax()) / FINER


def loudspeaker(places: list[Heard]) -> Iterator[tuple[str, str, str]]:
    """Yield what the direct sounds say of the loudspeaker."""
    level = np.array([levels(place.direct.mean(axis=0), place.rate)[1] for place in places])
    mean = level.mean(axis=0)
    yield (
        "`loudspeaker_ripple_db`",
        "of its half octaves from 300 Hz to 9 kHz, a studio's",
        f"{mean.std():.1f} dB",
    )


class EchoShape(NamedTuple):
    """One echo: share of energy after its core, loss of highs in dB, level in dB over clutter."""

    later: float
    loss: float
    over_clutter: float


def echo_shapes(place: Heard) -> Iterator[EchoShape]:
    """Yield what the echoes of a place that stand alone look like."""
    truth = place.response.truth
    mean = np.fft.rfft(place.direct.mean(axis=0))
    floor = 0.01 * np.mean(np.abs(mean) ** 2)
    inverse = mean.conj() / (np.abs(mean) ** 2 + floor)
    length = place.response.samples.shape[-1]
    toward = direction(truth.azimuth, truth.elevation)
    same_wall = toward @ toward.T > np.cos(BESIDE)
    for echo, (toa, azimuth, elevation) in enumerate(
        zip(truth.toa, truth.azimuth, truth.elevation, strict=True)
    ):
        later = truth.toa - toa
        near = np.abs(later) < ALONE
        first = not (same_wall[echo] & (later < 0) & near).any()
        at = (place.response.emitted + toa) * place.rate
        if not first or (near & ~same_wall[echo]).any() or at + 0.004 * place.rate > length:
            continue
        # Microphone 1 hears it at `at`, the others as much later as they are farther from there.
        eta = (place.positions[0] - place.positions) @ direction(azimuth, elevation)
        aligned = moved(place.whole, -eta * place.rate / place.speed).mean(axis=0)
        spectrum = np.fft.rfft(aligned) * inverse
        divided = np.fft.irfft(spectrum)
        # The direct sound was put 1 ms into the file.
        place_there = round(at - 0.001 * place.rate) % len(divided)
        shape = shape_of(divided, place_there, rate=place.rate)
        if shape is not None:
            yield shape


def shape_of(echo: Array, at: int, *, rate: float) -> EchoShape | None:
    """Return what an echo looks like near a sample; None if none stands out there.

    Args:
        echo: response over the direct sound, shape (K,).
        at: where it is expected.
        rate: in Hz.
    """
    core, spread = round(CORE * rate), round(SPREAD * rate)
    crest = at - 10 + int(np.abs(echo[at - 10 : at + 11]).argmax())
    energy = echo**2
    before = energy[crest - spread - core : crest - core]
    clutter = float(before.mean())
    inner = float(energy[crest - core : crest + core + 1].sum()) - clutter * (2 * core + 1)
    outer = float(energy[crest + core + 1 : crest + spread + 1].sum()) - clutter * (spread - core)
    if inner < 4 * clutter * (2 * core + 1):
        return None
    power = np.abs(np.fft.rfft(echo[crest - 2 * core : crest + spread], 1024)) ** 2
    frequencies = np.fft.rfftfreq(1024, 1 / rate)
    high = power[(frequencies > CORNER) & (frequencies < AUDIBLE[1])].mean()
    low = power[(frequencies > 500.0) & (frequencies < CORNER)].mean()
    over = 10 * np.log10(inner / (clutter * (2 * core + 1)))
    return EchoShape(max(outer, 0.0) / (inner + max(outer, 0.0)), 10 * np.log10(low / high), over)


def echoes(title: str, places: list[Heard]) -> Iterator[tuple[str, str, str]]:
    """Yield what echoes that stand alone say of walls and clutter."""
    found = np.array([shape for place in places for shape in echo_shapes(place)])
    low, middle, high = np.quantile(found, [0.1, 0.5, 0.9], axis=0)
    later = f"{title}: energy from 0.2 to 1 ms after the crest, {len(found)} echoes"
    yield "`scattering`, `spread`", later, span(low[0], middle[0], high[0], digits=2)
    loss = f"{title}: of an echo, lows over highs, beside the direct sound"
    yield "`absorption_db`", loss, span(low[1], middle[1], high[1], unit=" dB")
    over = f"{title}: an echo's core over the clutter of the millisecond before it"
    yield "`scatterers`", over, span(low[2], middle[2], high[2], unit=" dB")


def simulated(realism: Realism, measured: Measurements) -> list[Heard]:
    """Return what the same array hears at 30 places of a simulated room."""
    rate = measured.sample_rate
    probe = Probe(np.array([1.0]), rate, round(0.1 * rate))
    array = MicArray(measured.array.positions)
    ideal = Scene(array, probe, Images(), White(), measured.speed_of_sound)
    room = Room((6.6, 5.0, 2.7), 0.4)
    rng = np.random.default_rng(0)
    found = []
    for place in range(30):
        pose = Pose(rng.uniform(1.0, [5.6, 4.0, 1.7]), rng.uniform(-np.pi, np.pi))
        scene, _ = realistic(ideal, realism, rng=np.random.default_rng(place))
        samples = scene.received(room, pose)
        truth = true_echoes(room, pose, array=array)
        response = Response(str(place), "", samples, 0.0, np.zeros(3), truth, pose)
        found += heard(replace(measured, responses=[response]))
    return found


def span(low: float, middle: float, high: float, *, unit: str = "", digits: int = 1) -> str:
    """Return a median and what 80 % lie between.

    Args:
        low, middle, high: quantiles.
        unit: of them.
        digits: decimals.
    """
    return f"{middle:.{digits}f}{unit} ({low:.{digits}f} to {high:.{digits}f})"


def materials() -> Iterator[tuple[str, str, str]]:
    """Yield what the tables of pyroomacoustics say; nothing where it is not installed."""
    try:
        from pyroomacoustics.parameters import materials_absorption_table as absorption
        from pyroomacoustics.parameters import materials_scattering_table as scattering
    except ImportError:
        return
    losses = []
    for each in absorption.values():
        coefficients = np.array(each["coeffs"])
        centres = np.array(each.get("center_freqs", OCTAVES))[: len(coefficients)]
        if len(coefficients) > 1 and centres[-1] >= 4000:
            left = 1.0 - np.minimum(coefficients, 0.99)
            losses.append(10 * np.log10(left[centres <= 1000].mean() / left[centres > 3000].mean()))
    quantiles = np.quantile(losses, [0.1, 0.5, 0.9])
    which = f"tables: of {len(losses)} materials, up to 1 kHz over 4 and 8 kHz"
    yield "`absorption_db`", which, span(*quantiles, unit=" dB")
    rough = [np.mean(each["coeffs"]) for each in scattering.values() if len(each["coeffs"]) > 1]
    which = f"tables: of {len(rough)} rough surfaces, mean over octaves"
    yield "`scattering`", which, f"{min(rough):.2f} to {max(rough):.2f}"


def main(page: str | None = None) -> None:
    """Print the table, or put it into a page."""
    measured = R3vival(("000",)).read(None)
    places = list(heard(measured))
    [(_, config)] = compose("generate", ["realism=measured"])
    usual = build(config["realism"], "realism")
    ends = {
        "`clean`": Realism(),
        "`scatterers` 20 of 20 cm alone": Realism(scatterers=(20, 20), scatterer_radius=(0.2, 0.2)),
        "`scattering` 0.1, 0.2 ms alone": Realism(spread=(2e-4, 2e-4), scattering=(0.1, 0.1)),
        "`scattering` 0.7, 1 ms alone": Realism(spread=(1e-3, 1e-3), scattering=(0.7, 0.7)),
        "`measured`": usual,
    }
    parts = [microphones(places), loudspeaker(places), echoes("slice", places), materials()]
    parts += [echoes(title, simulated(each, measured)) for title, each in ends.items()]
    lines = ["| key | measured | found |", "|---|---|---|"]
    lines += [f"| {' | '.join(cells)} |" for part in parts for cells in part]
    table = "\n".join(lines)
    print(table)
    if page:
        write_between(Path(page), f"\n{table}\n", markers=MARKERS)


if __name__ == "__main__":
    main(*sys.argv[1:])
