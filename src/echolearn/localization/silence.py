"""Silent microphones: some estimators leave them out, so they are told by a warning.

A microphone is silent whose power is 40 dB below the median of its neighbours, or whose samples
never change. An estimator that has only microphone 1 refuses if it is that one.
"""

import warnings
from collections.abc import Iterator

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check

SILENT = 1e-4
"""Power relative to the median microphone below which one counts as silent."""


class SilentMicrophone(UserWarning):
    """A microphone is silent and is left out."""


def energies(samples: Array) -> Array:
    """Return the energy of recordings (B, M, N), shape (B, M), not finite if a sample is not."""
    # Who calls asks whether it is finite: a warning would say it twice.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.vecdot(samples, samples)


def stuck(samples: Array) -> Array:
    """Tell which recordings (B, M, N) never change, shape (B, M), bool."""
    # Most do change within every 31st sample, so the whole is read only where these are alike.
    still = np.ptp(samples[..., ::31], axis=-1) == 0
    still[still] = np.ptp(samples[still], axis=-1) == 0
    return still


def silent_microphones(samples: Array, energy: Array | None = None) -> Array:
    """Tell which microphones are silent, shape (B, M), bool; none where all are.

    Args:
        samples: recordings, shape (B, M, N).
        energy: theirs, shape (B, M), if it is known already.
    """
    energy = energies(samples) if energy is None else energy
    quiet = (energy <= SILENT * np.median(energy, axis=-1, keepdims=True)) | stuck(samples)
    return quiet & ~quiet.all(axis=-1, keepdims=True)


def alike(silent: Array) -> Iterator[tuple[Array, Array]]:
    """Yield recordings with the same silent microphones (B, M): their rows, and which these are."""
    for pattern in np.unique(silent, axis=0):
        yield np.flatnonzero((silent == pattern).all(axis=-1)), pattern


def warn_of_silent(silent: Array, *, reference: bool) -> None:
    """Warn of silent microphones, (B, M); refuse them if the first is one and is the `reference`.

    Raises:
        BadValue: microphone 1 is silent and needed.
    """
    if not silent.any():
        return
    check(
        not (reference and silent[:, 0].any()),
        "observation.samples",
        "silence at microphone 1",
        allowed="this localizer takes times from microphone 1 alone",
        hint="localizer=joint and localizer=em, or a bundle trained with one of them, need it not",
    )
    names = ", ".join(str(channel + 1) for channel in np.flatnonzero(silent.any(axis=0)))
    rows = f"{int(silent.any(axis=-1).sum())} of {len(silent)} observations"
    message = f"observation.samples: microphone {names} is silent in {rows} and is left out there"
    # Levels: this function, `prepare`, the localizer, whoever called it.
    warnings.warn(message, SilentMicrophone, stacklevel=4)
