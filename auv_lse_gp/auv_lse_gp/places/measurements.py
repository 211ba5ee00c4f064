"""What a team measures of its places: fixes, and ranges between vehicles. Terrain: see `terrain.py`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.places.error_model import TeamErrorModel, TrackPositions

Array = NDArray[np.float64]

#: Ranges are refused beyond this many median absolute deviations, made comparable with standard deviations, ...
GATE = 4.0
_MAD_TO_STD = 1.4826
#: ... but never where they are off by less than this many of their standard deviations.
_LEAST_GATE = 2.0
#: With one range or two that says nothing. So what is farther off than so many standard deviations of what is known
#: before is refused as well: ranges, which echoes make longer, and fixes, which are off by this for a broken receiver.
RANGE_SIGMAS, FIX_SIGMAS = 8.0, 30.0
#: A shorter range (m) is not used: its direction is that of the error, and how much deeper one vehicle is matters.
NEAREST_M = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FixMeasurement:
    """One surfacing: where the vehicle was by GPS, and by dead reckoning.

    Attributes:
        vehicle: Number of the vehicle.
        stamp_s: When.
        place_m: Place by GPS (north, east).
        raw_m: Raw place.
        std_m: Standard deviation of the place by GPS, each axis.
    """

    vehicle: int
    stamp_s: float
    place_m: tuple[float, float]
    raw_m: tuple[float, float]
    std_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeMeasurement:
    """One range, from the travel time of a packet.

    Attributes:
        sender: Number of the vehicle that sent.
        receiver: Number of the vehicle that received.
        sent_s: Start of the transmission.
        arrived_s: Start of the reception.
        range_m: Travel time by the two clocks, times the speed of sound.
        deeper_m: How much deeper one of the two is than the other; 0 if not known.
        by_ping: Measured there and back by the receiver's clock alone.
    """

    sender: int
    receiver: int
    sent_s: float
    arrived_s: float
    range_m: float
    deeper_m: float = 0.0
    by_ping: bool = False


class Fixes:
    """Fixes, ready for the solution."""

    def __init__(self, model: TeamErrorModel, rows: Sequence[FixMeasurement]) -> None:
        """Looks up what each fix needs of its vehicle's track."""
        self._model = model
        self._rows = sorted(rows, key=lambda row: row.vehicle)
        self._groups: list[tuple[slice, TrackPositions, Array, Array]] = []
        for number in sorted({row.vehicle for row in rows}):
            own = [row for row in rows if row.vehicle == number]
            vehicle = model.vehicles[number]
            stamps, raw = np.array([row.stamp_s for row in own]), np.array([row.raw_m for row in own])
            places, std = np.array([row.place_m for row in own]), np.array([row.std_m for row in own])
            sums = vehicle.positions(vehicle.track.at(stamps, raw))
            self._groups.append((vehicle.block, sums, places, np.repeat(std, 2)))

    def __len__(self) -> int:
        """Number of fixes."""
        return len(self._rows)

    def std_m(self, number: int) -> float:
        """Standard deviation of fix `number`, in the order of the residuals (m)."""
        return self._rows[number].std_m

    def without(self, number: int) -> Fixes:
        """All but fix `number`, in the order of the residuals."""
        return Fixes(self._model, self._rows[:number] + self._rows[number + 1 :])

    def plausible(self) -> Fixes:
        """Those that the errors that are known before can explain."""
        zero = np.zeros(self._model.size)
        sigmas = _sigmas(self._model, self.residuals(zero), self.derivatives(zero)).reshape(-1, 2)
        kept = np.asarray(sigmas.max(axis=1) <= FIX_SIGMAS)
        return self if kept.all() else Fixes(self._model, list(compress(self._rows, kept.tolist())))

    def residuals(self, theta: Array) -> Array:
        """What was measured less what is expected, over its standard deviation (m,)."""
        parts = [(places - sums.places(theta)).ravel() / std for _, sums, places, std in self._groups]
        return np.concatenate([np.zeros(0), *parts])

    def derivatives(self, theta: Array) -> Array:
        """Derivatives (m, unknowns) of what is expected, over the standard deviations."""
        rows = [np.zeros((0, self._model.size))]
        for block, sums, _, std in self._groups:
            jacobian = np.zeros((2 * len(sums), self._model.size))
            jacobian[:, block] = sums.jacobian(theta).reshape(2 * len(sums), -1) / std[:, None]
            rows.append(jacobian)
        return np.concatenate(rows)


