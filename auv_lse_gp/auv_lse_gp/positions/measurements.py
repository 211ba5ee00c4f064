"""Measurements of a team's positions: fixes, and ranges between vehicles. For depths see `terrain_matching.py`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_gp.positions.error_model import MANY_UNKNOWNS, TeamErrorModel, TeamPositions, TrackPositions

#: Ranges beyond this many median absolute deviations, scaled to standard deviations, are rejected, ...
GATE = 4.0
_MAD_TO_STD = 1.4826
#: ... unless they are within this many of their own standard deviations.
_MIN_GATE = 2.0
#: Ranges (lengthened by echoes) and fixes (of a broken receiver) beyond this many prior standard deviations are
#: rejected first, because the test above needs several ranges.
RANGE_SIGMAS, FIX_SIGMAS = 8.0, 30.0
#: Shorter ranges (m) are not used: position errors dominate their direction, and the depth difference matters.
NEAREST_M = 20.0
#: Ranges sent or received more than this time (s) before or after the known part of a vehicle's track are rejected; a
#: packet may come before the next dead-reckoned position, one second later.
TRACK_MARGIN_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FixMeasurement:
    """One surfacing: positions by GPS and by dead reckoning, each north, east (m).

    Attributes:
        position_m: Position by GPS.
        raw_m: Dead-reckoned position.
        std_m: Standard deviation of the GPS position, each axis.
    """

    vehicle: int
    stamp_s: float
    position_m: tuple[float, float]
    raw_m: tuple[float, float]
    std_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeMeasurement:
    """One range, from the travel time of a packet.

    Attributes:
        sent_s: Start of the transmission.
        arrived_s: Start of the reception.
        range_m: Travel time by the two clocks, times the speed of sound.
        deeper_m: Depth difference of the two vehicles; 0 if unknown.
        by_ping: Two-way travel time, measured with the receiver's clock alone.
    """

    sender: int
    receiver: int
    sent_s: float
    arrived_s: float
    range_m: float
    deeper_m: float = 0.0
    by_ping: bool = False


class Fixes:
    """Fixes, prepared for the estimation."""

    def __init__(self, model: TeamErrorModel, rows: Sequence[FixMeasurement]) -> None:
        self._model = model
        self._rows = sorted(rows, key=lambda row: row.vehicle)
        self._groups: list[tuple[slice, TrackPositions, Array, Array]] = []
        for number in sorted({row.vehicle for row in rows}):
            own = [row for row in rows if row.vehicle == number]
            vehicle = model.vehicles[number]
            stamps, raw = np.array([row.stamp_s for row in own]), np.array([row.raw_m for row in own])
            positions, std = np.array([row.position_m for row in own]), np.array([row.std_m for row in own])
            sums = vehicle.positions(vehicle.track.at(stamps, raw))
            self._groups.append((vehicle.block, sums, positions, np.repeat(std, 2)))

    def __len__(self) -> int:
        """Number of fixes."""
        return len(self._rows)

    @property
    def vehicles(self) -> Ints:
        """The vehicle of each fix (n,), in the order of the residuals."""
        return np.array([row.vehicle for row in self._rows], dtype=np.int64)

    def std_m(self, number: int) -> float:
        """Standard deviation of fix `number`, in the order of the residuals (m)."""
        return self._rows[number].std_m

    def without(self, number: int) -> Fixes:
        """All but fix `number`, in the order of the residuals."""
        return Fixes(self._model, self._rows[:number] + self._rows[number + 1 :])

    def plausible(self) -> Fixes:
        """The fixes that the prior can explain."""
        zero = np.zeros(self._model.size)
        sigmas = _sigmas(self._model, self.residuals(zero), self.derivatives(zero)).reshape(-1, 2)
        kept = np.asarray(sigmas.max(axis=1) <= FIX_SIGMAS)
        return self if kept.all() else Fixes(self._model, list(compress(self._rows, kept.tolist())))

    def residuals(self, theta: Array) -> Array:
        """Measured minus predicted, divided by the standard deviation, (m,)."""
        parts = [(positions - sums.positions(theta)).ravel() / std for _, sums, positions, std in self._groups]
        return np.concatenate([np.zeros(0), *parts])

    def derivatives(self, theta: Array) -> Array:
        """Derivatives (m, unknowns) of the predictions, divided by the standard deviations."""
        rows = [np.zeros((0, self._model.size))]
        for block, sums, _, std in self._groups:
            jacobian = np.zeros((2 * len(sums), self._model.size))
            jacobian[:, block] = sums.jacobian(theta).reshape(2 * len(sums), -1) / std[:, None]
            rows.append(jacobian)
        return np.concatenate(rows)


class Ranges:
    """Ranges, prepared for the estimation."""

    def __init__(self, model: TeamErrorModel, rows: Sequence[RangeMeasurement]) -> None:
        self._model = model
        self._rows = sorted(rows, key=_group)
        self._std_m = model.config.range_std_m
        self._groups: list[tuple[tuple[int, int, bool], TrackPositions, TrackPositions, Array, Array]] = []
        for pair in sorted({_group(row) for row in rows}):
            own = [row for row in rows if _group(row) == pair]
            sender, receiver = model.vehicles[pair[0]], model.vehicles[pair[1]]
            sent = sender.positions(sender.track.at(np.array([row.sent_s for row in own])))
            arrived = receiver.positions(receiver.track.at(np.array([row.arrived_s for row in own])))
            measured, deeper = np.array([row.range_m for row in own]), np.array([row.deeper_m for row in own])
            self._groups.append((pair, sent, arrived, measured, deeper))
        many = model.size > MANY_UNKNOWNS and bool(self._groups)
        self._together = _RangesTogether(model, self._groups, self._clocks) if many else None

    def __len__(self) -> int:
        """Number of ranges."""
        return len(self._rows)

    @property
    def senders(self) -> Ints:
        """The sender of each range (m,), in the order of the residuals."""
        return np.array([row.sender for row in self._rows], dtype=np.int64)

    @property
    def receivers(self) -> set[int]:
        """The vehicles that have received a range."""
        return {row.receiver for row in self._rows}

    def plausible(self) -> Ranges:
        """The ranges between known parts of tracks that the prior can explain."""
        zero = np.zeros(self._model.size)
        kept = _sigmas(self._model, self.residuals(zero), self.derivatives(zero)) <= RANGE_SIGMAS
        kept &= np.array([self._is_between_tracks(row) for row in self._rows], dtype=bool)
        return self if kept.all() else Ranges(self._model, list(compress(self._rows, kept.tolist())))

    def _is_between_tracks(self, row: RangeMeasurement) -> bool:
        """Whether both vehicles' tracks are known at the time; without one, they would seem to have stopped."""
        ends = ((row.sender, row.sent_s), (row.receiver, row.arrived_s))
        tracks = [(self._model.vehicles[number].track, stamp_s) for number, stamp_s in ends]
        return all(t.start_s - TRACK_MARGIN_S <= stamp_s <= t.end_s + TRACK_MARGIN_S for t, stamp_s in tracks)

    def residuals(self, theta: Array) -> Array:
        """As `Fixes.residuals`, ordered by pairs."""
        if self._together is not None:
            return self._together.residuals(theta)
        parts = [np.zeros(0)]
        for pair, sent, arrived, measured, deeper in self._groups:
            distance = _distance(sent.positions(theta) - arrived.positions(theta), deeper)
            predicted = (1.0 + theta[self._model.sound]) * distance
            for sign, clock, late in self._clocks(pair, sent, arrived):
                predicted = predicted + sign * (theta[clock] + theta[clock + 1] * late)
            parts.append((measured - predicted) / self._std_m)
        return np.concatenate(parts)

    def derivatives(self, theta: Array) -> Array:
        """As `Fixes.derivatives`."""
        if self._together is not None:
            return self._together.derivatives(theta)
        model = self._model
        rows = [np.zeros((0, model.size))]
        faster = 1.0 + theta[model.sound]
        for pair, sent, arrived, measured, deeper in self._groups:
            sender, receiver, _ = pair
            apart = sent.positions(theta) - arrived.positions(theta)
            distance = _distance(apart, deeper)
            toward = faster * apart / np.maximum(distance, 1e-9)[:, None]
            jacobian = np.zeros((len(measured), model.size))
            jacobian[:, model.vehicles[sender].block] += _along(toward, sent.jacobian(theta))
            jacobian[:, model.vehicles[receiver].block] -= _along(toward, arrived.jacobian(theta))
            jacobian[:, model.sound] = distance
            for sign, clock, late in self._clocks(pair, sent, arrived):
                jacobian[:, clock] += sign
                jacobian[:, clock + 1] += sign * late
            rows.append(jacobian / self._std_m)
        return np.concatenate(rows)

    def _clocks(
        self, pair: tuple[int, int, bool], sent: TrackPositions, arrived: TrackPositions
    ) -> list[tuple[float, int, Array]]:
        """The pair's clocks except references: sign, first unknown, thousands of seconds since the start (n,)."""
        sender, receiver, by_ping = pair
        if by_ping:
            return []
        found = []
        for number, sign, stamps_s in ((receiver, 1.0, arrived.stamps_s), (sender, -1.0, sent.stamps_s)):
            clock = self._model.clock(number)
            if clock is not None:
                found.append((sign, clock, (stamps_s - self._model.vehicles[number].track.start_s) * 1e-3))
        return found


