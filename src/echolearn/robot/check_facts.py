"""What `check` says of a survey, in words: the same in the terminal and on the page.

Survey, Health, what else `map` would refuse --> verdict, lines, figures, a row a microphone
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.arrays import limits
from echolearn.acoustics.bistatic import plane_wave_error
from echolearn.acoustics.types import Array
from echolearn.robot.reference import UNLIKE
from echolearn.survey.health import Health
from echolearn.survey.survey import Survey

HEADINGS = (
    "microphone",
    "verdict",
    "late, samples",
    "ms",
    "sign",
    "direct, dB",
    "level, dB",
    "offset, %",
    "hum, dB",
    "clipped, %",
)
"""Columns of the table of microphones."""

SOUNDS = (".wav", ".flac")
"""Ends of names of recordings."""

FINE = "fine"
"""Verdict on a microphone of which there is nothing to say."""

UNSEEN = (
    "What cannot be seen: samples lost after the direct path, where the loss leaves neither zeros "
    "nor a repeated block; sound that leaks between all microphones alike; an array turned or "
    "mirrored, where the robot hardly moves or hears no walls."
)
"""What no check tells."""


@dataclass(frozen=True)
class Facts:
    """What there is to say of a survey.

    Attributes:
        state: "fine", "told" if something was mended or noticed, "bad" if `map` would refuse it.
        verdict: headline.
        because: line on what that rests on.
        lines: state and text of each finding.
        figures: name, value and remark of each quantity.
        channels: state and a row of texts, as `HEADINGS`, of each microphone.
    """

    state: str
    verdict: str
    because: str
    lines: Sequence[tuple[str, str, str]]
    figures: Sequence[tuple[str, str, str]]
    channels: Sequence[tuple[str, Sequence[str]]]


def survey_facts(
    survey: Survey,
    health: Health,
    *,
    refused: Sequence[str] = (),
    domain: str | None = None,
) -> Facts:
    """Return what there is to say of a survey.

    Args:
        survey: what was recorded.
        health: what the recordings say about themselves.
        refused: why else `map` would refuse it.
        domain: how it compares with what the bundle knows, if that was asked.
    """
    lines = [("bad", "refused", line) for line in (*health.refused, *refused)]
    lines += [("told", "mended", line) for line in health.mended]
    lines += [("told", "noticed", line) for line in health.noticed]
    if domain is not None:
        lines.append(("told" if domain.startswith(UNLIKE) else "fine", "domain", domain))
    state, verdict = "fine", "map would take it as it is"
    if health.refused or refused:
        state, verdict = "bad", "map would refuse it"
    elif health.mended:
        state, verdict = "told", "map would take it, mended"
    elif health.noticed:
        state, verdict = "told", "map would take it; look at what was noticed"
    return Facts(
        state,
        verdict,
        health.time_zero,
        lines,
        _figures(survey, health),
        _channels(survey, health),
    )


def _figures(survey: Survey, health: Health) -> list[tuple[str, str, str]]:
    """Return the quantities of the whole walk."""
    rate = survey.probe.sample_rate
    late = middle(health.latency_samples)
    spread = extent(health.latency_samples)
    clipped = 100 * float(health.clipping.max())
    array = survey.array
    bent = plane_wave_error(array, distance=1.0) * rate / survey.speed_of_sound
    return [
        ("walk", _way(survey), _recordings(survey)),
        ("array", f"{len(array)} microphones", limits(array)),
        ("curved waves", f"{bent:.1f} samples", "off plane ones, of a wall 1 m away"),
        ("latency", readable(late, "{:z.1f} samples"), readable(late / rate * 1e3, "{:z.2f} ms")),
        ("spread of latency", readable(spread, "{:z.1f} samples"), "over poses and microphones"),
        ("SNR, at least", readable(middle(health.snr_db), "{:z.0f} dB"), _lowest(health)),
        (
            "noise, at most",
            readable(middle(health.noise_db), "{:z.0f} dB"),
            "the quietest eighth of a recording, reverberation and all; full scale is 0 dB",
        ),
        (
            "direct path",
            readable(-health.removed_db, "{:.0f} dB"),
            f"left by direct={survey.direct}" if survey.direct else "removed before",
        ),
        ("hum", *_hum(health)),
        (
            "clock drift",
            readable(health.clock_drift_ppm, "{:+z.0f} ppm"),
            "recorder against player",
        ),
        ("clipped", readable(clipped, "{:.1f} %"), "of a burst at the rails, at worst"),
        ("negative echoes", readable(100 * health.negative_echoes, "{:.0f} %"), _heard(health)),
    ]


def _heard(health: Health) -> str:
    """Return of what share negative echoes are told, or that there is none to be told of."""
    if math.isnan(health.negative_echoes):
        return "no echo stands out of the noise: was the probe played?"
    return "of the strongest"


def _recordings(survey: Survey) -> str:
    """Return how many recordings there are, and how many lie there that no pose names."""
    known = {(survey.folder / file).resolve() for file in survey.files}
    places = {path.parent for path in known} - {survey.folder.resolve()}
    there = [path for place in places for path in place.iterdir() if path.suffix in SOUNDS]
    more = sorted(path.name for path in there if path not in known)
    count = f"{len(survey.poses)} recordings"
    return f"{count}; {len(more)} more without a pose, as {more[0]!a:.60}" if more else count


def _way(survey: Survey) -> str:
    """Return how far the robot drove, pose by pose in the order of their numbers."""
    places = np.array([survey.poses[pose].position for pose in np.argsort(survey.numbers)])
    return f"{np.linalg.norm(np.diff(places, axis=0), axis=1).sum():.1f} m"


def _lowest(health: Health) -> str:
    """Return where the SNR is lowest."""
    if not np.isfinite(health.snr_db).any():
        return "not measurable"
    pose = int(np.nanargmin(health.snr_db))
    lowest = f"{health.snr_db[pose]:z.0f} dB, pose {health.numbers[pose]}"
    return f"over the quietest eighth of a recording; lowest {lowest}"


def _hum(health: Health) -> tuple[str, str]:
    """Return the level of the mains, and their frequency."""
    if not health.hum_hz:
        return "none", "mains of 50 or 60 Hz"
    return readable(
        float(health.hum_db.max()), "{:+.0f} dB"
    ), f"{health.hum_hz:g} Hz, over the rest"


def _channels(survey: Survey, health: Health) -> list[tuple[str, list[str]]]:
    """Return state and row of each microphone: medians over the walk."""
    late = over_poses(health.latency_samples, middle)
    gain = over_poses(np.abs(health.direct_gain), middle)
    # In the free field the direct path falls with distance, which is no fault of a microphone.
    away = np.maximum(np.linalg.norm(survey.array.positions, axis=1), 1e-3)
    direct = 20 * np.log10(np.maximum(gain * away, 1e-15))
    direct -= middle(direct)
    columns = [
        all_readable(late, "{:+z.1f}"),
        all_readable(late / survey.probe.sample_rate * 1e3, "{:+z.2f}"),
        [_sign(column) for column in health.direct_gain.T],
        all_readable(direct, "{:+z.1f}"),
        all_readable(over_poses(health.level_db, middle), "{:.0f}"),
        all_readable(100 * over_poses(health.offset, middle), "{:+z.2f}"),
        ["none" if level == -math.inf else readable(level, "{:+.0f}") for level in health.hum_db],
        all_readable(100 * health.clipping.max(axis=0), "{:.1f}"),
    ]
    found = [_verdict(health, microphone) for microphone in range(len(survey.array))]
    rows = zip(found, *columns, strict=True)
    return [
        (state, [str(place), verdict, *cells])
        for place, ((state, verdict), *cells) in enumerate(rows, start=1)
    ]


def _sign(gain: Array) -> str:
    """Return the sign of a microphone's direct path in P recordings, both if it turns."""
    known = gain[np.isfinite(gain)]
    if not len(known):
        return UNKNOWN
    share = float(np.mean(known < 0))
    # Noise may turn that of a single recording.
    return "+" if share < TURNED else "-" if share > 1 - TURNED else "+/-"


