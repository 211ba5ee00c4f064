"""Error model of a team's positions: the unknowns, their prior, and the positions as a function of them.

A vehicle's error is nearly a static similarity transform about its start. Let u = raw - p0 be the displacement by dead
reckoning from the first dead-reckoned position p0, and R(a) the rotation from north towards east. With the sums of
`track.py`,

    p = p0 - d + R(-b0) (u - b1 S1 - b2 S2 - sum_k a_k S_k) / (1 + s) + sum_k e_k r_k

    d (2)    offset at the start                     S1, S2   J sum(d_i sin psi_i), J sum(d_i cos psi_i)
    b0       bias of the heading                     S_k      J sum(d_i r_k(t_i))
    b1, b2   its harmonics: b1 sin psi + b2 cos psi  r_k      ramp from 0 to 1 between knots k and k + 1
    s        scale of the DVL                        a_k, e_k random walks of heading and position (increments)

The rotation is exact in b0. The harmonics and the walk are linearized; the error is 0.15 mm per metre for one degree.
Ranges also depend on the speed of sound and on each clock's offset (m) and rate against the reference clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.positions.track import Track, TrackPoints

#: Unknowns of a vehicle without its knots: offset north and east, heading bias, its two harmonics, scale.
STATIC = 6
#: Maximum number of knots per vehicle; longer missions space them twice, four times... as far apart. Spacings that grew
#: with each correction would move all positions each time.
MAX_KNOTS = 24
#: Maximum number of knots of all vehicles that are no references: in teams of up to four each reaches `MAX_KNOTS`.
MAX_MATE_KNOTS = 76
#: More unknowns than three vehicles have. Beyond, cheaper forms of the same products are used, which round differently.
MANY_UNKNOWNS = 250
_J = np.array([[0.0, -1.0], [1.0, 0.0]])


class VehicleErrorModel:
    """One vehicle's positions as a function of its unknowns.

    Attributes:
        track: Its raw track, which may grow.
        block: Slice of its unknowns among those of the team.
        knots_s: Times of its knots.
    """

    def __init__(
        self,
        track: Track,
        begin: int,
        config: PositionsConfig,
        earlier_distance_m: float = 0.0,
        older: VehicleErrorModel | None = None,
        max_knots: int | None = None,
    ) -> None:
        """Lays out the vehicle's unknowns.

        Args:
            begin: Number of its first unknown.
            earlier_distance_m: Distance travelled before its first known dead-reckoned position.
            older: The model of an earlier time, whose sums along the track are continued.
            max_knots: Maximum number of knots; None: `MAX_KNOTS`.
        """
        self.track = track
        self._start_m = track.start_m
        lasted = max(track.end_s - track.start_s, 0.0)
        walks = config.heading_walk_deg_rth > 0.0 or config.position_walk_m_rts > 0.0
        self._span_s = config.knot_s
        while lasted > (max_knots or MAX_KNOTS) * self._span_s:
            self._span_s *= 2.0
        self.knots = math.ceil(lasted / self._span_s) if walks else 0
        self.knots_s = np.asarray(track.start_s + self._span_s * np.arange(self.knots, dtype=float))
        self.block = slice(begin, begin + STATIC + 3 * self.knots)
        self._earlier_distance_m = earlier_distance_m
        self._config = config
        self._nodes = track.nodes[:, :3].copy()  # a track recomputes its last nodes
        self._times_s = self._nodes[:, 0].copy()
        self._sums: GrowingRows | None = self._summed(older)

    @property
    def is_long(self) -> bool:
        """Whether the track has lasted so long that its knots are farther apart than `positions.knot_s`."""
        return self._span_s > self._config.knot_s

    @property
    def _walk_m(self) -> Array:
        """S_k at the track's nodes, (n, knots, 2)."""
        if self._sums is None:
            self._sums = self._summed(None)
        return self._sums.rows.reshape(len(self._sums), self.knots, 2)

    def _summed(self, older: VehicleErrorModel | None) -> GrowingRows:
        """S_k at the track's nodes, a row each; those of an older model are taken over; it recomputes its own."""
        nodes, kept, sums = self._nodes, 1, GrowingRows(2 * self.knots)
        if older is not None and self._continues(older):
            common = min(len(older._nodes), len(nodes))
            same = (older._nodes[:common] == nodes[:common]).all(axis=1)
            kept = max(int(np.argmin(np.append(same, False))), 1)
            if older.knots == self.knots and older._sums is not None:
                sums, older._sums = older._sums, None
            else:
                sums.resize(kept)
                sums.rows.reshape(kept, self.knots, 2)[:, : older.knots] = older._walk_m[:kept, : self.knots]
        sums.resize(max(len(nodes), 1))
        if not self.knots or len(nodes) < 2:
            return sums
        rows = sums.rows.reshape(len(nodes), self.knots, 2)
        way = np.diff(nodes[kept - 1 :, 1:], axis=0) @ _J.T
        ramps = self._ramps(0.5 * (nodes[kept:, 0] + nodes[kept - 1 : -1, 0]))
        rows[kept:] = way[:, None, :] * ramps[:, :, None]
        np.cumsum(rows[kept - 1 :], axis=0, out=rows[kept - 1 :])
        return sums

    def _continues(self, older: VehicleErrorModel) -> bool:
        """Whether the knots of an older model, if any, are the first ones of this one."""
        return older._span_s == self._span_s and older.knots_s[:1].tolist() == self.knots_s[:1].tolist()

    def prior_std(self) -> Array:
        """Prior standard deviations of its unknowns, (block,)."""
        c = self._config
        turn = math.radians(math.hypot(c.heading_std_deg, c.harmonic_std_deg))
        start = math.hypot(c.start_std_m, self._earlier_distance_m * math.hypot(turn, c.scale_std))
        heading, harmonic = math.radians(c.heading_std_deg), math.radians(c.harmonic_std_deg)
        turning = math.radians(c.heading_walk_deg_rth) * math.sqrt(self._span_s / 3600.0)
        walk = c.position_walk_m_rts * math.sqrt(self._span_s)
        static = [start, start, heading, harmonic, harmonic, c.scale_std]
        # A walk of 0 keeps its unknowns, with a tiny variance.
        knots = [max(turning, 1e-9)] * self.knots + [max(walk, 1e-9)] * (2 * self.knots)
        return np.array(static + knots)

    def _ramps(self, stamps_s: Array) -> Array:
        return np.clip((stamps_s[:, None] - self.knots_s[None]) / self._span_s, 0.0, 1.0)

    def _walk_at(self, stamps_s: Array) -> Array:
        """S_k at times (n,), shape (n, knots, 2)."""
        times, sums = self._times_s, self._walk_m
        if len(times) < 2:
            return np.broadcast_to(sums[:1], (len(stamps_s), *sums.shape[1:]))
        right = np.clip(np.searchsorted(times, stamps_s), 1, len(times) - 1)
        share = np.clip((stamps_s - times[right - 1]) / (times[right] - times[right - 1]), 0.0, 1.0)
        return np.asarray(sums[right - 1] + share[:, None, None] * (sums[right] - sums[right - 1]))

    def turn_between(self, own: Array, other: Array) -> float:
        """Bound on how far two sets of its unknowns (block,) turn (rad) or scale its displacements apart."""
        change = other - own
        walk = np.cumsum(change[STATIC : STATIC + self.knots])
        return float(np.abs(change[2:STATIC]).sum() + np.abs(walk).max(initial=0.0))

    def positions(self, along: TrackPoints) -> TrackPositions:
        """Positions of points on the track as a function of the unknowns."""
        walk = self._walk_at(along.stamps_s)
        if self.is_long:
            self._extend(walk, along)
        return TrackPositions(self, along, walk, self._ramps(along.stamps_s), self._start_m)

    def _extend(self, walk: Array, along: TrackPoints) -> None:
        """Adds to S_k (n, knots, 2) what points have covered since the track's last node when this model was made."""
        late = along.stamps_s > self._times_s[-1]
        if late.any():
            way = (along.raw_m[late] - self._nodes[-1, 1:]) @ _J.T
            ramps = self._ramps(0.5 * (along.stamps_s[late] + self._times_s[-1]))
            walk[late] += way[:, None, :] * ramps[:, :, None]

    def warm_start(self, theta: Array, older: VehicleErrorModel) -> Array:
        """Initial unknowns (block,) of this vehicle, from an earlier model of it and the team's unknowns `theta`."""
        own = np.zeros(self.block.stop - self.block.start)
        old = theta[older.block]
        own[:STATIC] = old[:STATIC]
        if self._continues(older):
            m, n = min(older.knots, self.knots), older.knots
            own[STATIC : STATIC + m] = old[STATIC : STATIC + m]
            walk = old[STATIC + n :].reshape(n, 2)[:m]
            own[STATIC + self.knots :].reshape(self.knots, 2)[:m] = walk
        return own