#: A group of ranges of one pair: (sender, receiver, by ping), positions at both ends, ranges and depth differences (m).
_Group = tuple[tuple[int, int, bool], TrackPositions, TrackPositions, Array, Array]
_Clocks = Callable[[tuple[int, int, bool], TrackPositions, TrackPositions], list[tuple[float, int, Array]]]


class _RangesTogether:
    """The ranges (n,) of all pairs of a large team, computed at once; as `Ranges`, in the same order."""

    def __init__(self, model: TeamErrorModel, groups: Sequence[_Group], clocks: _Clocks) -> None:
        size, counts = model.size, [len(measured) for _, _, _, measured, _ in groups]
        rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        self._size, self._sound, self._std_m = size, model.sound, model.config.range_std_m
        self._sent = TeamPositions([(own, sent) for own, (_, sent, *_) in zip(rows, groups, strict=True)], size)
        self._arrived = TeamPositions([(own, to) for own, (_, _, to, *_) in zip(rows, groups, strict=True)], size)
        self._measured_m = np.concatenate([measured for *_, measured, _ in groups])
        self._deeper_m = np.concatenate([deeper for *_, deeper in groups])
        # of both clocks, receiver first: number of the first unknown (`size` for a reference), sign, and its time
        self._clock, self._sign, self._late = np.full((2, sum(counts)), size), *np.zeros((2, 2, sum(counts)))
        for own, (pair, sent, arrived, *_) in zip(rows, groups, strict=True):
            for end, (sign, clock, ks) in enumerate(clocks(pair, sent, arrived)):
                self._clock[end, own], self._sign[end, own], self._late[end, own] = clock, sign, ks

    def residuals(self, theta: Array) -> Array:
        """As `Ranges.residuals`."""
        apart = self._sent.positions(theta) - self._arrived.positions(theta)
        predicted = (1.0 + theta[self._sound]) * _distance(apart, self._deeper_m)
        known = np.append(theta, [0.0, 0.0])
        predicted += (self._sign * (known[self._clock] + known[self._clock + 1] * self._late)).sum(axis=0)
        return np.asarray((self._measured_m - predicted) / self._std_m)

    def derivatives(self, theta: Array) -> Array:
        """As `Ranges.derivatives`."""
        apart = self._sent.positions(theta) - self._arrived.positions(theta)
        distance = _distance(apart, self._deeper_m)
        toward = (1.0 + theta[self._sound]) * apart / np.maximum(distance, 1e-9)[:, None]
        row = np.arange(len(distance))
        out = np.zeros((len(distance), self._size + 2))  # the last two columns collect derivatives without an unknown
        out[row[:, None], self._sent.unknowns] += self._sent.derivatives_along(theta, toward)
        out[row[:, None], self._arrived.unknowns] -= self._arrived.derivatives_along(theta, toward)
        out[row, self._sound] = distance
        for clock, sign, late in zip(self._clock, self._sign, self._late, strict=True):
            out[row, clock] += sign
            out[row, clock + 1] += sign * late
        return np.asarray(out[:, : self._size] / self._std_m)


