"""The minimum spacing of kernel centers: which of the places that are kept is too close to a new one."""

from __future__ import annotations

import math


class SpacingIndex:
    """Finds kept places within the minimum spacing of a new one, by a grid of cells of that size."""

    def __init__(self, spacing_m: float) -> None:
        """Starts without places; a spacing of 0 finds none too close."""
        self._spacing_m = spacing_m
        self._cells: dict[tuple[int, int], list[tuple[float, float, int]]] = {}
        self._kept: list[tuple[int, int]] = []  # the cell of each place

    def __len__(self) -> int:
        """Number of places."""
        return len(self._kept)

    def _cell(self, north_m: float, east_m: float) -> tuple[int, int]:
        if self._spacing_m <= 0.0:
            return 0, 0
        return math.floor(north_m / self._spacing_m), math.floor(east_m / self._spacing_m)

    def add(self, north_m: float, east_m: float) -> None:
        """Adds a place; its number is how many there were before."""
        cell = self._cell(north_m, east_m)
        self._cells.setdefault(cell, []).append((north_m, east_m, len(self._kept)))
        self._kept.append(cell)

    def truncate(self, size: int) -> None:
        """Forgets all places from number `size` on."""
        while len(self._kept) > size:
            self._cells[self._kept.pop()].pop()

    def too_close(self, north_m: float, east_m: float) -> int | None:
        """Number of the nearest place that is closer than the spacing, None if there is none."""
        if self._spacing_m <= 0.0:
            return None
        row, column = self._cell(north_m, east_m)
        nearest, best = None, self._spacing_m
        for i in (row - 1, row, row + 1):
            for j in (column - 1, column, column + 1):
                for north, east, number in self._cells.get((i, j), ()):
                    distance = math.hypot(north - north_m, east - east_m)
                    if distance < best:
                        nearest, best = number, distance
        return nearest
