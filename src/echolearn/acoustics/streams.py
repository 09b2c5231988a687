"""Streams of random numbers by purpose: no draw depends on what else is drawn.

    stream(seed, "observation", row)     draws what is random about one row of a set

Each stream is numpy's `SeedSequence(seed, spawn_key=key)`, and the key is made from the purpose and
its index by the table below. The keys are those under which the first published numbers were drawn,
so they are not changed: a new purpose gets a key that no other has.
"""

import numpy as np

KEYS: dict[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
    "observation": ((), ()),
    "noise alone": ((), (1,)),
    "realism": ((), (2,)),
    "strips": ((), (3,)),
    "walk": ((), (4,)),
    "place": ((0,), ()),
    "fault": ((1,), ()),
    "trial": ((2,), ()),
    "guess": ((3,), ()),
    "burst": ((4,), ()),
    "stretch": ((5,), ()),
}
"""What stands before and after the index in the key of each purpose. The first five belong to sets
and surveys (index: row, pose or walk), the others to studies (index: place or trial), which never
share a seed's streams with them."""


def stream(seed: int, purpose: str, *index: int) -> np.random.Generator:
    """Return the generator of one purpose.

    Args:
        seed: of everything random in a set, survey or study.
        purpose: one of `KEYS`.
        index: which row, pose, place or trial it is for.
    """
    before, after = KEYS[purpose]
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(*before, *index, *after)))
