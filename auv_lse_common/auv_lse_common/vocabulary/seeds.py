"""Named random streams from one mission seed, so that runs are repeatable."""

import zlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """A random generator for the part `names` of a run with `seed`, for example `stream(seed, "planner", 2)`.

    Streams of different names are independent, so that a new part does not change the numbers of other parts.
    """
    keys = [zlib.crc32(str(name).encode()) for name in names]
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=keys))
