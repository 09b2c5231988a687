"""What every observation of a robot shares: microphones, burst, engine for responses, noises."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import microphone_positions
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.types import (
    SPEED_OF_SOUND,
    Array,
    MicArray,
    Noise,
    Pose,
    Probe,
    Room,
)
from echolearn.checks import check_speed
from echolearn.storage.identity import KIND


class Responder(Protocol):
    """An engine for room impulse responses (`echolearn.simulation.responses`)."""

    def __call__(
        self,
        room: AnyRoom,
        source: Array,
        *,
        microphones: Array,
        sample_rate: float,
        speed_of_sound: float,
    ) -> Array:
        """Return impulse responses, (M, round(t60 * sample_rate)); a direct path has 1 / (4 pi d).

        Args:
            room: with its walls; its T60 gives their coefficients (Sabine) and the length.
            source: shape (3,), in m.
            microphones: shape (M, 3), in m.
            sample_rate: in Hz.
            speed_of_sound: in m/s.

        Raises:
            BadValue: what `responses.check_placement` refuses, or what the engine cannot do.
        """


@dataclass(frozen=True)
class Scene:
    """What every observation of a robot shares.

    Attributes:
        array: microphones around the loudspeaker.
        probe: the known burst.
        rir: engine for room impulse responses.
        noise: noise of each microphone for itself, at the SNR (f2).
        speed_of_sound: in m/s.
        diffuse: field of noise around the array, at the SDNR (f1), or None.
    """

    array: MicArray
    probe: Probe
    rir: Responder
    noise: Noise
    speed_of_sound: float = SPEED_OF_SOUND
    diffuse: Noise | None = None

    def __post_init__(self) -> None:
        check_speed("scene.speed_of_sound", self.speed_of_sound)

    @cached_property
    def direct(self) -> Array:
        """Direct path at the microphones, shape (M, N): the same at every pose."""
        hall = Room((20.0, 20.0, 20.0), 1.0)
        return self.received(replace(hall, walls=(0.0,) * 6), Pose(np.array([10.0, 10.0, 10.0])))

    @property
    def beginning(self) -> Array:
        """Direct path up to a sample behind which it is exactly 0, shape (M, at most N)."""
        return self.direct

    def received(self, room: AnyRoom, pose: Pose) -> Array:
        """Return the probe as received, x_m of Eq. 1, without noise, shape (M, N)."""
        response = self.rir(
            room,
            np.asarray(pose.position, dtype=float),
            microphones=microphone_positions(self.array, pose),
            sample_rate=self.probe.sample_rate,
            speed_of_sound=self.speed_of_sound,
        )
        return signals.convolve(self.probe.samples, response, length=self.probe.length)


def noise_kind(scene: Mapping[str, Any], *, sensor: bool = True) -> str:
    """Return the names of a scene's noises, "white" or "white+rotor".

    Args:
        scene: as plain containers.
        sensor: whether the microphones have noise of their own.
    """
    noises = [scene["noise"]] if sensor else []
    if scene["diffuse"] is not None:
        noises.append(scene["diffuse"].get("source", scene["diffuse"]))
    return "+".join(noise[KIND] for noise in noises)