def _group(row: RangeMeasurement) -> tuple[int, int, bool]:
    return row.sender, row.receiver, row.by_ping


def _sigmas(model: TeamErrorModel, residuals: Array, derivatives: Array) -> Array:
    """Absolute whitened residuals (m,) at the prior mean, in units of their prior standard deviations."""
    prior = derivatives * model.prior_std()
    return np.asarray(np.abs(residuals) / np.sqrt(1.0 + np.einsum("mu,mu->m", prior, prior)))


def _distance(apart: Array, deeper: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("nd,nd->n", apart, apart) + deeper**2))


def _along(toward: Array, jacobian: Array) -> Array:
    return np.asarray(toward[:, :1] * jacobian[:, 0] + toward[:, 1:] * jacobian[:, 1])


def within_gate(residuals: Array) -> Mask:
    """Mask of the whitened residuals (m,) within `GATE` median absolute deviations of their median."""
    if not len(residuals):
        return np.zeros(0, dtype=bool)
    middle = float(np.median(residuals))
    spread = _MAD_TO_STD * float(np.median(np.abs(residuals - middle)))
    return np.asarray(np.abs(residuals - middle) <= max(GATE * spread, _MIN_GATE))


def usable(row: RangeMeasurement) -> bool:
    """Whether a range is finite, and neither too short nor implausibly long."""
    numbers = (row.sent_s, row.arrived_s, row.range_m, row.deeper_m)
    return all(math.isfinite(n) for n in numbers) and NEAREST_M <= row.range_m <= 1e5
