"""What is left of echoes without the direct path? `python tests/direct_paths.py [poses] [page]`.

A robot stands beside the walls of a simulated room, with faults that real ones have. Or it hears
the responses that come with echolearn (R3VIVAL, `survey/protocols.py`), with the direct sound and
the metre of path after it as if the loudspeaker were carried in the middle of the array. Recordings
are written as a survey that holds the direct path, examined, mended and read as `map` does, with
each way to remove the direct path; `exact` is what only who made them knows. Then `gated`
localizes. Printed are the share of times within 10 samples of a wall's echo, and the share of
echoes whose azimuth is right within 10 degrees besides, in %. Then `fir` is held against those that
need no calibration either, recording by recording: how many only the one has right, how many only
the other, and McNemar's exact test of that, by Holm for all tests together. A page gets both
tables between its markers.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy import signal
from scipy.stats import binomtest

from echolearn.acoustics.geometry import SearchWindow, circular_array, microphone_positions, wrap
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.signals import convolve, noise_probe, power
from echolearn.acoustics.types import Array, MicArray, Observation, Pose, Room, Truth
from echolearn.evaluation.stats import holm
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.rir.images import Images
from echolearn.storage.marked_page import Markers, write_between
from echolearn.survey import early, protocols
from echolearn.survey.audio import wav_bytes
from echolearn.survey.description import description_bytes
from echolearn.survey.examining import examine
from echolearn.survey.health import as_found
from echolearn.survey.poses import poses_csv
from echolearn.survey.reader import read_survey
from echolearn.survey.sources.r3vival import R3vival
from echolearn.survey.survey import Survey

RATE = 22050.0
SNRS_DB = (40, 10, 0, -5, -10)
ROOM = Room((8.0, 6.0, 5.0), 0.25)
ARRAY = circular_array()
PROBE = noise_probe(length=8000)
LOCALIZER = Gated()
WAYS = ("exact", "analytic", "fitted", "fir", "all lags", "joint", "fir, as played")
RIVALS = ("analytic", "fitted")
"""Ways that ask for no calibration either, one of which would be the default."""

SURE = 0.05
"""Level of the tests, all of them together."""

MARKERS = Markers(
    "<!-- direct paths: written by `python tests/direct_paths.py` -->",
    "<!-- end of direct paths -->",
    "page",
)

Change = Callable[[Array], Array]
Hits = dict[str, list[Array]]
"""By each way, and at each SNR, what is right of P recordings: times, azimuths too, (2, P)."""


class Case(NamedTuple):
    """Recordings of one kind without noise.

    Attributes:
        array: what records.
        received: with the direct path, shape (P, M, N).
        direct: the direct path and the robot's own body, the same shape or (M, N).
        truths: echoes of each pose.
        poses: where they were recorded.
        mended: whether time zero is to be found; measured responses are aligned.
    """

    array: MicArray
    received: Array
    direct: Array
    truths: list[Truth]
    poses: list[Pose]
    mended: bool = True


def places(count: int, rng: np.random.Generator) -> list[Pose]:
    """Return poses with a wall 1 to 2 m away, and none nearer than 0.8 m."""
    poses: list[Pose] = []
    while len(poses) < count:
        x, y = rng.uniform(0.8, [7.2, 5.2])
        away = np.array([x, y, 8.0 - x, 6.0 - y])
        if ((away > 1.05) & (away < 1.95)).any():
            poses.append(Pose(np.array([x, y, 2.5]), rng.uniform(-np.pi, np.pi)))
    return poses


def loudspeaker(responses: Array) -> Array:
    """Let a loudspeaker of 250 to 7000 Hz play, which is some samples late."""
    low, high = signal.butter(2, [250.0, 7000.0], "bandpass", fs=RATE)
    late = np.pad(responses, [(0, 0)] * (responses.ndim - 1) + [(3, 0)])
    return np.asarray(signal.lfilter(low, high, late))


def microphones(responses: Array) -> Array:
    """Let microphones differ by 1.5 dB, standard deviation, each with a short response."""
    rng = np.random.default_rng(11)
    own = 0.15 * rng.standard_normal((6, 10)) * np.exp(-np.arange(10) / 3)
    own[:, 0] = 1.0
    own *= 10 ** (1.5 * rng.standard_normal((6, 1)) / 20)
    return convolve_each(responses, own)


def convolve_each(responses: Array, own: Array) -> Array:
    """Return responses (..., M, K), each through that of its microphone, (M, J)."""
    length = responses.shape[-1] + own.shape[-1] - 1
    spectrum = np.fft.rfft(responses, length) * np.fft.rfft(own, length)
    return np.asarray(np.fft.irfft(spectrum, length))


def body(responses: Array) -> Array:
    """Let the robot's own body, 0.3 m from the loudspeaker, send back half of what it gets."""
    place = np.array([0.25, 0.12, -0.1])
    way = np.linalg.norm(place) + np.linalg.norm(ARRAY.positions - place, axis=1)
    lags = np.arange(responses.shape[-1]) - way[:, None] * RATE / 343.0
    return responses + 0.5 / (4 * np.pi * way[:, None]) * np.sinc(lags)


