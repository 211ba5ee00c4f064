"""Ends a mission before its last step when the team's maps have the quality that `mission.until` asks for.

Each vehicle's `gp_node` judges its own map (`auv_lse_gp/map/quality_watch.py`); this module counts the judgements. New
soundings can lower an estimated quality again. So a map has the quality once `IN_A_ROW` judgements in a row have found
it. While it has, every packet of the vehicle announces it (`Plan.quality_reached`), also after its end.

With a judgement of the current map, the vehicle makes its next leg the last one when every team mate has announced the
same, or has been silent for `planner.plan_expiry_s`. A lost packet only delays the end, and no packet can end a vehicle
whose own map lacks the quality.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.map_quality import UNKNOWN, Quality
from auv_lse_planner.methods.horizon import Horizon
from auv_lse_planner.methods.stages import is_staged

#: Judgements in a row that must find the quality.
IN_A_ROW = 2


class Until:
    """One vehicle's part in the agreement to end.

    Attributes:
        quality: Quality of the map at the last judgement.
        met: Number of the last judgements in a row that found the quality asked for.
        ends: Whether the next leg is the last one.
        horizon: The step at which the vehicle plans to have this quality.
    """

    def __init__(self, settings: PlannerSettings, area: OperatingArea, mates: Sequence[int]) -> None:
        """Starts without a judgement."""
        self.asked = settings.mission.until
        self.quality = UNKNOWN
        self.met = 0
        self.ends = False
        self.horizon = Horizon(settings, area, self.asked.found if plans_to_horizon(settings) else None)
        self._heard: dict[int, tuple[float, bool]] = {}
        self._mates = tuple(mates)
        self._silence_s = settings.planner.complete().plan_expiry_s
        self._began_s: float | None = None

    @property
    def reached(self) -> bool:
        """Whether the map has the quality asked for."""
        return self.met >= IN_A_ROW

    def begin_decision(self, now_s: float, step: int) -> None:
        """Prepares for a decision from `step` at `now_s` (s). Silence of mates counts from the first one on."""
        if self._began_s is None:
            self._began_s = now_s
        self.horizon.extend(step)

    def hear(self, now_s: float, mate: int, reached: bool) -> None:
        """Records whether a mate's packet, received at `now_s` (s), announced the quality."""
        self._heard[mate] = now_s, reached

    def agreed(self, now_s: float) -> bool:
        """Whether this map has the quality, and so has each mate that was heard within `planner.plan_expiry_s`."""
        if self._began_s is None:
            return False
        began = self._began_s, False
        heard = [self._heard.get(mate, began) for mate in self._mates]
        return self.reached and all(reached or now_s - heard_s > self._silence_s for heard_s, reached in heard)

    def judged(self, now_s: float, quality: Quality, decided: int, is_current: bool) -> bool:
        """Counts a judgement.

        Args:
            is_current: Whether the planner has no newer map than the one that was judged.

        Returns:
            Whether the judgement is new: messages may be repeated.
        """
        if quality == self.quality or not self.asked.is_asked:
            return False
        self.quality = quality
        self.met = self.met + 1 if self.asked.is_met(quality) else 0
        self.ends = is_current and self.agreed(now_s)
        if not self.met:
            self.horizon.judged(decided, quality.found_share)
        return True

    def snapshot(self) -> dict[str, Any]:
        """The state, for a journal; what mates announced is in the plans that it holds."""
        return {
            "met": self.met,
            "ends": self.ends,
            "began_s": self._began_s,
            "horizon": self.horizon.end,
            "quality": dataclasses.asdict(self.quality),
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self.quality = Quality(**values["quality"])
        self.met, self.ends, self._began_s = values["met"], values["ends"], values["began_s"]
        self.horizon.end = values["horizon"]


def plans_to_horizon(settings: PlannerSettings) -> bool:
    """Whether a mission's tours are planned for a share found (`methods/horizon.py`).

    Only those of a team are, if they are optimized again and not in stages. A single vehicle gains nothing by it.
    """
    planner, mission = settings.planner.complete(), settings.mission
    is_tour = mission.until.found is not None and planner.family_name == "tour" and bool(planner.tour_interval)
    return is_tour and mission.vehicles > 1 and not is_staged(mission)
