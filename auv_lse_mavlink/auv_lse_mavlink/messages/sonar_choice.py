"""Takes the altitudes of one sonar if several look down: at different heights of the hull, they must not be mixed."""

import math
from collections import Counter
from collections.abc import Callable


class SonarChoice:
    """The sonar that is used: the first one, while it sends."""

    def __init__(self, stale_after_s: float, report: Callable[[str], None], counts: Counter[str]) -> None:
        """Takes another sonar after `stale_after_s` (s) of silence; counts "altitudes_of_others" in `counts`."""
        self._stale_s, self._report, self._counts = stale_after_s, report, counts
        self._number, self._heard_s = -1, -math.inf

    def takes(self, now_s: float, number: int) -> bool:
        """Whether an altitude of sonar `number` (DISTANCE_SENSOR.id) at `now_s` (s) is used; reports a second one."""
        if number == self._number or now_s - self._heard_s > self._stale_s:
            self._number, self._heard_s = number, now_s
            return True
        self._counts["altitudes_of_others"] += 1
        if self._counts["altitudes_of_others"] == 1:
            self._report(
                f"two range finders look down: DISTANCE_SENSOR {self._number} is used, {number} is not. Turn one off, "
                "or change its orientation from 25"
            )
        return False
