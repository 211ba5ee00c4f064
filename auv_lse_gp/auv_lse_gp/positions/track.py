"""A vehicle's raw (dead-reckoned) track, with its sensitivity to heading errors.

A heading error a sin psi + b cos psi at heading psi rotates each displacement d_i of dead reckoning. To first order,
the position then moves by a J sum(d_i sin psi_i) + b J sum(d_i cos psi_i), with J = [[0, -1], [1, 0]]. Both sums are
stored along the track and interpolated.
"""

import abc
import dataclasses
import math

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows

#: Distance (m) or time (s) after which a node is added to the track.
NODE_M, NODE_S = 5.0, 10.0
#: A sample can lie between two transmissions if the path through it is at most this factor times the distance covered
#: in that time, plus this distance (m).
DETOUR, DETOUR_M = 1.1, 2.0
#: Usual distance (m) of a sample from the track, and number of segments whose distance from it is bounded together.
USUAL_M, BOXED = 2.0, 16
#: Columns of a node: time, raw north and east, sums with sin and cos (north, east each), distance covered.
_TIME, _RAW, _SIN, _COS, _DISTANCE = 0, slice(1, 3), slice(3, 5), slice(5, 7), 7


@dataclasses.dataclass(frozen=True, slots=True)
class TrackPoints:
    """Points on a track, as the error model needs them.

    Attributes:
        stamps_s: Times (n,).
        raw_m: Dead-reckoned positions (n, 2).
        sin_m: J sum(d sin psi) from the start (n, 2).
        cos_m: J sum(d cos psi) from the start (n, 2).
    """

    stamps_s: Array
    raw_m: Array
    sin_m: Array
    cos_m: Array


class Track(abc.ABC):
    """Dead-reckoned positions of one vehicle by time, and the sums along them."""

    @property
    @abc.abstractmethod
    def nodes(self) -> Array:
        """Time, raw north and east, both sums (north, east each), and distance travelled: (n, 8), read-only."""

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def start_m(self) -> Array:
        """First dead-reckoned position (2,); the origin without any."""
        return self.nodes[0, _RAW].copy() if len(self) else np.zeros(2)

    @property
    def start_s(self) -> float:
        """Time of the first dead-reckoned position (s); 0 without any."""
        return float(self.nodes[0, _TIME]) if len(self) else 0.0

    @property
    def end_s(self) -> float:
        """Time of the last dead-reckoned position (s); 0 without any."""
        return float(self.nodes[-1, _TIME]) if len(self) else 0.0

    def distance_m(self, stamp_s: float) -> float:
        """Distance travelled by dead reckoning until a time (m)."""
        nodes = self.nodes
        return float(np.interp(stamp_s, nodes[:, _TIME], nodes[:, _DISTANCE])) if len(nodes) else 0.0

    def at(self, stamps_s: Array, raw_m: Array | None = None) -> TrackPoints:
        """Points at times (n,); `raw_m` (n, 2) replaces the interpolated dead-reckoned positions, since it is more
        accurate."""
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
    """The vehicle's own track: a dead-reckoned position about every second, with the heading."""

    def __init__(self) -> None:
        self._nodes = GrowingRows(8)
        self._has_tip = False  # whether the last row is the last position, which the next one replaces

    @property
    def nodes(self) -> Array:
        """As `Track.nodes`."""
        return self._nodes.rows

    def add(self, stamp_s: float, north_m: float, east_m: float, heading_rad: float = math.nan) -> bool:
        """Adds the next dead-reckoned position.

        Args:
            heading_rad: Heading (rad) since the last position; NaN: uses the course.

        Returns:
            False if it was rejected: not finite, or not later than the last.
        """
        if not (math.isfinite(stamp_s) and math.isfinite(north_m) and math.isfinite(east_m)):
            return False
        if not len(self._nodes):
            self._nodes.append([stamp_s, north_m, east_m, 0.0, 0.0, 0.0, 0.0, 0.0])
            return True
        last = self._nodes.rows[-1]
        node = self._nodes.rows[-2] if self._has_tip else last
        if not stamp_s > last[_TIME]:
            return False
        north, east = north_m - float(last[1]), east_m - float(last[2])
        gone = math.hypot(north, east)
        if not math.isfinite(heading_rad):
            heading_rad = math.atan2(east, north)
        s, c = math.sin(heading_rad), math.cos(heading_rad)
        tip = np.array([stamp_s, north_m, east_m, -east * s, north * s, -east * c, north * c, gone])
        tip[3:] += last[3:]
        is_node = tip[_DISTANCE] - node[_DISTANCE] >= NODE_M or stamp_s - node[_TIME] >= NODE_S
        if self._has_tip:
            last[:] = tip
        else:
            self._nodes.append(tip)
        self._has_tip = not is_node
        return True


