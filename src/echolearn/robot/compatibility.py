"""Is this the robot that a bundle was made for? Its microphones, sample rate and probe must be.

The array may be turned about its axis (`acoustics.turned_array`).
"""

import numpy as np
from scipy import fft

from echolearn.acoustics.turned_array import DISPLACED, turn_between
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import BadValue, check
from echolearn.robot.bundle import Bundle

LIKENESS = 0.9
"""Correlation of a survey's probe with the bundle's; resampling takes a little of it."""


def mount_angle(bundle: Bundle, *, array: MicArray, probe: Probe) -> float:
    """Return the angle in rad by which the bundle's array is turned on this robot.

    Args:
        bundle: what the robot should be like.
        array: microphones of the robot.
        probe: burst that it emitted.

    Raises:
        BadValue: another array, sample rate or probe than the bundle's.
    """
    rate = bundle.probe.sample_rate
    if probe.sample_rate != rate:
        rates = f"bundle expects sample_rate={rate:g} Hz, survey has {probe.sample_rate:g} Hz"
        mend = f"resample=true, or: sox in.wav -r {rate:g} out.wav"
        raise BadValue(f"{rates}; resample with {mend}")

    # Positions can be compared only where there are as many.
    count = len(bundle.array)
    allowed = f"must be {count}, the bundle's"
    check(len(array) == count, "microphones", len(array), allowed=allowed, hint=made_for(bundle))
    angle, off = turn_between(bundle.array.positions, array.positions)
    allowed = f"must be at most {DISPLACED * 1000:g} mm from the bundle's, however they are turned"
    shown = f"one is off by {off * 1000:.1f} mm"
    hint = f"{made_for(bundle)}; or are the microphones in another order?"
    check(off <= DISPLACED, "microphones", shown, allowed=allowed, hint=hint)

    # A gain does not matter, so it is the normalised correlation that tells.
    likeness = _correlation(probe.samples, bundle.probe.samples)
    shown = f"correlates {likeness:.3f} with the bundle's"
    hint = _shifted(probe.samples, bundle.probe.samples)
    check(likeness > LIKENESS, "probe", shown, allowed="must be the same burst", hint=hint)
    return angle


def _shifted(found: Array, wanted: Array) -> str:
    """Return what to do about another burst, which may be the same, moved or turned."""
    size = fft.next_fast_len(len(found) + len(wanted), real=True)
    product = fft.rfft(found, size) * fft.rfft(wanted, size).conj()
    norm = max(float(np.linalg.norm(found) * np.linalg.norm(wanted)), 1e-300)
    alike = fft.irfft(product, size) / norm
    lag = int(np.abs(alike).argmax())
    if abs(alike[lag]) <= LIKENESS:
        return "play the bundle's probe.wav, or train with yours"
    late = lag - size if lag > size // 2 else lag
    if late > 0:
        return f"it begins {late} samples late: cut these off probe.wav and off every recording"
    if late < 0:
        return (
            f"its first {-late} samples are missing: put them back, and silence before recordings"
        )
    return "its sign is turned: take the bundle's probe.wav"


def made_for(bundle: Bundle) -> str:
    """Return for which array a bundle was made, and what to do with another."""
    array = bundle.array
    made = f"{bundle.about['name']} was made for {len(array)} microphones"
    reach = f"the farthest {array.radius * 1000:.0f} mm from the loudspeaker"
    return f"{made}, {reach}: for this array train one (docs/arrays.md), and name it, bundle=..."


def _correlation(first: Array, second: Array) -> float:
    """Return the normalised correlation of two bursts, 0 if one is much longer."""
    length = max(len(first), len(second))
    a = np.pad(first, (0, length - len(first)))
    b = np.pad(second, (0, length - len(second)))
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))
