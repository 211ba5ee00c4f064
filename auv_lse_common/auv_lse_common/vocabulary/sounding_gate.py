"""The gate for a vehicle's own soundings: what its sensors cannot have measured, told by the soundings before.

A map with a wrong prior would refuse the truth, so this gate knows no map. It compares each sounding with the last one
that it has passed, over the distance between the two:

- *jump*: the depth differs by more than `SLOPE` times the distance and `SPREAD_M`. Where `AGREEING` jumps in a row
  agree with one another it is the ground, or another reading of the sensor that lasts: they pass from there on.
- *frozen*: the same depth to the last digit over more ground than can be as flat (`hanging.py`): it rises at least
  `FLATTEST`, so that a sounder with steps of a decimetre repeats itself over 50 m.
- *late*: a stamp before that of the last one: time runs backwards. After `AGREEING` of them in a row the clock has been
  set, and they pass.

What is not finite is left to those who read the soundings: they count it by themselves.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from auv_lse_common.vocabulary.frozen_sensor import HangingSensor

#: Steepest ground (m per m) along a track, and what noise and a wrong place may add (m).
SLOPE = 1.0
SPREAD_M = 2.0
#: Refused soundings in a row that agree with one another are believed.
AGREEING = 4
#: Flattest ground (m per m) that is believed.
FLATTEST = 0.002


class SoundingGate:
    """The soundings of one vehicle, in the order in which they come.

    Attributes:
        counts: Soundings refused: "jump", "frozen", "late".
    """

    def __init__(self) -> None:
        """Knows no sounding."""
        self.counts: Counter[str] = Counter()
        self._last: Sequence[float] | None = None
        self._refused: Sequence[float] | None = None  # the last one refused
        self._in_a_row = 0
        self._sounder = HangingSensor(FLATTEST)

    def passed(self, rows: Iterable[Sequence[float]]) -> list[Sequence[float]]:
        """Those that pass, in their order.

        Args:
            rows: Stamp (s), north, east, depth (m) of each, and what else belongs to it.
        """
        return [row for row in rows if self._passes(row)]

    def _passes(self, row: Sequence[float]) -> bool:
        if not all(map(math.isfinite, row[:4])):
            return True
        if self._sounder.hangs(row[3], row[1], row[2]):
            self.counts["frozen"] += 1
            return False
        last = self._last
        problem = "" if last is None else _problem(last, row)
        if problem:
            self._in_a_row = self._in_a_row + 1 if self._agrees(row) else 1
            self._refused = row
            if self._in_a_row < AGREEING:
                self.counts[problem] += 1
                return False
        self._last, self._refused, self._in_a_row = row, None, 0
        return True

    def _agrees(self, row: Sequence[float]) -> bool:
        return self._refused is not None and not _problem(self._refused, row)


def _apart_m(a: Sequence[float], b: Sequence[float]) -> float:
    return math.hypot(b[1] - a[1], b[2] - a[2])


def _problem(last: Sequence[float], row: Sequence[float]) -> str:
    """What is wrong with a sounding after another; "" if nothing is."""
    if row[0] < last[0]:
        return "late"
    return "jump" if abs(row[3] - last[3]) > SLOPE * _apart_m(last, row) + SPREAD_M else ""
