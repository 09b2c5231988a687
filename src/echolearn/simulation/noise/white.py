"""White noise (the paper's f2): Gaussian samples, independent in time and between microphones."""

from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array, MicArray


@dataclass(frozen=True)
class White:
    """White Gaussian sensor noise."""

    def __call__(
        self, array: MicArray, *, length: int, sample_rate: float, rng: np.random.Generator
    ) -> Array:
        """Return noise of unit variance, shape (M, length); white at any `sample_rate`."""
        from echolearn.simulation.normal_loops import standard_normal

        return standard_normal(rng, (len(array), length))
