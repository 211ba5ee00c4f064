"""Soundings: measurements of water depth, single or as arrays of named columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.support.arrays import Array, Ints

#: Depths of lakes and seas end here (m): larger values have another unit, or are wrong.
DEEPEST_M = 12_000.0
#: Soundings that are iterated over as Python's numbers at a time: those of a survey take far more memory than arrays.
_AT_A_TIME = 10_000


class Sounding(NamedTuple):
    """One measurement of water depth. Positions are in the local tangent plane.

    Attributes:
        stamp_s: Time of the measurement; for a mate's sample, of its packet's arrival.
        north_m, east_m: Estimated position.
        depth_m: Water depth, positive down.
        raw_north_m, raw_east_m: Dead-reckoned position (see `dead_reckoning`); NaN if unknown.
        vehicle: Number of the vehicle that measured it; 0 if unknown.
    """

    stamp_s: float
    north_m: float
    east_m: float
    depth_m: float
    raw_north_m: float = math.nan
    raw_east_m: float = math.nan
    vehicle: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Soundings:
    """Soundings as arrays (n,), with the fields of `Sounding` as columns; a single number applies to every sounding."""

    stamp_s: Array
    north_m: Array
    east_m: Array
    depth_m: Array
    raw_north_m: Array = math.nan  # type: ignore[assignment]  # broadcast to (n,)
    raw_east_m: Array = math.nan  # type: ignore[assignment]  # broadcast to (n,)
    vehicle: Ints = 0  # type: ignore[assignment]  # broadcast to (n,)

    def __post_init__(self) -> None:
        """Makes every column an array of the same length.

        Raises:
            ValueError: naming the column and its shape.
        """
        count = np.size(self.depth_m)
        for column in fields(self):
            kind = np.int64 if column.name == "vehicle" else np.float64
            values = np.asarray(getattr(self, column.name), dtype=kind)
            if values.shape not in ((), (count,)):
                raise ValueError(f"soundings: {column.name} has shape {values.shape}, not ({count},)")
            object.__setattr__(self, column.name, np.full(count, values) if values.ndim == 0 else values)

    @classmethod
    def from_rows(cls, rows: ArrayLike | Sequence[Sounding]) -> Soundings:
        """Soundings from rows with the first 4, 6 or 7 fields of `Sounding` as columns; there may be no rows.

        Raises:
            ValueError: if the rows have another number of columns.
        """
        table = np.asarray(rows, dtype=float)
        if table.size == 0:
            table = np.empty((0, 4))
        if table.ndim != 2 or table.shape[1] not in (4, 6, 7):
            raise ValueError(f"soundings: rows must have the shape (n, 4), (n, 6) or (n, 7), not {table.shape}")
        columns: dict[str, Any] = dict(zip(Sounding._fields, table.T, strict=False))
        return cls(**columns)

    @classmethod
    def of_packet(cls, stamp_s: float, vehicle: int, points_m: Array) -> Soundings:
        """The samples of one packet.

        Args:
            stamp_s: Time of its arrival (s).
            vehicle: Number of the sender.
            points_m: North, east, depth of each sample, shape (n, 3).
        """
        north_m, east_m, depth_m = np.asarray(points_m, dtype=float).reshape(-1, 3).T
        stamps = np.full(len(depth_m), stamp_s)
        return cls(
            stamp_s=stamps, north_m=north_m, east_m=east_m, depth_m=depth_m, vehicle=np.full(len(stamps), vehicle)
        )

    @classmethod
    def join(cls, parts: Iterable[Soundings]) -> Soundings:
        """All soundings of `parts`, one part after the other."""
        found = [part for part in parts if len(part)]
        if not found:
            return cls.from_rows(())
        return cls(**{c.name: np.concatenate([getattr(part, c.name) for part in found]) for c in fields(cls)})

    def __len__(self) -> int:
        """Number of soundings."""
        return len(self.depth_m)

    def __getitem__(self, index: slice | NDArray[Any]) -> Soundings:
        """The soundings that a slice, a mask or an array of indices selects."""
        return Soundings(**{column.name: getattr(self, column.name)[index] for column in fields(self)})

    def __iter__(self) -> Iterator[Sounding]:
        """Iterates over single soundings."""
        for first in range(0, len(self), _AT_A_TIME):
            columns = (getattr(self, name)[first : first + _AT_A_TIME].tolist() for name in Sounding._fields)
            yield from map(Sounding._make, zip(*columns, strict=True))

    def in_order(self) -> Soundings:
        """The soundings in order of their stamps (stable)."""
        return self[np.argsort(self.stamp_s, kind="stable")]

    def packets(self) -> list[Soundings]:
        """The samples of each packet: consecutive soundings with equal stamp and vehicle."""
        new = (self.stamp_s[1:] != self.stamp_s[:-1]) | (self.vehicle[1:] != self.vehicle[:-1])
        edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(self)]
        return [self[start:stop] for start, stop in pairwise(edges) if stop > start]

    @property
    def locations_m(self) -> Array:
        """Estimated positions, shape (n, 2): north, east."""
        return np.column_stack([self.north_m, self.east_m])

    @property
    def raw_positions_m(self) -> Array:
        """Dead-reckoned positions, shape (n, 2): north, east; NaN where unknown."""
        return np.column_stack([self.raw_north_m, self.raw_east_m])

    @property
    def points_m(self) -> Array:
        """Estimated positions and depths, shape (n, 3): north, east, depth."""
        return np.column_stack([self.north_m, self.east_m, self.depth_m])

    @property
    def rows(self) -> Array:
        """Stamps (s), estimated positions and depths, shape (n, 4): stamp, north, east, depth."""
        return np.column_stack([self.stamp_s, self.north_m, self.east_m, self.depth_m])
