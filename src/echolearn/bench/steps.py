"""Steps between a plan and its records, per observation, on one thread: which of them takes the
time.

Peers are what SciPy and NumPy offer for the same: `fftconvolve`, `correlate`, `stft`, `einsum`,
    `linalg.inv`, `save`.
"""

from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import signal

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, Observation
from echolearn.bench.measurement import Measurement, Setting, heard, times
from echolearn.dataset.plans import Plan
from echolearn.dataset.records import records
from echolearn.localization import beamforming, features
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant
from echolearn.simulation.observe import add_noise
from echolearn.storage import manifests

STAGE = "steps"
Step = tuple[str, Callable[[], object], Callable[[], object] | None]


def steps(setting: Setting) -> Iterator[Measurement]:
    """Time every step per observation, beside what SciPy and NumPy offer."""
    plan, count = setting.plan, min(setting.batch, len(setting.plan))
    observation = heard(plan, count)
    with TemporaryDirectory(dir=setting.place) as place:
        for name, own, other in track(
            [*simulating(plan, count), *estimating(plan, observation, Path(place))], "bench"
        ):
            both = {name: own} | ({f"{name}, SciPy or NumPy": other} if other else {})
            laps = setting.race({key: Contestant(work, units=count) for key, work in both.items()})
            yield from times(STAGE, laps, reference=name if other else "")


def simulating(plan: Plan, count: int) -> Iterator[Step]:
    """Yield what makes `count` recordings."""
    rng, scene = np.random.default_rng(0), plan.scene
    spot = plan.spot(0, rng)
    received, burst, length = (
        scene.received(spot.room, spot.pose),
        scene.probe.samples,
        scene.probe.length,
    )
    response = rng.standard_normal(
        (count, len(scene.array), round(spot.room.t60 * scene.probe.sample_rate))
    )

    def noisy() -> None:
        for _ in range(count):
            add_noise(received, scene, levels=spot.levels, rng=rng)

    yield (
        "convolution",
        lambda: [signals.convolve(burst, one, length=length) for one in response],
        lambda: [signal.fftconvolve(burst[None], one, axes=-1) for one in response],
    )
    yield "noise", noisy, None


def estimating(plan: Plan, observation: Observation, place: Path) -> Iterator[Step]:
    """Yield what makes records of observations (B, M, N), and writes them."""
    probe, samples, count = observation.probe, observation.samples, len(observation.samples)
    single, echoes = samples.astype(np.float32), plan.localizer(observation)
    first, last = plan.window.lags(
        observation.array, probe.sample_rate, speed_of_sound=observation.speed_of_sound
    )
    whole = beamforming.recording_covariance(observation)
    loaded, spectra = beamforming.regularize(whole, 0.1), signals.stft(single)
    table = records(plan, range(min(count, len(plan))))
    yield (
        "matched filter",
        lambda: signals.matched_filter(samples, probe, first=first, last=last),
        lambda: signal.correlate(samples, probe.samples[None, None], mode="valid", method="fft"),
    )
    yield "steered response", lambda: fresh(plan, observation).steered, None
    yield (
        "STFT",
        lambda: signals.stft(single),
        lambda: signal.stft(single, nperseg=signals.STFT_FRAME, boundary=None, padded=False),
    )
    yield (
        "covariance",
        lambda: beamforming.covariance(spectra),
        lambda: np.einsum("bmft,bnft->bfmn", spectra, spectra.conj()) / spectra.shape[-1],
    )
    yield "inverse", lambda: beamforming.invert(loaded), lambda: np.linalg.inv(loaded)
    yield "MPDR spectrum", lambda: beamforming.Mpdr()(observation, whole), None
    yield "all features", lambda: features.describe(fresh(plan, observation), echoes), None
    yield "writing", lambda: manifests.write_shard(place, 0, table), lambda: unproved(place, table)


def fresh(plan: Plan, observation: Observation) -> MatchedFilter:
    """Return a matched-filter view that has computed nothing yet."""
    return MatchedFilter(observation, plan.window)


def unproved(place: Path, table: Array) -> None:
    """Write records without checksum, sync and rename."""
    buffer = BytesIO()
    np.save(buffer, table, allow_pickle=False)
    (place / "plain.npy").write_bytes(buffer.getvalue())