class TrackPositions:
    """Positions of points (n) on one vehicle's track, as a function of the unknowns.

    The last result is cached, because a search evaluates positions and derivatives alternately.
    """

    def __init__(
        self, model: VehicleErrorModel, along: TrackPoints, walk_m: Array, ramps: Array, start_m: Array
    ) -> None:
        self._model, self._along, self._walk_m, self._ramps, self._start_m = model, along, walk_m, ramps, start_m
        self._raw_way_m = along.raw_m - start_m
        self._cached_for = b""
        self._turn, self._way, self._positions = np.zeros((2, 2)), np.zeros((0, 2)), np.zeros((0, 2))

    def __len__(self) -> int:
        """Number of points."""
        return len(self._along.stamps_s)

    @property
    def stamps_s(self) -> Array:
        """Times (n,)."""
        return self._along.stamps_s

    def _evaluate(self, theta: Array) -> Array:
        """Computes the positions for `theta` unless cached; returns the vehicle's unknowns.

        It also computes R(-b0) / (1 + s) and the displacement transformed by it, (2, 2) and (n, 2).
        """
        own = theta[self._model.block]
        key = own.tobytes()
        if key != self._cached_for:
            n, a = self._model.knots, self._along
            static, headings, walk = own[:STATIC], own[STATIC : STATIC + n], own[STATIC + n :].reshape(n, 2)
            c, s = math.cos(static[2]), math.sin(static[2])
            way = self._raw_way_m - static[3] * a.sin_m - static[4] * a.cos_m
            if n:
                way = way - headings @ self._walk_m
            self._turn = np.array([[c, s], [-s, c]]) / (1.0 + static[5])  # R(-b0)
            self._way = way @ self._turn.T
            self._positions = self._start_m - static[:2] + self._way + self._ramps @ walk
            self._cached_for = key
        return own

    def positions(self, theta: Array) -> Array:
        """Positions (n, 2) for the team's unknowns `theta`; read-only."""
        self._evaluate(theta)
        return self._positions

    def jacobian(self, theta: Array) -> Array:
        """Derivatives (n, 2, block) of the positions with respect to the vehicle's unknowns."""
        scale = 1.0 + self._evaluate(theta)[5]
        turn, way = self._turn, self._way
        n, knots = len(self), self._model.knots
        out = np.zeros((n, 2, STATIC + 3 * knots))
        out[:, 0, 0] = out[:, 1, 1] = -1.0
        out[:, :, 2] = -way @ _J.T
        out[:, :, 3] = -self._along.sin_m @ turn.T
        out[:, :, 4] = -self._along.cos_m @ turn.T
        out[:, :, 5] = -way / scale
        if knots:
            out[:, :, STATIC : STATIC + knots] = -(self._walk_m @ turn.T).transpose(0, 2, 1)
            out[:, 0, STATIC + knots :: 2] = self._ramps
            out[:, 1, STATIC + knots + 1 :: 2] = self._ramps
        return out


