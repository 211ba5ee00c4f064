"""Reliability of P(deep enough), the probability of being deep enough (Murphy and Winkler, 1977).

A map is reliable if a share p of all locations that it calls safe with probability p is safe. Most locations of a map
are nearly certain, so the classes of probability are narrow at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array

#: Limits of the classes of probability; each includes its lower limit, the last one both.
EDGES = (0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
CLASSES = len(EDGES) - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """Locations by class of probability.

    Attributes:
        cells: Locations in each class, shape (`CLASSES`,).
        expected: Expected number of safe locations: the sum of their probabilities, shape (`CLASSES`,).
        safe: Number of safe locations, shape (`CLASSES`,).
    """

    cells: tuple[int, ...]
    expected: tuple[float, ...]
    safe: tuple[int, ...]

    @classmethod
    def of(cls, p_safe: ArrayLike, safe: ArrayLike) -> Reliability:
        """The reliability of probabilities (P,) of being safe at locations that are safe or not (P,).

        Raises:
            ValueError: if the lengths differ, or a probability is not from 0 to 1.
        """
        p, is_safe = np.asarray(p_safe, dtype=float).ravel(), np.asarray(safe, dtype=bool).ravel()
        if p.shape != is_safe.shape:
            raise ValueError(f"p_safe has {p.size} values, but safe has {is_safe.size}")
        if not ((p >= 0.0) & (p <= 1.0)).all():
            raise ValueError(f"p_safe has values from {p.min()} to {p.max()}, but probabilities are from 0 to 1")
        which = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, CLASSES - 1)
        return cls(
            cells=tuple(np.bincount(which, minlength=CLASSES).tolist()),
            expected=tuple(np.bincount(which, p, minlength=CLASSES).tolist()),
            safe=tuple(np.bincount(which[is_safe], minlength=CLASSES).tolist()),
        )

    @classmethod
    def together(cls, parts: Sequence[Reliability]) -> Reliability:
        """The sums over several maps."""

        def added(name: str) -> tuple[Any, ...]:
            rows = [getattr(part, name) for part in parts]
            return tuple(np.sum(rows, axis=0).tolist()) if rows else (0,) * CLASSES

        return cls(cells=added("cells"), expected=added("expected"), safe=added("safe"))

    @property
    def probabilities(self) -> Array:
        """Mean probability of each class's locations, shape (`CLASSES`,); NaN in a class without locations."""
        return self._shares(self.expected)

    @property
    def shares(self) -> Array:
        """Share of each class's locations that are safe, shape (`CLASSES`,); NaN in a class without locations."""
        return self._shares(self.safe)

    def _shares(self, counts: Sequence[float]) -> Array:
        cells = np.asarray(self.cells)
        shares: Array = np.divide(counts, cells, out=np.full(CLASSES, np.nan), where=cells > 0.0)
        return shares

    @property
    def error(self) -> float:
        """Mean over all locations of |share safe - mean probability| of their class (expected calibration error)."""
        total = sum(self.cells)
        off = np.abs(np.asarray(self.safe) - np.asarray(self.expected)).sum()
        return float(off / total) if total else float("nan")
