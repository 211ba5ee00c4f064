"""Recomputes the map of a vehicle whose recording has none, from its soundings and received samples."""

import math

from numpy.typing import ArrayLike

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_gp.map.depth_map import DepthField, DepthMap

#: Mission time (s) without a map from the vehicle after which it is computed here.
_PATIENCE_S = 5.0


class OwnMap:
    """Waits briefly for the vehicle's own map, then computes it as `gp_node` would.

    Attributes:
        stopped: Whether the vehicle publishes its own map.
    """

    def __init__(self, settings: PlannerSettings, area: OperatingArea) -> None:
        self._settings = settings
        self._area = area
        self._map: DepthMap | None = None
        self._waiting: list[tuple[int, ArrayLike]] = []  # the vehicle they come from, 0 for its own soundings
        self._first_s = math.inf
        self._made_s = -math.inf
        self.stopped = False

    @property
    def has_news(self) -> bool:
        """Whether soundings or samples have come since the last map."""
        return bool(self._waiting)

    def stop(self) -> None:
        """Stops computing: the vehicle publishes its own map."""
        self.stopped = True
        self._waiting.clear()

    def add(self, rows: ArrayLike, source: int = 0) -> None:
        """Adds own soundings: stamp (s), north, east, depth (m); of vehicle `source`, samples without stamps."""
        if not self.stopped:
            self._waiting.append((source, rows))

    def field(self, now_s: float, at_once: bool = False) -> DepthField | None:
        """The map, if one is due at `now_s`, or wanted at once, and the vehicle publishes none."""
        self._first_s = min(self._first_s, now_s)
        period_s = self._settings.gp.publish_period_s if self._map is None else self._map.publish_period_s
        is_early = now_s - self._first_s < _PATIENCE_S or now_s - self._made_s < period_s
        if self.stopped or (is_early and not at_once):
            return None
        self._made_s = now_s
        if self._map is None:
            self._map = DepthMap(self._settings.gp, self._settings.level_set, self._area)
        for source, rows in self._waiting:
            if source:
                self._map.add_samples(rows, source)
            else:
                self._map.add_soundings(rows)
        self._waiting.clear()
        return self._map.field()
