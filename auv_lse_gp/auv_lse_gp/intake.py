"""What a vehicle's map does in a tick: takes what has come in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from numpy.typing import ArrayLike

from auv_lse_gp.depth_map import DepthMap


class MapIntake:
    """Soundings and samples that wait for the map, and the order in which it takes them.

    Attributes:
        map: The map.
    """

    def __init__(self, depth_map: DepthMap) -> None:
        """Nothing waits yet."""
        self.map = depth_map
        self._soundings: list[Sequence[float]] = []
        self._samples: list[tuple[float, int, ArrayLike]] = []

    def add_soundings(self, rows: Iterable[Sequence[float]]) -> None:
        """Own soundings: stamp (s), north, east, depth (m) of each."""
        self._soundings.extend(rows)

    def add_samples(self, stamp_s: float, source: int, samples: ArrayLike) -> None:
        """A mate's samples: end of reception (s), number of the sender; north, east, depth (m) of each, (n, 3)."""
        self._samples.append((stamp_s, source, samples))

    def step(self) -> bool:
        """The map takes own soundings by stamp, then samples by stamp and source; returns False if nothing waited."""
        waited = bool(self._soundings or self._samples)
        if self._soundings:
            self.map.add_soundings(self._soundings)
            self._soundings = []
        for _, source, samples in sorted(self._samples, key=lambda entry: entry[:2]):
            self.map.add_samples(samples, source)
        self._samples = []
        return waited