def _verdict(health: Health, microphone: int) -> tuple[str, str]:
    """Return the state of a microphone, counted from 0, and what there is to say of it."""
    verdict = health.verdicts[microphone]
    if verdict != FINE:
        return "bad" if health.refused else "told", verdict
    mending = health.mending
    done = []
    if mending is not None and (mending.sign[:, microphone] < 0).any():
        done.append("sign")
    if mending is not None and mending.offset[:, microphone].any():
        done.append("offset")
    return ("told", f"mended: {', '.join(done)}") if done else ("fine", FINE)


TURNED = 0.2
"""Share of recordings in which a sign is the other from which a microphone has both."""

UNKNOWN = "?"
"""What is shown where something cannot be measured."""


def readable(value: float, form: str) -> str:
    """Return a number as `form` has it, or that it is not known."""
    return form.format(value) if math.isfinite(value) else UNKNOWN


def all_readable(values: Array, form: str) -> list[str]:
    """Return numbers (K,) as `form` has them."""
    return [readable(value, form) for value in values.tolist()]


def middle(values: Array) -> float:
    """Return the median of what is measurable; NaN if nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def extent(values: Array) -> float:
    """Return the difference of the largest and the smallest of what is measurable, or NaN."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else math.nan


def over_poses(values: Array, reduce: Callable[[Array], float]) -> Array:
    """Return what a function makes of each column of values (P, M), shape (M,)."""
    return np.array([reduce(column) for column in values.T])
