"""Rejects implausible soundings of this vehicle by comparison with earlier soundings.

The gate does not use the map, because a map with a wrong prior would reject correct soundings. It compares each
sounding with the last one that passed:

- *jump*: the depth differs by more than `SLOPE` times the distance, plus `SPREAD_M`. After `AGREEING` jumps in a row
  that agree with each other, they pass: the ground or the sensor's bias has changed permanently.
- *frozen*: the same depth to the last digit over more ground than can be flat (`frozen_sensor.py` with `FLATTEST`). A
  sounder with a resolution of 0.1 m can repeat itself over 50 m.
- *late*: a stamp before the last one. After `AGREEING` in a row the clock has been set, and they pass.

Soundings that are not finite pass: their readers count them.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.frozen_sensor import FrozenSensor, frozen_values

#: Steepest ground (m per m) along a track, and the margin (m) for noise and position errors.
SLOPE = 1.0
SPREAD_M = 2.0
#: After this many rejected soundings in a row that agree with each other, they are accepted.
AGREEING = 4
#: Flattest plausible ground (m per m).
FLATTEST = 0.002


class SoundingGate:
    """The gate of one vehicle; takes its soundings in order of arrival.

    Attributes:
        counts: Rejected soundings by reason: "jump", "frozen", "late".
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._last: Sequence[float] | None = None
        self._rejected: Sequence[float] | None = None  # the last rejected one
        self._in_a_row = 0
        self._sounder = FrozenSensor(FLATTEST)

    def passed(self, rows: Iterable[Sequence[float]]) -> list[Sequence[float]]:
        """The soundings that pass, in order.

        Args:
            rows: Stamp (s), north, east, depth (m) of each; further columns are kept.
        """
        return [row for row in rows if self._passes(row)]

    def _passes(self, row: Sequence[float]) -> bool:
        if not all(map(math.isfinite, row[:4])):
            return True
        if self._sounder.update(row[3], row[1], row[2]):
            self.counts["frozen"] += 1
            return False
        return self._follows(row)

    def _follows(self, row: Sequence[float]) -> bool:
        """Whether a sounding of a working sounder is plausible after the earlier ones."""
        last = self._last
        problem = "" if last is None else _problem(last, row)
        if problem:
            self._in_a_row = self._in_a_row + 1 if self._agrees(row) else 1
            self._rejected = row
            if self._in_a_row < AGREEING:
                self.counts[problem] += 1
                return False
        self._last, self._rejected, self._in_a_row = row, None, 0
        return True

    def _agrees(self, row: Sequence[float]) -> bool:
        return self._rejected is not None and not _problem(self._rejected, row)


def _apart_m(a: Sequence[float], b: Sequence[float]) -> float:
    return math.hypot(b[1] - a[1], b[2] - a[2])


def _problem(last: Sequence[float], row: Sequence[float]) -> str:
    """Why a sounding is implausible after `last`; "" if it is not."""
    if row[0] < last[0]:
        return "late"
    return "jump" if abs(row[3] - last[3]) > SLOPE * _apart_m(last, row) + SPREAD_M else ""


def passing(rows: Array) -> tuple[Mask, Counter[str]]:
    """The result of a new `SoundingGate` for a whole survey: mask of the rows that pass, and the counts of the others.

    Python looks only at soundings that are implausible after the one before, and at those until the next that passes.

    Args:
        rows: Stamp (s), north, east, depth (m) of each, shape (n, 4), in order of arrival.
    """
    gate, passes = SoundingGate(), np.ones(len(rows), dtype=bool)
    finite = np.flatnonzero(np.isfinite(rows).all(axis=1))
    frozen = frozen_values(rows[finite, 3], rows[finite, 1], rows[finite, 2], FLATTEST)
    passes[finite[frozen]] = False
    gate.counts["frozen"] += int(frozen.sum())
    working = finite[~frozen]
    steps = np.diff(rows[working], axis=0)
    jumps = np.abs(steps[:, 3]) > SLOPE * np.hypot(steps[:, 1], steps[:, 2]) + SPREAD_M
    done = 0
    for odd in (np.flatnonzero(jumps | (steps[:, 0] < 0.0)) + 1).tolist():
        if odd < done:
            continue
        gate._last = rows[working[odd - 1]].tolist()
        for done in range(odd, len(working)):
            passes[working[done]] = gate._follows(rows[working[done]].tolist())
            if passes[working[done]]:
                break
        done += 1
    return passes, +gate.counts
