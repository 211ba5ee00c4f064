"""A vehicle's raw track, and the sums along it by which its place depends on what is wrong with its instruments.

With psi the heading by dead reckoning and d_i its displacements, an error of the heading a sin psi + b cos psi turns
each d_i by itself. To first order the place then moves by a J sum(d_i sin psi_i) + b J sum(d_i cos psi_i), with
J = [[0, -1], [1, 0]]. Both sums are kept along the track, so that a place costs an interpolation.
"""

from __future__ import annotations

import abc
import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A node is kept where the vehicle has gone this far (m) since the last one, or this long (s).
NODE_M, NODE_S = 5.0, 10.0
#: A sample belongs between two transmissions if by way of it the mate had gone at most this much farther (share, m).
DETOUR, DETOUR_M = 1.1, 2.0
#: PointPosteriors of a node: time, raw north and east, sums with sin and cos (north, east each), distance gone.
_TIME, _RAW, _SIN, _COS, _GONE = 0, slice(1, 3), slice(3, 5), slice(5, 7), 7


@dataclasses.dataclass(frozen=True, slots=True)
class TrackPoints:
    """Places along a track, ready for the model.

    Attributes:
        stamps_s: Times (n,).
        raw_m: Raw places (n, 2).
        sin_m: J sum(d sin psi) from the start (n, 2).
        cos_m: J sum(d cos psi) from the start (n, 2).
    """

    stamps_s: Array
    raw_m: Array
    sin_m: Array
    cos_m: Array


class Track(abc.ABC):
    """Raw places of one vehicle by time, and the sums along its way.

    A track has nodes: time, raw north and east, both sums (north, east each), distance gone; shape (n, 8).
    """

    @property
    @abc.abstractmethod
    def nodes(self) -> Array:
        """Its nodes (n, 8); to be read only."""

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def start_m(self) -> Array:
        """First raw place (2,); the origin without any."""
        return self.nodes[0, _RAW].copy() if len(self) else np.zeros(2)

    @property
    def start_s(self) -> float:
        """Time of the first raw place; 0 without any."""
        return float(self.nodes[0, _TIME]) if len(self) else 0.0

    @property
    def end_s(self) -> float:
        """Time of the last raw place; 0 without any."""
        return float(self.nodes[-1, _TIME]) if len(self) else 0.0

    def distance_m(self, stamp_s: float) -> float:
        """Distance gone by dead reckoning until a time (m)."""
        nodes = self.nodes
        return float(np.interp(stamp_s, nodes[:, _TIME], nodes[:, _GONE])) if len(nodes) else 0.0

    def at(self, stamps_s: Array, raw_m: Array | None = None) -> TrackPoints:
        """Places at times (n,); with `raw_m` (n, 2), at these raw places, which are known better than the track."""
        nodes = self.nodes
        times = np.asarray(stamps_s, dtype=float)
        if not len(nodes):
            raw = np.zeros((len(times), 2)) if raw_m is None else raw_m
            return TrackPoints(times, raw, np.zeros((len(times), 2)), np.zeros((len(times), 2)))
        known = nodes[:, _TIME]
        right = np.minimum(np.searchsorted(known, times, side="right"), len(nodes) - 1)
        left = np.maximum(right - 1, 0)
        a, b = nodes[left], nodes[right]
        spans = np.where(right > left, b[:, _TIME] - a[:, _TIME], 1.0)
        late = np.clip(times, known[0], known[-1]) - a[:, _TIME]
        rows = (b - a) / spans[:, None] * late[:, None] + a
        rows = np.where((times >= known[-1])[:, None], nodes[-1], rows)
        raw = rows[:, _RAW] if raw_m is None else np.asarray(raw_m, dtype=float)
        return TrackPoints(times, raw, rows[:, _SIN], rows[:, _COS])


class OwnTrack(Track):
    """The track of the vehicle itself: a raw place every second or so, with the heading."""

    def __init__(self) -> None:
        """No place is known yet."""
        self._nodes = np.zeros((64, 8))
        self._size = 0
        self._tip: Array | None = None  # the last place, if it is not a node
        self._with_tip = self._nodes[:0]  # nodes and tip, once they were asked for

    @property
    def nodes(self) -> Array:
        """As `Track.nodes`."""
        if self._tip is None:
            return self._nodes[: self._size]
        if not len(self._with_tip):
            self._with_tip = np.concatenate([self._nodes[: self._size], self._tip[None]])
        return self._with_tip

    def __len__(self) -> int:
        """As `Track.__len__`."""
        return self._size + (self._tip is not None)

    def add(self, stamp_s: float, north_m: float, east_m: float, heading_rad: float = math.nan) -> bool:
        """Takes the next raw place.

        Args:
            stamp_s: Its time (s).
            north_m: North (m).
            east_m: East (m).
            heading_rad: Heading (rad) on the way there; NaN: the course.

        Returns:
            False if it is not finite, or not later than the last: it is not taken.
        """
        if not (math.isfinite(stamp_s) and math.isfinite(north_m) and math.isfinite(east_m)):
            return False
        if not self._size:
            self._keep(np.array([stamp_s, north_m, east_m, 0.0, 0.0, 0.0, 0.0, 0.0]))
            return True
        last = self._tip if self._tip is not None else self._nodes[self._size - 1]
        if not stamp_s > last[_TIME]:
            return False
        north, east = north_m - float(last[1]), east_m - float(last[2])
        gone = math.hypot(north, east)
        if not math.isfinite(heading_rad):
            heading_rad = math.atan2(east, north)
        s, c = math.sin(heading_rad), math.cos(heading_rad)
        tip = np.array([stamp_s, north_m, east_m, -east * s, north * s, -east * c, north * c, gone])
        tip[3:] += last[3:]
        node = self._nodes[self._size - 1]
        self._tip, self._with_tip = tip, self._nodes[:0]
        if tip[_GONE] - node[_GONE] >= NODE_M or stamp_s - node[_TIME] >= NODE_S:
            self._keep(tip)
        return True

    def _keep(self, node: Array) -> None:
        if self._size == len(self._nodes):
            self._nodes = np.concatenate([self._nodes, np.zeros_like(self._nodes)])
        self._nodes[self._size] = node
        self._size += 1
        self._tip = None