def latency(responses: Array) -> Array:
    """Let the interface be 7.3 samples late."""
    size = 2 * responses.shape[-1]
    phase = np.exp(-2j * np.pi * 7.3 * np.fft.rfftfreq(size))
    return np.asarray(np.fft.irfft(np.fft.rfft(responses, size) * phase, size))


CASES: dict[str, tuple[Change, ...]] = {
    "clean": (),
    "latency": (latency,),
    "body": (body,),
    "microphones": (microphones,),
    "loudspeaker": (loudspeaker,),
    "all of these": (body, microphones, loudspeaker, latency),
}


def case(changes: tuple[Change, ...], poses: list[Pose]) -> Case:
    """Return what is recorded at poses without noise, changed step by step."""
    images = Images()
    about = {"sample_rate": RATE, "speed_of_sound": 343.0}
    open_air = Room((40.0, 40.0, 40.0), 1.2, walls=(0.0,) * 6)
    middle = Pose(np.full(3, 20.0))
    responses = [
        images(ROOM, p.position, microphones=microphone_positions(ARRAY, p), **about) for p in poses
    ]
    alone = images(
        open_air, middle.position, microphones=microphone_positions(ARRAY, middle), **about
    )
    both = [np.array(responses), alone]
    for change in changes:
        both = [change(each) for each in both]
    received, direct = (convolve(PROBE.samples, each, length=PROBE.length) for each in both)
    truths = [true_echoes(ROOM, pose, array=ARRAY) for pose in poses]
    return Case(ARRAY, received, direct, truths, poses)


