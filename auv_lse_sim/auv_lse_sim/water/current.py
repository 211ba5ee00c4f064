"""The current: a mean, a tide, and a slow random part (first-order Gauss-Markov)."""

import math

import numpy as np

from auv_lse_common.mission_file.sections.world import CurrentConfig
from auv_lse_common.support.arrays import Array


class Current:
    """The current of one mission, the same everywhere.

    north(t), east(t) = mean + tide_mps cos(2 pi t / period + phase) (cos h, sin h) + g(t), where g is a stationary
    Gauss-Markov process of each component with the given standard deviation and correlation time (Gelb 1974, 3.8).

    Args:
        rng: Source of its random numbers (stream "current").
        ideal: Still water, whatever `config` is.
    """

    def __init__(self, config: CurrentConfig, rng: np.random.Generator, ideal: bool = False) -> None:
        """Draws the random part's first value."""
        self._config = config
        self._rng = rng
        self._still = config.ideal or ideal
        self._random = config.random_mps * rng.standard_normal(2)

    def advance(self, start_s: float, stamps_s: Array) -> Array:
        """Current north, east (n, 2), m/s, at growing times after `start_s`, the end of the last call."""
        normals = self._rng.standard_normal(2)
        if self._still or not len(stamps_s):
            return np.zeros((len(stamps_s), 2))
        c = self._config
        decay = math.exp(-(float(stamps_s[-1]) - start_s) / c.random_time_s)
        before = self._random
        self._random = decay * before + math.sqrt(1.0 - decay * decay) * c.random_mps * normals
        share = ((stamps_s - start_s) / (float(stamps_s[-1]) - start_s))[:, None]  # linear within the short tick
        heading = math.radians(c.tide_heading_deg)
        tide = c.tide_mps * np.cos(2.0 * math.pi * stamps_s / c.tide_period_s + math.radians(c.tide_phase_deg))
        flow: Array = (
            np.array([c.north_mps, c.east_mps])
            + tide[:, None] * np.array([math.cos(heading), math.sin(heading)])
            + (1.0 - share) * before
            + share * self._random
        )
        return flow
