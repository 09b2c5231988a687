"""Matched filters of many rows at once by torch, on a GPU where there is one.

The sums are those of `signals.matched_filter`, in double precision, and of
`correlations.steered_response`, in single:

    r_m = irfft(rfft(y_m) conj(rfft(s))),   J = irfft(sum_m rfft(r_m) exp(j omega eta_m(phi)))

torch rounds otherwise than SciPy, and each kind of device in its own way, so a set made with either
has an identity of its own, and is made on one kind of device. What a localizer computes besides,
such as J between samples or of recordings whitened in space, is compiled.
"""

from functools import partial

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.localization.correlations import steering_phases
from echolearn.localization.matched_filter import COMPILED, Filters
from echolearn.simulation.torch_device import check_device


def filters_of(name: str) -> Filters:
    """Return what computes matched filters: the compiled ones, or torch on a device.

    Raises:
        BadValue: a device that is not there.
    """
    if name == "compiled":
        return COMPILED
    check_device("plan.matched_filters", name, hint="compiled and cpu need no GPU")
    return Filters(partial(correlate, device=name), partial(steer, device=name))


def correlate(samples: Array, probe: Probe, *, first: int, last: int, device: str) -> Array:
    """Correlate recordings with the probe, as `signals.matched_filter` does.

    Args:
        samples: recordings, shape (..., N).
        probe: its burst has L samples.
        first, last: lags wanted, both inclusive, 0 <= first <= last.
        device: of torch.

    Returns:
        Correlation, shape (..., last - first + 1), float64.
    """
    import torch

    lags = last - first + 1
    burst = len(probe.samples)
    size = fft.next_fast_len(lags + burst - 1, real=True)
    # Only what the burst touches travels to the device.
    touched = np.ascontiguousarray(samples[..., first : last + burst], dtype=float)
    pair = [torch.from_numpy(each).to(device) for each in (touched, probe.samples.astype(float))]
    heard, played = (torch.fft.rfft(each, size) for each in pair)
    found: Array = torch.fft.irfft(heard * played.conj(), size)[..., :lags].cpu().numpy()
    return found


def steer(
    correlation: Array,
    array: MicArray,
    *,
    directions: tuple[Array, Array],
    scale: float,
    device: str,
) -> Array:
    """Return J(tau, phi), as `correlations.steered_response` does, shape (B, A, L), float32.

    Args:
        correlation: r_m, shape (B, M, L).
        array: M microphones.
        directions: azimuths and elevations, each of shape (A,), in rad.
        scale: sample_rate / speed_of_sound, in samples per m.
        device: of torch.
    """
    import torch

    size = correlation.shape[-1]
    azimuth, elevation = (angle.tobytes() for angle in directions)
    phases = steering_phases(array, azimuth, elevation=elevation, size=size, scale=scale)
    spectrum = torch.fft.rfft(torch.from_numpy(correlation.astype(np.float32)).to(device))
    turned = torch.einsum("bmf,fma->baf", spectrum, torch.from_numpy(phases).to(device))
    found: Array = torch.fft.irfft(turned, size).cpu().numpy()
    return found