def measured(count: int) -> Case:
    """Return at least so many recordings of a robot where responses were measured, as loud as
    0.2 m away; every response serves as often as is needed, each time in other noise."""
    source = R3vival(("000",)).read(None)
    heard = []
    alone = []
    made = protocols.takes(source, "pose")
    made *= -(-count // len(made))
    for take in made:
        response = take.response
        rng = np.random.default_rng(0)
        late = protocols.recorded_take(take, source, probe=PROBE, snr_db=None, rng=rng)
        samples = protocols.at_rate(source, response.samples, rate=RATE)
        gate = (response.emitted + (response.distance + protocols.GATE) / 343.0) * RATE
        early_part = np.where(np.arange(samples.shape[-1]) < gate, samples, 0.0)
        away = np.linalg.norm(response.loudspeaker - source.array.positions, axis=1)
        carried = np.linalg.norm(source.array.positions, axis=1)
        earlier = -response.emitted * RATE - (away - carried) * RATE / 343.0
        near = [protocols.moved(each, lag) for each, lag in zip(early_part, earlier, strict=True)]
        gain = response.distance / protocols.CARRIED
        direct = gain * convolve(PROBE.samples, np.array(near), length=PROBE.length)
        heard.append(late + direct)
        alone.append(direct)
    truths = [take.truth(343.0) for take in made]
    poses = [Pose(np.array([0.1 * number, 0.0, 1.4])) for number in range(len(made))]
    return Case(source.array, np.array(heard), np.array(alone), truths, poses, mended=False)


def write(folder: Path, samples: Array, each: Case) -> Survey:
    """Write recordings (P, M, N) as a survey that holds the direct path."""
    (folder / "observations").mkdir(parents=True)
    about = description_bytes(
        each.array, PROBE, speed_of_sound=343.0, walls=outline(ROOM), conditions={}
    )
    (folder / "survey.yaml").write_bytes(about.replace(b"path: removed", b"path: present"))
    burst = np.pad(PROBE.samples, (0, PROBE.length - len(PROBE.samples)))
    (folder / "probe.wav").write_bytes(wav_bytes(burst, RATE))
    names = [f"observations/{number}.wav" for number in range(len(samples))]
    (folder / "poses.csv").write_bytes(poses_csv(each.poses, names))
    for name, recording in zip(names, samples, strict=True):
        (folder / name).write_bytes(wav_bytes(recording, RATE))
    survey = read_survey(folder)
    return as_found(survey, examine(survey)) if each.mended else survey


def all_lags(samples: Array, survey: Survey, *, joint: bool) -> Array:
    """Return recordings without their copies of the burst at early lags, all of them fitted.

    Args:
        samples: shape (P, M, N).
        survey: tells which those are.
        joint: fit those up to the end of the search window as well, and leave them in.
    """
    first, last = survey.early_lags(0)
    end = SearchWindow().lags(survey.array, RATE)[1] + 20 if joint else last
    responses = early.early_responses(samples, PROBE, lags=(first, end), penalty=0.0)
    left = samples.copy()
    copies = convolve(
        PROBE.samples, responses[..., : last - first], length=samples.shape[-1] - first
    )
    left[..., first:] -= copies
    return left


def without_direct(survey: Survey, way: str) -> Observation:
    """Return all recordings of a mended survey, the direct path removed in one way."""
    every = range(len(survey.poses))
    if way in ("fir", "fitted", "analytic"):
        return replace(survey, direct=way).observe(every)
    if way == "fir, as played":
        return replace(survey, direct="fir", played="walk").observe(every)
    samples = np.stack([survey.mended(pose) for pose in every])
    left = all_lags(samples, survey, joint=way == "joint")
    return Observation(left, PROBE, survey.array)


def right(observation: Observation, truths: list[Truth]) -> Array:
    """Return whether time, and time and azimuth, are those of a wall, shape (2, P), bool."""
    echoes = LOCALIZER(observation)
    found = []
    for toa, azimuth, elevation, truth in zip(
        echoes.toa[:, 0], echoes.azimuth[:, 0], echoes.elevation[:, 0], truths, strict=True
    ):
        near = np.abs(truth.toa - toa) * RATE < 10
        toward = np.abs(wrap(truth.azimuth - azimuth)) < np.deg2rad(10)
        # Floor and ceiling are no walls, and have no azimuth.
        walls = np.abs(truth.elevation - np.pi / 2) < 0.1
        found.append([(near & walls).any(), (near & walls & toward).any() and elevation > 1.0])
    return np.array(found).T


def hits(each: Case, folder: Path, *, seed: int = 0) -> Hits:
    """Return what is right of each recording, by each way and at each SNR."""
    rng = np.random.default_rng(seed)
    table: Hits = {way: [] for way in WAYS}
    for snr_db in SNRS_DB:
        level = np.sqrt(power(each.received) * 10 ** (-snr_db / 10))[..., None]
        noisy = each.received + level * rng.standard_normal(each.received.shape)
        survey = write(folder / str(snr_db), noisy, each)
        for way in WAYS:
            if way == "exact":
                exact = replace(survey, direct=None)
                # The same samples are taken off, late as the recording is.
                quiet = write_without(folder / f"{snr_db} exact", noisy - each.direct, survey)
                observation = quiet.observe(range(len(exact.poses)))
            else:
                observation = without_direct(survey, way)
            table[way].append(right(observation, each.truths))
    return table


def write_without(folder: Path, samples: Array, survey: Survey) -> Survey:
    """Write recordings (P, M, N) without the direct path, mended as a survey that holds it."""
    folder.mkdir()
    (folder / "observations").mkdir()
    for name, each in zip(survey.files, samples, strict=True):
        (folder / name).write_bytes(wav_bytes(each, RATE))
    return replace(survey, folder=folder, direct=None)


def report(count: int, seed: int = 0) -> str:
    """Return the tables of so many poses as Markdown."""
    poses = places(count, np.random.default_rng(seed))
    found: dict[str, Hits] = {}
    for name, changes in {**CASES, "measured": None}.items():
        heard = measured(count) if changes is None else case(changes, poses)
        with TemporaryDirectory() as scratch:
            found[name] = hits(heard, Path(scratch), seed=seed)
        print(name, "is done", file=sys.stderr, flush=True)
    return f"{shares_table(found)}\n\n{duels_table(found)}"


def shares_table(found: dict[str, Hits]) -> str:
    """Return the shares that are right as Markdown."""
    head = ["recordings", "removed by", *(f"{snr_db} dB" for snr_db in SNRS_DB)]
    lines = [f"| {' | '.join(head)} |", "|---|---|" + "---|" * len(SNRS_DB)]
    for name, table in found.items():
        for way, levels in table.items():
            shares = [100 * right_ones.mean(axis=1) for right_ones in levels]
            texts = [f"{times:.0f} / {both:.0f}" for times, both in shares]
            lines.append(f"| {name} | {way} | {' | '.join(texts)} |")
    return "\n".join(lines)


def duels_table(found: dict[str, Hits]) -> str:
    """Return who alone is right, `fir` or another, as Markdown, and what the tests say."""
    cells = []
    for name, table in found.items():
        for rival in RIVALS:
            for pair in zip(table["fir"], table[rival], strict=True):
                ours, theirs = pair
                won = (ours & ~theirs).sum(axis=1)
                lost = (theirs & ~ours).sum(axis=1)
                cells.append((name, rival, won, lost))
    counts = [(w, n - w) for *_, won, lost in cells for w, n in zip(won, won + lost, strict=True)]
    corrected = holm(np.array([mcnemar(*pair) for pair in counts]))
    head = ["recordings", "fir against", *(f"{snr_db} dB" for snr_db in SNRS_DB)]
    lines = [f"| {' | '.join(head)} |", "|---|---|" + "---|" * len(SNRS_DB)]
    for start in range(0, len(cells), len(SNRS_DB)):
        row = cells[start : start + len(SNRS_DB)]
        texts = []
        for place, (_, _, won, lost) in enumerate(row, start):
            p = corrected[2 * place : 2 * place + 2]
            texts.append(" / ".join(duel(w, n, q) for w, n, q in zip(won, lost, p, strict=True)))
        lines.append(f"| {row[0][0]} | {row[0][1]} | {' | '.join(texts)} |")
    sure = corrected < SURE
    ahead = np.array([won > lost for won, lost in counts])
    alone = np.array([mcnemar(*pair) for pair in counts]) < SURE
    lines.append("")
    lines.append(
        f"Of {len(counts)} tests `fir` is better in {np.sum(sure & ahead)} and worse in "
        f"{np.sum(sure & ~ahead)} (p < {SURE:g} after Holm's correction, in bold); each for "
        f"itself, better in {np.sum(alone & ahead)} and worse in {np.sum(alone & ~ahead)}."
    )
    return "\n".join(lines)


def duel(won: int, lost: int, p: float) -> str:
    """Return how often one of two alone is right, in bold where that is no chance."""
    text = f"+{won} -{lost}"
    return f"**{text}**" if p < SURE else text


def mcnemar(won: int, lost: int) -> float:
    """Return the probability that a fair coin divides so, or less evenly (McNemar 1947, exact)."""
    return float(binomtest(int(won), int(won + lost)).pvalue) if won + lost else 1.0


def main(count: int = 100, page: str | None = None) -> None:
    """Print the tables, or put them into a page."""
    tables = report(count)
    print(tables)
    if page:
        said = f"{count} recordings of each kind, of measured responses at least as many."
        write_between(Path(page), f"\n{tables}\n\n{said}\n", markers=MARKERS)


if __name__ == "__main__":
    main(*(int(word) if word.isdigit() else word for word in sys.argv[1:]))  # type: ignore[arg-type]
