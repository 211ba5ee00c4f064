"""Takes the altitudes of one sensor if several look down: at different heights of the hull, they must not be mixed."""

import math
from collections import Counter
from collections.abc import Callable


class SonarChoice:
    """The sensor that is used: the first one, while it sends."""

    def __init__(self, stale_after_s: float, report: Callable[[str], None], counts: Counter[str]) -> None:
        """Takes another one after `stale_after_s` (s) of silence; counts "altitudes_of_others" in `counts`."""
        self._stale_s, self._report, self._counts = stale_after_s, report, counts
        self._name, self._heard_s = "", -math.inf

    def takes(self, now_s: float, name: str) -> bool:
        """Whether an altitude of the sensor `name` at `now_s` (s) is used; reports a second one."""
        if name == self._name or not self._name or now_s - self._heard_s > self._stale_s:
            self._name, self._heard_s = name, now_s
            return True
        self._counts["altitudes_of_others"] += 1
        if self._counts["altitudes_of_others"] == 1:
            self._report(
                f"two sensors look down: {self._name} is used, {name} is not. Turn one off, or give the range finder "
                "another orientation than 25"
            )
        return False