class MateTrack(Track):
    """The track of a mate: its raw places at its transmissions, and between them the places of its samples.

    A mate's harmonics depend on the way that it went, which is more than where it was every half minute. The samples of
    a packet are in order of time, though of any age. So each is put where the track is nearest to it, in that order.
    """

    def __init__(self) -> None:
        """Nothing was heard yet."""
        self._places = np.zeros((0, 3))  # time, raw north, east of the transmissions
        self._samples = np.zeros((0, 3))  # the same of the samples
        self._nodes: Array | None = np.zeros((0, 8))

    @property
    def nodes(self) -> Array:
        """As `Track.nodes`."""
        if self._nodes is None:
            rows = np.concatenate([self._places, self._samples])
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
            rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0.0])]
            way = np.diff(rows[:, 1:], axis=0)
            gone = np.sqrt(np.einsum("nd,nd->n", way, way))
            course = way / np.maximum(gone, 1e-9)[:, None]  # cos psi, sin psi
            turned = np.column_stack([-way[:, 1], way[:, 0]])  # J d
            self._nodes = np.zeros((len(rows), 8))
            self._nodes[:, :3] = rows
            self._nodes[1:, _SIN] = np.cumsum(turned * course[:, 1:], axis=0)
            self._nodes[1:, _COS] = np.cumsum(turned * course[:, :1], axis=0)
            self._nodes[1:, _GONE] = np.cumsum(gone)
        return self._nodes

    @property
    def last(self) -> Array | None:
        """Time, raw north and east of the last transmission (3,); None before the first."""
        return self._places[-1] if len(self._places) else None

    def add(self, stamp_s: float, north_m: float, east_m: float) -> bool:
        """Takes the raw place at a transmission; returns False if it is not finite, or not later than the last."""
        row = np.array([stamp_s, north_m, east_m])
        if not np.isfinite(row).all() or (len(self._places) and not stamp_s > self._places[-1, 0]):
            return False
        self._places = np.concatenate([self._places, row[None]])
        self._nodes = None
        return True

    def begin(self, stamp_s: float, place_m: Array) -> None:
        """Takes an earlier raw place (2,) than the first transmission's: where the mate began."""
        self._places = np.concatenate([[[stamp_s, *place_m]], self._places])
        self._nodes = None

    def times_of(self, raw_m: Array) -> Array:
        """Times (n,) at which the track is nearest to raw places (n, 2), which are in order of time.

        Of all ways to put them on the track in that order, the one of the least squared distance.
        """
        nodes = self.nodes
        if len(nodes) < 2 or not len(raw_m):
            return np.full(len(raw_m), self.end_s)
        begin, way = nodes[:-1, _RAW], np.diff(nodes[:, _RAW], axis=0)
        length2 = np.maximum(np.einsum("sd,sd->s", way, way), 1e-12)
        apart = raw_m[:, None, :] - begin[None]
        share = np.clip(np.einsum("nsd,sd->ns", apart, way) / length2, 0.0, 1.0)
        off = apart - share[..., None] * way[None]
        distance2 = np.einsum("nsd,nsd->ns", off, off)
        # total[s]: least sum with the last place on segment s; the one before it is on s or on an earlier one
        total, origins = distance2[0].copy(), []
        for row in distance2[1:]:
            best = np.minimum.accumulate(total)
            first = np.concatenate([[True], best[1:] < best[:-1]])
            origins.append(np.maximum.accumulate(np.where(first, np.arange(len(best)), 0)))
            total = best + row
        segment = np.empty(len(raw_m), dtype=np.int64)
        segment[-1] = int(np.argmin(total))
        for i in range(len(raw_m) - 2, -1, -1):
            segment[i] = origins[i][segment[i + 1]]
        times, spans = nodes[:-1, _TIME], np.diff(nodes[:, _TIME])
        found = times[segment] + share[np.arange(len(raw_m)), segment] * spans[segment]
        return np.asarray(np.maximum.accumulate(found))

    def refine(self, stamps_s: Array, raw_m: Array) -> None:
        """Takes samples' raw places (n, 2) at times (n,) into the track, where the mate can have been there then."""
        places = self._places
        if len(places) < 2:
            return
        right = np.clip(np.searchsorted(places[:, 0], stamps_s), 1, len(places) - 1)
        a, b = places[right - 1], places[right]
        spans = np.diff(places[:, 0])
        speed = float(np.quantile(np.sqrt((np.diff(places[:, 1:], axis=0) ** 2).sum(axis=1)) / spans, 0.9))
        detour = np.sqrt(((raw_m - a[:, 1:]) ** 2).sum(axis=1)) + np.sqrt(((raw_m - b[:, 1:]) ** 2).sum(axis=1))
        possible = detour <= DETOUR * speed * spans[right - 1] + DETOUR_M
        inside = (stamps_s > a[:, 0]) & (stamps_s < b[:, 0])
        taken = np.column_stack([stamps_s, raw_m])[possible & inside]
        if len(taken):
            self._samples = np.concatenate([self._samples, taken])
            self._nodes = None