class TeamPositions:
    """Positions of points (n) on the tracks of several vehicles, as `TrackPositions` but all at once.

    A row holds what belongs to its point. Rows of vehicles with fewer knots are padded with zeros; padded unknowns have
    the number `size`, and the value 0. The last result is cached, as that of `TrackPositions`.
    """

    def __init__(self, parts: Sequence[tuple[Ints, TrackPositions]], size: int) -> None:
        """Joins positions on single tracks.

        Args:
            parts: Numbers of the points (m,) on a track, and their positions; together all points.
            size: Number of the team's unknowns.
        """
        count = sum(len(rows) for rows, _ in parts)
        knots = max((sums._model.knots for _, sums in parts), default=0)
        self._start_m, self._raw_way_m, self._sin_m, self._cos_m = np.zeros((4, count, 2))
        self._walk_m, self._ramps = np.zeros((count, knots, 2)), np.zeros((count, knots))
        self.unknowns = np.full((count, STATIC + 3 * knots), size)
        for rows, sums in parts:
            model, along = sums._model, sums._along
            n, begin = model.knots, model.block.start
            self._start_m[rows], self._raw_way_m[rows] = sums._start_m, sums._raw_way_m
            self._sin_m[rows], self._cos_m[rows] = along.sin_m, along.cos_m
            self._walk_m[rows, :n], self._ramps[rows, :n] = sums._walk_m, sums._ramps
            self.unknowns[rows, : STATIC + n] = begin + np.arange(STATIC + n)
            self.unknowns[rows, STATIC + knots : STATIC + knots + 2 * n] = begin + STATIC + n + np.arange(2 * n)
        self._turn, self._way, self._scale = np.zeros((count, 2, 2)), np.zeros((count, 2)), np.zeros(count)
        self._cached_for, self._positions = b"", np.zeros((count, 2))

    def positions(self, theta: Array) -> Array:
        """Positions (n, 2) for the team's unknowns `theta` (size,); read-only."""
        key = theta.tobytes()
        if key == self._cached_for:
            return self._positions
        own = np.append(theta, 0.0)[self.unknowns]
        knots = self._ramps.shape[1]
        headings, walk = own[:, STATIC : STATIC + knots], own[:, STATIC + knots :].reshape(-1, knots, 2)
        self._scale = 1.0 + own[:, 5]
        c, s = np.cos(own[:, 2]) / self._scale, np.sin(own[:, 2]) / self._scale
        self._turn = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2)  # R(-b0) / (1 + s)
        way = self._raw_way_m - own[:, 3:4] * self._sin_m - own[:, 4:5] * self._cos_m
        way -= (headings[:, None] @ self._walk_m)[:, 0]
        self._way = (self._turn @ way[:, :, None])[:, :, 0]
        self._positions = self._start_m - own[:, :2] + self._way + (self._ramps[:, None] @ walk)[:, 0]
        self._cached_for = key
        return self._positions

    def derivatives_along(self, theta: Array, toward: Array) -> Array:
        """Derivatives (n, u) of the positions along directions (n, 2), with respect to `unknowns` (n, u)."""
        self.positions(theta)
        knots, scale = self._ramps.shape[1], self._scale
        turned = (toward[:, None] @ self._turn)[:, 0]
        out = np.empty(self.unknowns.shape)
        out[:, :2] = -toward
        out[:, 2] = toward[:, 0] * self._way[:, 1] - toward[:, 1] * self._way[:, 0]
        out[:, 3] = -np.einsum("nd,nd->n", turned, self._sin_m)
        out[:, 4] = -np.einsum("nd,nd->n", turned, self._cos_m)
        out[:, 5] = -np.einsum("nd,nd->n", toward, self._way) / scale
        out[:, STATIC : STATIC + knots] = -(self._walk_m @ turned[:, :, None])[:, :, 0]
        out[:, STATIC + knots :] = (self._ramps[:, :, None] * toward[:, None]).reshape(len(out), -1)
        return out


