"""The page of `check`: one file that opens offline, on a phone as well, light or dark.

Texts and axes are HTML, which keeps its size wherever the page is read; images and lines lie in
frames that stretch. Nothing of a survey is markup: every text is escaped.
"""

from collections.abc import Sequence
from html import escape

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.robot.check_facts import HEADINGS, UNSEEN, Facts, middle
from echolearn.robot.pages import filled_page
from echolearn.robot.png import data_url, palette
from echolearn.robot.waterfall import HIGHEST, LOWEST, Waterfall
from echolearn.survey.health import Health
from echolearn.survey.survey import Survey

SIGNS = {"fine": "&#10003;", "told": "!", "bad": "&#10005;"}

KEYS = {"direct": "direct path", "window": "search window", "echo": "true echoes of the walls told"}
"""Lines of a waterfall, by their class, and what they show."""

MOST_POINTS = 480
"""Poses that a line shows at most."""


def page_of(survey: Survey, health: Health, *, facts: Facts, fall: Waterfall) -> bytes:
    """Return the page.

    Args:
        survey: what was recorded.
        health: what the recordings say about themselves.
        facts: the same in words.
        fall: its images.
    """
    probe = survey.probe
    text = (
        f"{len(survey.poses)} poses, {len(survey.array)} microphones, {probe.length} samples at "
        f"{probe.sample_rate:g} Hz, speed of sound {survey.speed_of_sound:g} m/s"
    )
    about = (
        "Poses downwards, the time since the emission to the right. A wall is a line that bends as "
        "the robot drives; the direct path stands upright where geometry puts it."
    )
    filled = {
        "title": escape(survey.folder.resolve().name),
        "facts": text,
        "state": facts.state,
        "sign": SIGNS[facts.state],
        "verdict": escape(facts.verdict),
        "because": escape(facts.because),
        "findings": _findings(facts),
        "figures": "".join(_figure(*each) for each in facts.figures),
        "waterfall": about,
        "colours": ",".join("rgb({},{},{})".format(*colour) for colour in palette()[::9].tolist()),
        "keys": _keys(fall),
        "array": _waterfall(survey, fall, number=0),
        "channels": _channels(facts),
        "microphones": "".join(
            f"<div><h3>Microphone {number}</h3>{_waterfall(survey, fall, number=number)}</div>"
            for number in range(1, len(fall.images))
        ),
        "curves": _curves(survey, health),
        "unseen": UNSEEN,
    }
    return filled_page("robot", "check.html", filled=filled)


def _findings(facts: Facts) -> str:
    """Return the list of what is refused, mended and noticed; nothing if there is none."""
    lines = "".join(
        f'<li class="{state}"><span class="sign" aria-hidden="true">{SIGNS[state]}</span>'
        f"<span><em>{kind}:</em> {escape(line)}</span></li>"
        for state, kind, line in facts.lines
    )
    return f'<section><h2>Findings</h2><ul class="found">{lines}</ul></section>' if lines else ""


def _figure(name: str, value: str, remark: str) -> str:
    return f"<div><dt>{name}</dt><dd>{escape(value)}<small>{escape(remark)}</small></dd></div>"


