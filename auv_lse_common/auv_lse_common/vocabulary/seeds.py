"""Named random streams from one mission seed, so that every part draws from its own and runs repeat."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """A Generator for the part called `names` (for example `stream(seed, "planner", 2)`) of a run with `seed`.

    Streams of different names are independent; adding a part does not shift the numbers of another.
    """
    keys = [zlib.crc32(str(name).encode()) for name in names]
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=keys))