class TeamErrorModel:
    """All unknowns of a team: a block for each vehicle, then clocks, then the speed of sound.

    Attributes:
        vehicles: The vehicles' models by number.
        sound: Number of the unknown that is the relative error of the speed of sound.
    """

    def __init__(
        self,
        config: PositionsConfig,
        tracks: dict[int, Track],
        references: set[int],
        earlier_distance_m: dict[int, float] | None = None,
        older: TeamErrorModel | None = None,
    ) -> None:
        """Lays out the unknowns.

        Args:
            tracks: Raw tracks by number of the vehicle.
            references: The vehicles whose clocks are references: one per team.
            earlier_distance_m: Distance travelled before the first known dead-reckoned position, by vehicle, where not
                0.
            older: The model of an earlier time, whose sums along the tracks are continued.
        """
        self.config = config
        self.vehicles: dict[int, VehicleErrorModel] = {}
        others = [number for number in sorted(tracks) if number not in references]
        share = min(MAX_KNOTS, MAX_MATE_KNOTS // max(len(others), 1))
        begin = 0
        for number in sorted(tracks):
            earlier_m = (earlier_distance_m or {}).get(number, 0.0)
            before = older.vehicles.get(number) if older is not None else None
            most = share if number in others else MAX_KNOTS
            self.vehicles[number] = VehicleErrorModel(tracks[number], begin, config, earlier_m, before, most)
            begin = self.vehicles[number].block.stop
        self._clocks = {number: begin + 2 * i for i, number in enumerate(others)}
        self.sound = begin + 2 * len(others)
        self.size = self.sound + 1

    def clock(self, number: int) -> int | None:
        """Number of a vehicle's first clock unknown: offset (m), then rate (m per 1000 s); None for a reference."""
        return self._clocks.get(number)

    def prior_std(self) -> Array:
        """Prior standard deviation of each unknown, (size,); their means are 0."""
        c = self.config
        both = math.sqrt(2.0) * c.sound_speed_mps  # of a difference of two clocks
        std = [model.prior_std() for model in self.vehicles.values()]
        clock = np.array([both * c.clock_std_s, both * c.clock_drift_std_ppm * 1e-3])
        return np.concatenate([*std, np.tile(clock, len(self._clocks)), [c.sound_speed_std]])

    def warm_start(self, theta: Array, older: TeamErrorModel) -> Array:
        """Initial unknowns (size,), from an earlier model of the team with unknowns `theta`."""
        start = np.zeros(self.size)
        for number, model in self.vehicles.items():
            if number in older.vehicles:
                start[model.block] = model.warm_start(theta, older.vehicles[number])
            here, there = self.clock(number), older.clock(number)
            if here is not None and there is not None:
                start[here : here + 2] = theta[there : there + 2]
        start[self.sound] = theta[older.sound]
        return start

    def common_modes(self, theta: Array) -> Array:
        """Directions (size, 4) of a translation, rotation and scaling of all positions together."""
        directions = np.zeros((self.size, 4))
        for model in self.vehicles.values():
            at = model.block.start
            static = theta[model.block][:STATIC]
            start = model.track.start_m - static[:2]
            directions[at, 0] = directions[at + 1, 1] = -1.0
            directions[at : at + 2, 2] = -_J @ start
            directions[at + 2, 2] = -1.0
            directions[at : at + 2, 3] = -start
            directions[at + 5, 3] = -(1.0 + static[5])
        return directions