def _channels(facts: Facts) -> str:
    """Return the table of microphones."""
    head = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in HEADINGS)
    rows = []
    for state, (name, verdict, *cells) in facts.channels:
        sign = f'<span class="sign" aria-hidden="true">{SIGNS[state]}</span>'
        row = f'<th scope="row">{name}</th><td class="{state}">{sign}{escape(verdict)}</td>'
        named = zip(HEADINGS[2:], cells, strict=True)
        # On a phone a row is a block whose cells carry the names of their columns themselves.
        row += "".join(f'<td data-name="{name}">{escape(cell)}</td>' for name, cell in named)
        rows.append(f"<tr>{row}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _keys(fall: Waterfall) -> str:
    """Return the boxes that show and hide lines, and the scale of colours."""
    drawn = {"direct": bool(np.isfinite(fall.direct).all()), "echo": fall.echoes is not None}
    boxes = "".join(
        f'<label><input type="checkbox" id="k-{kind}" checked>'
        f'<svg viewBox="0 0 2 1" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="{kind}" d="M0 .5H2"/></svg>{KEYS[kind]}</label>'
        for kind in KEYS
        if drawn.get(kind, True)
    )
    return f'{boxes}<span class="bar">{LOWEST:g} dB<i></i>{HIGHEST:g} dB over the median</span>'


def _waterfall(survey: Survey, fall: Waterfall, *, number: int) -> str:
    """Return the waterfall of a microphone, counted from 1; 0 is the array's."""
    # What the microphones hear together is timed at the first one.
    microphone = max(number - 1, 0)
    poses = len(survey.poses)
    lines = [_upright("window", lag, poses=poses) for lag in fall.window]
    if np.isfinite(fall.direct[microphone]):
        lines.append(_upright("direct", fall.direct[microphone], poses=poses))
    if fall.echoes is not None:
        lines.append(_marks("echo", fall.echoes[:, microphone]))

    rate = survey.probe.sample_rate
    metres = survey.speed_of_sound / rate / 2
    few = 5 if number else 8
    name = f"microphone {number}" if number else "the array"
    image = f'<img src="{data_url(fall.images[number])}" alt="Waterfall of {name}">'
    ticks = _ticks("x", fall.lags, most=few, unit=" ms", scale=1e3 / rate)
    if not number:
        ticks += _ticks("top", fall.lags, most=few, unit=" m", scale=metres)
    ticks += _pose_ticks("y", survey.numbers)
    note = "Above: distance of a wall of that time." if not number else ""
    tall = "13rem" if number else "clamp(18rem,45vw,30rem)"
    drawn = _frame(image, lines, ticks=ticks, size=(fall.lags, poses), tall=tall, dark=True)
    return f"<figure>{drawn}<figcaption>{note}</figcaption></figure>" if note else drawn


def _curves(survey: Survey, health: Health) -> str:
    """Return the quantities of each pose as curves."""
    late = health.latency_samples
    drawn = [
        _curve("SNR, at least, dB", health.snr_db[:, None], numbers=survey.numbers),
        _curve("Noise, at most, dB", health.noise_db[:, None], numbers=survey.numbers),
        _curve("Level of each microphone, dB", health.level_db, numbers=survey.numbers),
        _curve("Latency of each microphone, samples", late, numbers=survey.numbers),
    ]
    return "".join(drawn)


def _curve(title: str, values: Array, *, numbers: Sequence[int]) -> str:
    """Return values (P, K) of the poses as K curves; a line where nothing is measurable."""
    known = values[np.isfinite(values)]
    if not len(known):
        return f'<div><h3>{title}</h3><figure class="soft">not measurable</figure></div>'
    # At least two units high, lest rounding look like a jump.
    low = min(float(known.min()), middle(known) - 1)
    high = max(float(known.max()), middle(known) + 1)
    kind = "curve many" if values.shape[1] > 1 else "curve"
    lines = [_path(kind, range(len(values)), down=high - column) for column in values.T]
    size = (max(len(values) - 1, 1), high - low)
    ticks = _pose_ticks("x", numbers)
    step = _step(high - low, 5)
    for value in np.arange(np.ceil(low / step) * step, high, step).tolist():
        ticks.append(_tick("y", (high - value) / (high - low), name=f"{value:g}"))
        lines.insert(0, f'<path class="grid" d="M0 {high - value:.3f}H{size[0]}"/>')
    low_high = f"from {known.min():.1f} to {known.max():.1f}"
    frame = _frame("", lines, ticks=ticks, size=size, tall="9rem", dark=False)
    return f'<div role="img" aria-label="{title}: {low_high}"><h3>{title}</h3>{frame}</div>'


def _frame(
    image: str,
    lines: Sequence[str],
    *,
    ticks: Sequence[str],
    size: tuple[float, float],
    tall: str,
    dark: bool,
) -> str:
    """Return an image, lines over it and ticks around it.

    Args:
        image: markup of the image, or nothing.
        lines: markup of the lines.
        ticks: markup of the ticks.
        size: width and height of what the lines are drawn in.
        tall: height on the page, as CSS has it.
        dark: whether the ground is that of the images.
    """
    width, height = size
    return (
        f'<div class="frame{" dark" * dark}" style="--tall:{tall}">{image}'
        f'<svg viewBox="0 0 {width:g} {height:g}" preserveAspectRatio="none" aria-hidden="true">'
        f"{''.join(lines)}</svg>{''.join(ticks)}</div>"
    )


def _upright(kind: str, lag: float, *, poses: int) -> str:
    return f'<path class="{kind}" d="M{lag:.1f} 0V{poses}"/>'


def _path(kind: str, across: Sequence[float] | Array, *, down: Sequence[float] | Array) -> str:
    """Return a line through points, which is interrupted where one is not known."""
    every = max(1, len(across) // MOST_POINTS)
    points = np.stack([across, down], axis=-1)[::every]
    drawn = []
    pen = "M"
    for x, y in points.tolist():
        if x == x and y == y:
            drawn.append(f"{pen}{x:.1f} {y:.2f}")
        pen = "L" if x == x and y == y else "M"
    return f'<path class="{kind}" d="{"".join(drawn)}"/>'


def _marks(kind: str, lags: Array) -> str:
    """Return a short mark for each lag (P, C) that is known, as high as its pose."""
    every = max(1, len(lags) // MOST_POINTS)
    poses, walls = np.nonzero(np.isfinite(lags[::every]))
    found = zip(poses * every, lags[poses * every, walls], strict=True)
    drawn = "".join(f"M{lag:.1f} {pose}v{every}" for pose, lag in found)
    return f'<path class="{kind}" d="{drawn}"/>'


def _ticks(kind: str, lags: int, *, most: int, unit: str, scale: float) -> list[str]:
    """Return ticks along the lags; their unit goes with the last.

    Args:
        kind: their class.
        lags: number of lags.
        most: ticks at most.
        unit: behind the last one's number.
        scale: units per lag.
    """
    high = lags * scale
    step = _step(high, most)
    values = np.arange(0.0, high, step).tolist()
    names = [f"{value:g}" for value in values]
    names[-1] += unit
    return [_tick(kind, value / high, name=name) for value, name in zip(values, names, strict=True)]


def _pose_ticks(kind: str, numbers: Sequence[int]) -> list[str]:
    """Return a tick for some of the poses, under the number that names each."""
    count = len(numbers)
    step = max(1, round(_step(count, 6)))
    # The pixel of a pose has a height, a point of a curve has none.
    last, half = (count, 0.5) if kind == "y" else (max(count - 1, 1), 0.0)
    return [
        _tick(kind, (pose + half) / last, name=str(numbers[pose])) for pose in range(0, count, step)
    ]


def _tick(kind: str, share: float, *, name: str) -> str:
    side = "top" if kind == "y" else "left"
    return f'<span class="{kind}" style="{side}:{100 * share:.2f}%">{name}</span>'


def _step(high: float, most: int) -> float:
    """Return a step of 1, 2 or 5 times a power of ten that leaves at most so many."""
    power = 10.0 ** np.floor(np.log10(high / most))
    return float(next(power * times for times in (1, 2, 5, 10) if power * times * most >= high))
