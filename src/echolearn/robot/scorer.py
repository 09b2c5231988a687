"""What a robot runs: a bundle as a function from recordings to confidences and maps.

    scorer = load("runs/bundles/best")
    scorer(inputs)                     # columns (B, K) or tensors (B, bands, M * M)
                                       # -> confidences (B,)
    scorer.update(observation, pose)   # a recording (M, N) -> the map points to believe
    scorer.score(observation, poses)   # recordings (B, M, N) -> all echoes, believed or not

    recording --localizer--> echoes --features--> inputs --model.onnx--> confidence --threshold-->
    points

Needs numpy, scipy and onnxruntime. `load` replays the bundle's 32 golden inputs and refuses a model
that answers otherwise here (`model`), so what was evaluated in the laboratory is what runs on the
robot. A bundle that is new here is loaded by another process first (`examination`): one that asks
for more memory or time than any classifier needs is refused instead of served.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array, Echoes, EchoMap, Observation, Pose
from echolearn.checks import BadValue, check
from echolearn.evaluation.metrics import kept
from echolearn.localization.localize import localize
from echolearn.mapping.echo_map import echo_map
from echolearn.robot.bundle import Bundle
from echolearn.robot.compatibility import mount_angle
from echolearn.robot.examination import examined
from echolearn.robot.model import replay
from echolearn.storage import manifests
from echolearn.storage.advice import MEND, repair_hint

BLOCK = 4096
"""Inputs scored at once."""


@dataclass(frozen=True)
class ScoredEchoes:
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
        compute: function from float32 inputs (B, ...) to confidences (B,).
    """

    bundle: Bundle
    compute: Callable[[Array], Array]

    def __repr__(self) -> str:
        """Name the bundle; what it holds would fill pages."""
        about = self.bundle.about
        inputs = ", ".join(self.bundle.inputs)
        return f"<Scorer {about['name']}: {about['classifier']} of {inputs}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what it is, on what it was trained, how it cuts."""
        about = self.bundle.about
        told = f"trained on {about['trained_on']}; {about['threshold']['chosen']}"
        return f"<p>{escape(repr(self)[1:-1])}</p><p>{escape(told)}</p>"

    def __call__(self, inputs: Array) -> Array:
        """Return the belief in each echo, 0 to 1, shape (B,).

        Args:
            inputs: the bundle's columns in its order and units, shape (B, K), or its tensor, (B,
                bands, M * M).

        Raises:
            BadValue: the wrong shape, or a value that is not finite in float32.
        """
        x = np.asarray(inputs)
        sizes = ", ".join(map(str, ("B", *self.bundle.shape)))
        fits = x.ndim > 0 and x.shape[1:] == self.bundle.shape
        allowed = f"must be ({sizes}) of {', '.join(self.bundle.inputs)}"
        check(fits, "inputs.shape", x.shape, allowed=allowed)
        with np.errstate(over="ignore", invalid="ignore"):
            x = np.ascontiguousarray(x, dtype=np.float32)
        finite = bool(np.isfinite(x).all())
        hint = "was a silent recording analysed?"
        check(finite, "inputs", "NaN or infinity", allowed="must be finite numbers", hint=hint)
        # Block by block, lest many inputs exhaust the memory that the model may use.
        blocks = [self.compute(x[start : start + BLOCK]) for start in range(0, len(x), BLOCK)]
        return np.concatenate([np.empty(0), *blocks])

    def score(self, observation: Observation, poses: Sequence[Pose]) -> ScoredEchoes:
        """Localize, score and place the echoes of B poses.

        Args:
            observation: samples (B, M, N), the direct path removed.
            poses: B poses, at which they were recorded.

        Raises:
            BadValue: another array, sample rate or probe than the bundle's, or a recording that
                cannot be analysed.
        """
        allowed = "must judge single echoes"
        hint = "it judges walls of whole walks, which echolearn map does"
        name = self.bundle.about["name"]
        check(self.bundle.hypotheses is None, "bundle", name, allowed=allowed, hint=hint)
        mount = self.mount(observation)
        bundle = self.bundle
        names = bundle.inputs
        # The classifier was trained in the bundle's frame, in which this array is not turned.
        aligned = replace(observation, array=bundle.array)
        echoes, columns = localize(aligned, bundle.localizer, names=names)
        inputs = [columns[name] for name in names]
        confidence = self(inputs[0] if bundle.is_tensor else np.stack(inputs, axis=1))

        turned = [replace(pose, heading=pose.heading + mount) for pose in poses]
        found = echo_map(
            echoes,
            turned,
            array=bundle.array,
            confidence=confidence,
            speed_of_sound=observation.speed_of_sound,
        )
        if mount:
            echoes = replace(echoes, azimuth=wrap(echoes.azimuth + mount))
        return ScoredEchoes(echoes, replace(found, kept=kept(confidence, bundle.threshold)))

    def update(self, observation: Observation, pose: Pose) -> EchoMap:
        """Return the points that one recording adds to the map: those of echoes that are believed.

        Args:
            observation: samples (M, N), the direct path removed.
            pose: where it was recorded.

        Raises:
            BadValue: as `score`.
        """
        alone = replace(observation, samples=observation.samples[None])
        found = self.score(alone, [pose]).map
        new = np.asarray(found.kept)
        return EchoMap(found.points[new], found.confidence[new], new[new], found.poses[new])

    def mount(self, observation: Observation) -> float:
        """Return the angle of the array on this robot, in rad.

        Raises:
            BadValue: another robot, or a recording that is silent.
        """
        mount = mount_angle(self.bundle, array=observation.array, probe=observation.probe)
        silent = np.flatnonzero(~observation.samples.any(axis=(-2, -1))).tolist()
        shown = f"silence in {silent[:3]}"
        hint = "was the recorder running?"
        check(not silent, "observation.samples", shown, allowed="must be recordings", hint=hint)
        return mount


def load(path: str | Path) -> Scorer:
    """Return the scorer of a bundle, after replaying its golden inputs.

    Args:
        path: folder of the bundle; nothing in it is trusted.

    Raises:
        BadValue: the bundle is damaged or not allowed, or computes something else here than where
            it was made.
    """
    folder = Path(path)
    digest = examined(folder)
    bundle, compute = replay(folder)
    same = bundle.about["sha256"] == digest
    allowed = "must stay as it is while it is loaded"
    check(same, "bundle", folder, allowed=allowed, hint="load it again")
    return Scorer(bundle, compute)


def verify_bundle(path: Path) -> str:
    """Return what there is to say of a sound bundle.

    Raises:
        BadValue: as `load`, with what mends it: the command that made it, where it is still known.
    """
    try:
        about = load(path).bundle.about
    except BadValue as error:
        mend = "export it again"
        with suppress(BadValue):
            mend = repair_hint(manifests.load_manifest(path, largest=manifests.FOREIGN), path)
        reason = str(error).removesuffix(f"; {MEND}")
        raise BadValue(f"{reason}; {mend}, or copy it again") from None
    parity = about["parity"]
    return (
        f"whole, {len(about['files'])} files; {about['classifier']}, "
        f"{about['golden']} golden confidences reproduced; model within {parity['difference']:.1e} "
        f"of the trained one on {parity['trials']} inputs"
    )
