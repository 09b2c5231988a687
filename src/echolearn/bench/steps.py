"""Steps between a plan and its records, per observation, on one thread: which takes the time.

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
from echolearn.acoustics.types import Observation
from echolearn.bench.measurement import Measurement, Setting, observations
from echolearn.dataset.plans import Plan
from echolearn.dataset.records import records
from echolearn.localization import beamforming
from echolearn.localization.localize import describe
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.separation import separate
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant
from echolearn.simulation.observe import add_noise
from echolearn.storage import manifests

Work = Callable[[], object]
Step = tuple[str, Work, Work | None]
"""Name, the step, and its peer if there is one."""


def steps(setting: Setting) -> Iterator[Measurement]:
    """Time every step per observation, beside what SciPy and NumPy offer."""
    plan = setting.plan
    count = min(setting.batch, len(plan))
    observation = observations(plan, count)
    with TemporaryDirectory(dir=setting.place) as place:
        known = [
            *simulating(plan, count),
            *estimating(plan, observation),
            *writing(plan, count, place=Path(place)),
        ]
        for name, work, peer in track(known, "bench steps"):
            contestants = {name: Contestant(work, units=count)}
            if peer is not None:
                contestants[f"{name}, SciPy or NumPy"] = Contestant(peer, units=count)
            yield from setting.compare("steps", contestants)


def simulating(plan: Plan, count: int) -> Iterator[Step]:
    """Yield what makes `count` recordings."""
    rng = np.random.default_rng(0)
    scene = plan.scene
    spot = plan.spot(0, rng)
    received = scene.received(spot.room, spot.pose)
    burst = scene.probe.samples
    length = round(spot.room.t60 * scene.probe.sample_rate)
    responses = rng.standard_normal((count, len(scene.array), length))
    yield (
        "convolution",
        lambda: [signals.convolve(burst, each, length=scene.probe.length) for each in responses],
        lambda: [signal.fftconvolve(burst[None], each, axes=-1) for each in responses],
    )
    yield (
        "noise",
        lambda: [add_noise(received, scene, levels=spot.levels, rng=rng) for _ in responses],
        None,
    )


def estimating(plan: Plan, observation: Observation) -> Iterator[Step]:
    """Yield what makes records of observations (B, M, N)."""
    probe = observation.probe
    samples = observation.samples
    first, last = plan.window.lags(
        observation.array, probe.sample_rate, speed_of_sound=observation.speed_of_sound
    )
    yield (
        "matched filter",
        lambda: signals.matched_filter(samples, probe, first=first, last=last),
        lambda: signal.correlate(samples, probe.samples[None, None], mode="valid", method="fft"),
    )
    yield "steered response", lambda: MatchedFilter(observation, plan.window).steered, None
    single = samples.astype(np.float32)
    yield (
        "STFT",
        lambda: signals.stft(single),
        lambda: signal.stft(single, nperseg=signals.STFT_FRAME, boundary=None, padded=False),
    )
    spectra = signals.stft(single)
    yield (
        "covariance",
        lambda: beamforming.covariance(spectra),
        lambda: np.einsum("bmft,bnft->bfmn", spectra, spectra.conj()) / spectra.shape[-1],
    )
    whole = beamforming.recording_covariance(observation)
    loaded = beamforming.regularize(whole, 0.1)
    yield "inverse", lambda: beamforming.invert(loaded), lambda: np.linalg.inv(loaded)
    yield (
        "MPDR spectrum",
        lambda: beamforming.Mpdr()(observation, whole),
        None,
    )
    echoes = plan.localizer(observation)

    # A view keeps what it has computed, so each call gets a fresh one.
    def described() -> object:
        """Compute the columns of the echoes."""
        view = MatchedFilter(observation, plan.window)
        return describe(separate(view, echoes), echoes)

    yield "all features", described, None


def writing(plan: Plan, count: int, *, place: Path) -> Iterator[Step]:
    """Yield how records are written: with checksum, sync and rename, or plainly.

    Args:
        plan: of the records.
        count: number of observations.
        place: folder for the files.
    """
    # A real shard: what an array of zeros costs would say nothing of the disk.
    table = records(plan, range(count))

    def plainly() -> None:
        """Save the same rows with no promise about the disk."""
        buffer = BytesIO()
        np.save(buffer, table, allow_pickle=False)
        (place / "plain.npy").write_bytes(buffer.getvalue())

    yield "writing", lambda: manifests.write_shard(place, 0, array=table), plainly