class MateTrack(Track):
    """A mate's track: dead-reckoned positions at its transmissions and, in between, those of its samples.

    Samples refine the path between transmissions, on which the effect of heading errors depends. The samples of a
    packet are in order of time but have no stamps: each gets the time at which the track is nearest to it, in that
    order.
    """

    def __init__(self) -> None:
        self._positions = GrowingRows(3)  # time, raw north, east of the transmissions
        self._nodes = GrowingRows(8)
        self._new: list[Array] = []  # time, raw north, east of points not in the nodes yet, (n, 3) each

    @property
    def nodes(self) -> Array:
        """As `Track.nodes`. Only nodes from the first new one on are computed."""
        if self._new:
            new = np.concatenate(self._new)
            self._new.clear()
            begin = int(np.searchsorted(self._nodes.rows[:, _TIME], new[:, 0].min()))
            rows = np.concatenate([self._nodes.rows[begin:, :3], new])
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
            rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0.0])]
            self._nodes.resize(begin)
            self._append(rows)
        return self._nodes.rows

    def _append(self, rows: Array) -> None:
        """Appends nodes: time, raw north and east (n, 3)."""
        last = self._nodes.rows[-1] if len(self._nodes) else np.concatenate([rows[0], np.zeros(5)])
        way = np.diff(np.concatenate([last[None, :3], rows]), axis=0)[:, 1:]
        gone = np.sqrt(np.einsum("nd,nd->n", way, way))
        course = way / np.maximum(gone, 1e-9)[:, None]  # cos psi, sin psi
        turned = np.column_stack([-way[:, 1], way[:, 0]])  # J d
        steps = np.column_stack([turned * course[:, 1:], turned * course[:, :1], gone])
        sums = np.cumsum(np.concatenate([last[None, 3:], steps]), axis=0)[1:]
        self._nodes.append(np.column_stack([rows, sums]))

    @property
    def last(self) -> Array | None:
        """Time, raw north and east of the last transmission (3,); None before the first."""
        return self._positions.rows[-1] if len(self._positions) else None

    def add(self, stamp_s: float, north_m: float, east_m: float) -> bool:
        """Adds the dead-reckoned position at a transmission; returns False if it is not finite, or not later than the
        last."""
        row = np.array([stamp_s, north_m, east_m])
        if not np.isfinite(row).all() or (len(self._positions) and not stamp_s > self._positions.rows[-1, 0]):
            return False
        self._positions.append(row)
        self._new.append(row[None])
        return True

    def begin(self, stamp_s: float, position_m: Array) -> None:
        """Adds the dead-reckoned position (2,) at the start, before the first transmission."""
        row, known = np.array([[stamp_s, *position_m]]), self._positions.rows.copy()
        self._positions.resize(0)
        self._positions.append(np.concatenate([row, known]))
        self._new.append(row)

    def times_of(self, raw_m: Array) -> Array:
        """Times (n,) at which the track is nearest to dead-reckoned positions (n, 2), which are in order of time.

        The assignment keeps that order and minimizes the sum of squared distances. Only segments that are near a
        position are compared: a segment farther away than the square root of the least sum is in no such assignment.
        """
        nodes = self.nodes
        if len(nodes) < 2 or not len(raw_m):
            return np.full(len(raw_m), self.end_s)
        reach2 = len(raw_m) * USUAL_M**2
        near = _segments_near(nodes, raw_m, reach2)
        least, times = _in_order(nodes, near, raw_m) if len(near) else (math.inf, raw_m[:, 0])
        if least > reach2:
            times = _in_order(nodes, _segments_near(nodes, raw_m, least), raw_m)[1]
        return times

    def refine(self, stamps_s: Array, raw_m: Array) -> None:
        """Adds samples' dead-reckoned positions (n, 2) at times (n,), if the mate can have been there at that time."""
        positions = self._positions.rows
        if len(positions) < 2:
            return
        right = np.clip(np.searchsorted(positions[:, 0], stamps_s), 1, len(positions) - 1)
        a, b = positions[right - 1], positions[right]
        spans = np.diff(positions[:, 0])
        speed = float(np.quantile(np.sqrt((np.diff(positions[:, 1:], axis=0) ** 2).sum(axis=1)) / spans, 0.9))
        detour = np.sqrt(((raw_m - a[:, 1:]) ** 2).sum(axis=1)) + np.sqrt(((raw_m - b[:, 1:]) ** 2).sum(axis=1))
        possible = detour <= DETOUR * speed * spans[right - 1] + DETOUR_M
        inside = (stamps_s > a[:, 0]) & (stamps_s < b[:, 0])
        taken = np.column_stack([stamps_s, raw_m])[possible & inside]
        if len(taken):
            self._new.append(taken)