class Ranges:
    """Ranges, ready for the solution."""

    def __init__(self, model: TeamErrorModel, rows: Sequence[RangeMeasurement]) -> None:
        """Looks up where each range begins and ends on the vehicles' tracks."""
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

    def __len__(self) -> int:
        """Number of ranges."""
        return len(self._rows)

    def plausible(self) -> Ranges:
        """Those that the errors that are known before can explain."""
        zero = np.zeros(self._model.size)
        kept = _sigmas(self._model, self.residuals(zero), self.derivatives(zero)) <= RANGE_SIGMAS
        return self if kept.all() else Ranges(self._model, list(compress(self._rows, kept.tolist())))

    def residuals(self, theta: Array) -> Array:
        """As `Fixes.residuals`, in the order of pairs."""
        parts = [np.zeros(0)]
        for pair, sent, arrived, measured, deeper in self._groups:
            distance = _distance(sent.places(theta) - arrived.places(theta), deeper)
            predicted = (1.0 + theta[self._model.sound]) * distance
            for _, sign, clock, late in self._clocks(pair, sent, arrived):
                predicted = predicted + sign * (theta[clock] + theta[clock + 1] * late)
            parts.append((measured - predicted) / self._std_m)
        return np.concatenate(parts)

    def derivatives(self, theta: Array) -> Array:
        """As `Fixes.derivatives`."""
        model = self._model
        rows = [np.zeros((0, model.size))]
        faster = 1.0 + theta[model.sound]
        for pair, sent, arrived, measured, deeper in self._groups:
            sender, receiver, _ = pair
            apart = sent.places(theta) - arrived.places(theta)
            distance = _distance(apart, deeper)
            toward = faster * apart / np.maximum(distance, 1e-9)[:, None]
            jacobian = np.zeros((len(measured), model.size))
            jacobian[:, model.vehicles[sender].block] += _along(toward, sent.jacobian(theta))
            jacobian[:, model.vehicles[receiver].block] -= _along(toward, arrived.jacobian(theta))
            jacobian[:, model.sound] = distance
            for _, sign, clock, late in self._clocks(pair, sent, arrived):
                jacobian[:, clock] += sign
                jacobian[:, clock + 1] += sign * late
            rows.append(jacobian / self._std_m)
        return np.concatenate(rows)

    def _clocks(
        self, pair: tuple[int, int, bool], sent: TrackPositions, arrived: TrackPositions
    ) -> list[tuple[int, float, int, Array]]:
        """The two clocks of a pair but the reference: vehicle, sign, first unknown, thousands of s since its start."""
        sender, receiver, by_ping = pair
        if by_ping:
            return []
        ends = ((receiver, 1.0, arrived.stamps_s), (sender, -1.0, sent.stamps_s))
        vehicles = self._model.vehicles
        clocks = [
            (number, sign, self._model.clock(number), (at - vehicles[number].track.start_s) * 1e-3)
            for number, sign, at in ends
        ]
        return [(number, sign, clock, late) for number, sign, clock, late in clocks if clock is not None]


def _group(row: RangeMeasurement) -> tuple[int, int, bool]:
    return row.sender, row.receiver, row.by_ping


def _sigmas(model: TeamErrorModel, residuals: Array, derivatives: Array) -> Array:
    """How far whitened residuals (m,) are from 0 before any measurement, in their standard deviations then, (m,)."""
    known = derivatives * model.prior_std()
    return np.asarray(np.abs(residuals) / np.sqrt(1.0 + np.einsum("mu,mu->m", known, known)))


def _distance(apart: Array, deeper: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("nd,nd->n", apart, apart) + deeper**2))


def _along(toward: Array, jacobian: Array) -> Array:
    return np.asarray(toward[:, :1] * jacobian[:, 0] + toward[:, 1:] * jacobian[:, 1])


def within_gate(residuals: Array) -> NDArray[np.bool_]:
    """Which whitened residuals (m,) are within `GATE` median absolute deviations of their median."""
    if not len(residuals):
        return np.zeros(0, dtype=bool)
    middle = float(np.median(residuals))
    spread = _MAD_TO_STD * float(np.median(np.abs(residuals - middle)))
    return np.asarray(np.abs(residuals - middle) <= max(GATE * spread, _LEAST_GATE))


def usable(row: RangeMeasurement) -> bool:
    """Whether a range can be used at all: finite, and neither too short nor absurd."""
    numbers = (row.sent_s, row.arrived_s, row.range_m, row.deeper_m)
    return all(math.isfinite(n) for n in numbers) and NEAREST_M <= row.range_m <= 1e5
