"""Gauss-Newton steps of a large team: each mate's unknowns are eliminated on their own.

Ranges couple the unknowns of a vehicle that receives nothing, a *mate* here, with those of the receivers, not with
those of other mates. With a mate's derivatives A_k, the derivatives B_k of the same measurements with respect to all
shared unknowns (those of receivers, and the speed of sound), and prior precisions P, the normal equations are

    (A_k' A_k + P_k) x_k + A_k' B_k x = g_k    for each mate k,    sum_k B_k' A_k x_k + (B' B + P) x = g

The x_k are inserted into the last equation, which is then solved for x. That takes a tenth of the operations of solving
for all unknowns at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.positions.error_model import TeamErrorModel
from auv_lse_gp.positions.measurements import Fixes, Ranges


class Elimination:
    """The normal equations of a team whose mates are coupled through shared unknowns only."""

    def __init__(self, precision: Array, mates: Sequence[tuple[Ints, Ints]], measurements: int) -> None:
        """Plans the elimination for equations of a structure.

        Args:
            precision: Prior precision of each unknown (u,).
            mates: For each mate, the numbers of its measurements and of its unknowns. Measurements of no mate depend on
                shared unknowns alone.
            measurements: Number of all measurements m.
        """
        size = len(precision)
        self._rows = _padded([rows for rows, _ in mates], measurements)
        self._unknowns = _padded([unknowns for _, unknowns in mates], size)
        is_shared = np.ones(size + 1, dtype=bool)
        is_shared[self._unknowns] = False
        self._shared = np.flatnonzero(is_shared[:size])
        self._precision = precision
        self._own_precision = np.append(precision, 1.0)[self._unknowns]  # 1 for padding, whose derivatives are 0

    @classmethod
    def of(cls, model: TeamErrorModel, fixes: Fixes, ranges: Ranges) -> Elimination | None:
        """The structure of a team's equations, of its fixes and then its ranges; None if all its vehicles receive."""
        of_row = np.concatenate([np.repeat(fixes.vehicles, 2), ranges.senders])
        mates = []
        for number, vehicle in model.vehicles.items():
            if number not in ranges.receivers:
                clock = model.clock(number)
                clocks = [] if clock is None else [clock, clock + 1]
                unknowns = np.append(np.arange(vehicle.block.start, vehicle.block.stop), clocks).astype(np.int64)
                mates.append((np.flatnonzero(of_row == number), unknowns))
        return cls(model.prior_std() ** -2.0, mates, len(of_row)) if mates else None

    def information(self, rows: Array) -> Array:
        """rows' rows + the prior's precision, (u, u), for whitened derivatives of the measurements (m, u)."""
        own, across, shared = self._blocks(rows)
        out = np.zeros((rows.shape[1] + 1,) * 2)
        out[self._unknowns[:, :, None], self._unknowns[:, None]] = own
        out[self._unknowns[:, :, None], self._shared] = across
        out[self._shared[:, None, None], self._unknowns] = across.transpose(2, 0, 1)
        out[np.ix_(self._shared, self._shared)] = shared
        return np.ascontiguousarray(out[:-1, :-1])

    def step(self, rows: Array, gradient: Array) -> Array:
        """Solves information(rows) x = gradient (u,) for x (u,).

        Raises:
            LinAlgError: if the information is singular.
        """
        own, across, shared = self._blocks(rows)
        right = np.append(gradient, 0.0)[self._unknowns][:, :, None]
        solved = np.linalg.solve(own, np.concatenate([across, right], axis=2))
        flat, coupling = solved.reshape(-1, solved.shape[2]), across.reshape(-1, across.shape[2]).T
        factor = cho_factor(shared - coupling @ flat[:, :-1], lower=True)
        x = cho_solve(factor, gradient[self._shared] - coupling @ flat[:, -1])
        step = np.zeros(rows.shape[1] + 1)
        step[self._unknowns] = solved[:, :, -1] - solved[:, :, :-1] @ x
        step[self._shared] = x
        return step[:-1]

    def _blocks(self, rows: Array) -> tuple[Array, Array, Array]:
        """The information of each mate's p unknowns (k, p, p), across to the shared ones (k, p, s), of these (s, s)."""
        padded, shared = np.zeros((len(rows) + 1, rows.shape[1] + 1)), rows[:, self._shared]
        padded[:-1, :-1] = rows
        measured = self._rows[:, :, None]
        own_t = padded[measured, self._unknowns[:, None]].transpose(0, 2, 1)
        own, across = own_t @ own_t.transpose(0, 2, 1), own_t @ padded[measured, self._shared]
        np.einsum("kuu->ku", own)[:] += self._own_precision
        return own, across, shared.T @ shared + np.diag(self._precision[self._shared])


def _padded(numbers: Sequence[Ints], filler: int) -> Ints:
    """Lists of numbers as the rows of a table (k, longest list), filled up with `filler`."""
    table = np.full((len(numbers), max(map(len, numbers), default=0)), filler)
    for row, own in zip(table, numbers, strict=True):
        row[: len(own)] = own
    return table