def _in_order(nodes: Array, segments: Ints, raw_m: Array) -> tuple[float, Array]:
    """Assigns dead-reckoned positions (n, 2) to segments of a track in order of time.

    Args:
        segments: Numbers of the segments to choose from, ascending: that of each segment's first node.

    Returns:
        The least sum of squared distances, and the times (n,).
    """
    begin, way = nodes[segments, _RAW], nodes[segments + 1, _RAW] - nodes[segments, _RAW]
    length2 = np.maximum(np.einsum("sd,sd->s", way, way), 1e-12)
    apart = raw_m[:, None, :] - begin[None]
    share = np.clip(np.einsum("nsd,sd->ns", apart, way) / length2, 0.0, 1.0)
    off = apart - share[..., None] * way[None]
    distance2 = np.einsum("nsd,nsd->ns", off, off)
    # total[s]: smallest sum with the last position on segment s; the position before it is on s or an earlier one
    total, origins = distance2[0].copy(), []
    for row in distance2[1:]:
        best = np.minimum.accumulate(total)
        first = np.concatenate([[True], best[1:] < best[:-1]])
        origins.append(np.maximum.accumulate(np.where(first, np.arange(len(best)), 0)))
        total = best + row
    chosen = np.empty(len(raw_m), dtype=np.int64)
    chosen[-1] = int(np.argmin(total))
    for i in range(len(raw_m) - 2, -1, -1):
        chosen[i] = origins[i][chosen[i + 1]]
    times, spans = nodes[segments, _TIME], nodes[segments + 1, _TIME] - nodes[segments, _TIME]
    found = times[chosen] + share[np.arange(len(raw_m)), chosen] * spans[chosen]
    return float(total.min()), np.asarray(np.maximum.accumulate(found))


def _segments_near(nodes: Array, raw_m: Array, reach2: float) -> Ints:
    """Numbers of the segments within a squared distance of any dead-reckoned position (n, 2), and of some beyond;
    ascending."""
    positions = nodes[:, _RAW]
    begins = np.arange(0, len(nodes) - 1, BOXED)
    low = np.minimum.reduceat(np.minimum(positions[:-1], positions[1:]), begins)
    high = np.maximum.reduceat(np.maximum(positions[:-1], positions[1:]), begins)
    gap = np.maximum(np.maximum(low - raw_m[:, None], raw_m[:, None] - high), 0.0)
    is_near = (np.einsum("nbd,nbd->nb", gap, gap) <= reach2 * (1.0 + 1e-9) + 1e-9).any(axis=0)
    return np.flatnonzero(np.repeat(is_near, BOXED)[: len(nodes) - 1])
