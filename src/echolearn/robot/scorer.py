"""What a robot runs: a bundle, read and proved, as a function from echoes to confidences and from
recordings to maps.

    scorer = load("runs/bundles/best")
    scorer(inputs)                      # (B, K) columns or (B, bands, M * M) tensors -> confidences (B,)
    scorer.update(observation, pose)    # a recording (M, N) -> the map points to believe, new ones only
    scorer.listen(observation, poses)   # recordings (B, M, N) -> all echoes, believed or not

    recording --localizer--> echoes --features--> inputs --model.onnx--> confidence --threshold-->
    points

Needs numpy, scipy and onnxruntime. `load` replays the bundle's 32 golden inputs and refuses a model
that answers otherwise here, so what was judged in the laboratory is what runs on the robot. It
computes on one core, in an arena
of limited size, without folding constants beforehand: a model that asks for more memory or time
    than any classifier
needs is refused instead of served.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from threading import Timer

import numpy as np

from echolearn.storage.files import MEND

os.environ.setdefault(
    "ORT_DISABLE_TELEMETRY", "1"
)  # which onnxruntime would keep in the home folder

import onnxruntime

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array, Echoes, EchoMap, Observation, Pose
from echolearn.checks import BadValue, check
from echolearn.evaluation.metrics import kept
from echolearn.localization.localize import localize
from echolearn.mapping.echo_map import echo_map
from echolearn.robot import bundle
from echolearn.storage import manifests

TOLERANCE = 1e-5
"""Largest difference in confidence between two machines."""

BLOCK = 4096
"""Inputs scored at once."""

MEMORY = 256 << 20
"""Bytes that a model may use while it computes."""

PATIENCE = 3.0
"""Seconds that the golden inputs may take; a classifier takes milliseconds."""

APART = 1e-3
"""m by which a microphone may be elsewhere than in the bundle."""

LIKENESS = 0.9
"""Correlation of a survey's probe with the bundle's; resampling takes a little of it."""


@dataclass(frozen=True)
class Heard:
    """What recordings of B poses hold.

    Attributes:
        echoes: fields (B, R), robot frame.
        map: their B * R points, pose by pose, with confidences, and kept by the bundle's threshold.
    """

    echoes: Echoes
    map: EchoMap


@dataclass(frozen=True)
class Scorer:
    """A bundle at work.

    Attributes:
        bundle: what it was loaded from.
        compute: float32 inputs (B, *shape) to confidences (B,).
    """

    bundle: bundle.Bundle
    compute: Callable[[Array], Array]

    def __call__(self, inputs: Array) -> Array:
        """Return the belief in each echo, 0 to 1, shape (B,).

        Args:
            inputs: the bundle's columns in its order and units, shape (B, K), or its tensor, (B,
                bands, M * M).

        Raises:
            BadValue: the wrong shape, or a value that is not finite in float32.
        """
        x, names = np.asarray(inputs), ", ".join(self.bundle.inputs)
        expected = (len(x) if x.ndim else 0, *self.bundle.shape)
        check(
            x.shape == expected,
            "inputs.shape",
            x.shape,
            allowed=f"(B, {str(expected[1:])[1:]} of {names}",
        )
        with np.errstate(over="ignore", invalid="ignore"):
            x = np.ascontiguousarray(x, dtype=np.float32)
        finite = bool(np.isfinite(x).all())
        check(
            finite,
            "inputs",
            "NaN or infinity",
            allowed="finite numbers",
            hint="was a silent recording analysed?",
        )
        blocks = [self.compute(x[start : start + BLOCK]) for start in range(0, len(x), BLOCK)]
        return np.concatenate([np.empty(0), *blocks])

    def listen(self, observation: Observation, poses: Sequence[Pose]) -> Heard:
        """Find, judge and place the echoes of B poses.

        Args:
            observation: samples (B, M, N), the direct path removed.
            poses: B poses, where each was heard.

        Raises:
            BadValue: another array, sample rate or probe than the bundle's, or a recording that
                cannot be analysed.
        """
        mount = self.check(observation)
        silent = np.flatnonzero(~observation.samples.any(axis=(-2, -1))).tolist()
        hint = "was the recorder running?"
        check(
            not silent,
            "observation.samples",
            f"silence in {silent[:3]}",
            allowed="recordings",
            hint=hint,
        )
        observation = replace(observation, array=self.bundle.array)
        names = self.bundle.inputs
        echoes, columns = localize(observation, self.bundle.localizer, names=names)
        inputs = (
            columns[names[0]]
            if self.bundle.is_tensor
            else np.stack([columns[name] for name in names], axis=1)
        )
        confidence = self(inputs).reshape(echoes.toa.shape)
        c, array = observation.speed_of_sound, observation.array
        turned = [replace(pose, heading=pose.heading + mount) for pose in poses]
        found = echo_map(echoes, turned, array=array, confidence=confidence, speed_of_sound=c)
        echoes = replace(echoes, azimuth=wrap(echoes.azimuth + mount)) if mount else echoes
        return Heard(echoes, replace(found, kept=kept(found.confidence, self.bundle.threshold)))

    def update(self, observation: Observation, pose: Pose) -> EchoMap:
        """Return the points that one recording adds to the map: those of echoes that are believed.

        Args:
            observation: samples (M, N), the direct path removed.
            pose: where it was recorded.

        Raises:
            BadValue: as `listen`.
        """
        alone = replace(observation, samples=observation.samples[None])
        found = self.listen(alone, [pose]).map
        new = np.asarray(found.kept)
        return EchoMap(found.points[new], found.confidence[new], new[new], found.poses[new])

    def check(self, observation: Observation) -> float:
        """Return the angle in rad by which the bundle's array is turned on this robot.

        Raises:
            BadValue: a recording that was not made with the bundle's array, sample rate and probe.
        """
        expected, array, probe = self.bundle, observation.array, observation.probe
        rate = expected.probe.sample_rate
        if probe.sample_rate != rate:
            said = f"bundle expects sample_rate={rate:g} Hz, survey has {probe.sample_rate:g} Hz"
            raise BadValue(
                f"{said}; resample with `echolearn map resample=true`, or: sox in.wav -r {rate:g} out.wav"
            )
        microphones = len(expected.array)
        check(
            len(array) == microphones,
            "microphones",
            len(array),
            allowed=f"{microphones}, the bundle's",
        )
        mount, off = _turn(expected.array.positions, array.positions)
        hint = "an array of another shape needs a classifier trained for it; are the microphones in the same order?"
        allowed = (
            f"at most {APART * 1000:g} mm from where the bundle's are, however they are turned"
        )
        check(
            off <= APART,
            "microphones",
            f"one is off by {off * 1000:.1f} mm",
            allowed=allowed,
            hint=hint,
        )
        channels = np.shape(observation.samples)[-2:-1]
        check(
            channels == (microphones,), "samples", f"{channels} channels", allowed=f"{microphones}"
        )
        likeness = _likeness(probe.samples, expected.probe.samples)
        hint, shown = (
            "play the bundle's probe.wav, or train with yours",
            f"correlates {likeness:.3f} with the bundle's",
        )
        check(likeness > LIKENESS, "probe", shown, allowed="the same burst", hint=hint)
        return mount


def load(path: str | Path) -> Scorer:
    """Return the scorer of a bundle, after replaying its golden inputs.

    Args:
        path: folder of the bundle; nothing in it is trusted.

    Raises:
        BadValue: the bundle is damaged or not allowed, or computes something else here than where
            it was made.
    """
    read = bundle.read(Path(path))
    name = f"{path}/model.onnx"
    options = onnxruntime.RunOptions()
    timer = Timer(PATIENCE, setattr, (options, "terminate", True))
    timer.daemon = True
    timer.start()
    try:
        compute = _open(read, name, options)
        x, expected = read.golden
        difference = np.abs(compute(x) - expected)
    finally:
        timer.cancel()
    hint = "this machine computes something else than the one that made the bundle"
    shown = f"golden confidences differ by {difference.max():.2g}"
    check(
        bool((difference <= TOLERANCE).all()),
        name,
        shown,
        allowed=f"at most {TOLERANCE:g}",
        hint=hint,
    )
    return Scorer(read, compute)


def verify(path: Path) -> str:
    """Return what there is to say of a sound bundle.

    Raises:
        BadValue: as `load`, with what mends it: the command that made it, where it still tells.
    """
    try:
        about = load(path).bundle.about
    except BadValue as error:
        try:
            mend = manifests.repair_hint(manifests.load_manifest(path, largest=manifests.FOREIGN))
        except BadValue:
            mend = "export it again"
        raise BadValue(
            f"{str(error).removesuffix(f'; {MEND}')}; {mend}, or copy it again"
        ) from None
    trained = f"model within {about['parity']['difference']:.1e} of the trained one on {about['parity']['trials']} inputs"
    return (
        f"whole, {len(about['files'])} files; {about['classifier']}, {bundle.GOLDEN} golden confidences reproduced; "
        f"{trained}"
    )


def _open(read: bundle.Bundle, name: str, run: onnxruntime.RunOptions) -> Callable[[Array], Array]:
    """Return the function that a bundle's model computes; every complaint of onnxruntime's becomes
    a `BadValue`.
    """
    _limit_memory()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.add_session_config_entry("session.load_model_format", "ONNX")
    cpu, skipped = ["CPUExecutionProvider"], ["ConstantFolding"]
    try:
        session = onnxruntime.InferenceSession(
            read.model, options, providers=cpu, disabled_optimizers=skipped
        )
        ends = [
            (end.name, end.type, len(end.shape))
            for end in (*session.get_inputs(), *session.get_outputs())
        ]
    except Exception as error:  # onnxruntime's own kinds have no common ancestor
        raise BadValue(f"{name}: onnxruntime refuses it ({_short(error)})") from None
    wanted = [("x", "tensor(float)", 1 + len(read.shape)), ("confidence", "tensor(double)", 1)]
    check(ends == wanted, name, ends, allowed=f"{wanted}")

    def compute(x: Array) -> Array:
        try:
            confidence = np.asarray(session.run(["confidence"], {"x": x}, run)[0])
        except Exception as error:
            raise BadValue(f"{name}: cannot be computed ({_short(error)})") from None
        right = confidence.shape == (len(x),) and bool(
            ((confidence >= 0) & (confidence <= 1)).all()
        )
        check(
            right,
            f"{name} confidence",
            f"of shape {confidence.shape}",
            allowed=f"{len(x)} numbers from 0 to 1",
        )
        return confidence

    return compute


@cache
def _limit_memory() -> None:
    """Let all sessions of this process that ask for it share one arena of `MEMORY` bytes."""
    kind, place = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, onnxruntime.OrtMemType.DEFAULT
    arena = onnxruntime.OrtArenaCfg({"max_mem": MEMORY, "arena_extend_strategy": 1})
    with suppress(Exception):  # there is one already: the host program's
        onnxruntime.create_and_register_allocator(
            onnxruntime.OrtMemoryInfo("Cpu", kind, 0, place), arena
        )


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]


def _turn(positions: Array, found: Array) -> tuple[float, float]:
    """Return the angle about z that brings microphones (M, 3) to those found, and the largest
    distance left.
    """
    if float(np.abs(positions - found).max()) <= 1e-6:
        return 0.0, 0.0
    here, there = positions[:, 0] + 1j * positions[:, 1], found[:, 0] + 1j * found[:, 1]
    angle = float(np.angle(np.sum(here.conj() * there)))
    off = np.hypot(np.abs(here * np.exp(1j * angle) - there), positions[:, 2] - found[:, 2])
    return angle, float(off.max())


def _likeness(first: Array, second: Array) -> float:
    """Return the normalised correlation of two bursts, 0 if one is much longer."""
    n = max(len(first), len(second))
    a, b = (np.pad(burst, (0, n - len(burst))) for burst in (first, second))
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))
