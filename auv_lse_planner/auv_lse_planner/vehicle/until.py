"""When a mission ends before its last step: the team's maps have the quality that `mission.until` asks for.

Each vehicle judges its own map every `JUDGE_LEGS` legs, or every `CLOSE_LEGS` near its horizon and after a judgement
that found the quality. New soundings can lower an estimated quality again. So a map has the quality once `IN_A_ROW`
judgements in a row have found it. While it has, every packet of the vehicle announces it (`Plan.quality_reached`), also
after its end. The vehicle makes its next leg the last one when every team mate has announced the same, or has been
silent for `planner.plan_expiry_s`. A lost packet only delays the end, and no packet can end a vehicle whose own map
lacks the quality.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.map.quality import UNKNOWN, Quality, QualityJudge
from auv_lse_planner.methods.horizon import Horizon
from auv_lse_planner.methods.stages import is_staged

#: Legs between two judgements of the map, usually and close to the end, and judgements in a row that must find it
#: (docs/evidence/gp.md).
JUDGE_LEGS, CLOSE_LEGS, IN_A_ROW = 5, 2, 2


class Until:
    """One vehicle's part in the agreement to end.

    Attributes:
        quality: Of the map judged last.
        met: Number of the last judgements in a row that found the quality asked for.
        horizon: The step at which the vehicle plans to have it.
    """

    def __init__(self, settings: PlannerSettings, area: OperatingArea, mates: Sequence[int]) -> None:
        """Starts without a judgement.

        Args:
            mates: Numbers of the team mates.
        """
        self.asked = settings.mission.until
        self.quality = UNKNOWN
        self.met = 0
        self.horizon = Horizon(settings, area, self.asked.found if plans_to_horizon(settings) else None)
        self._judge = QualityJudge(settings.gp, settings.level_set, area) if self.asked.is_asked else None
        self._heard: dict[int, tuple[float, bool]] = {}
        self._mates = tuple(mates)
        self._began_s: float | None = None
        self._judged_at = 0

    @property
    def reached(self) -> bool:
        """Whether the map has the quality asked for."""
        return self.met >= IN_A_ROW

    def hear(self, now_s: float, mate: int, reached: bool) -> None:
        """Takes what a mate's packet announced, received at `now_s` (s)."""
        self._heard[mate] = now_s, reached

    def agreed(self, now_s: float, silence_s: float) -> bool:
        """Whether the vehicle may end: its map has the quality, and so has each mate heard within `silence_s` (s)."""
        if self._began_s is None:
            self._began_s = now_s
        began = self._began_s, False
        heard = [self._heard.get(mate, began) for mate in self._mates]
        return self.reached and all(reached or now_s - heard_s > silence_s for heard_s, reached in heard)

    def judge(self, decided: int, whole: Callable[[], Posterior]) -> bool:
        """Judges the whole map, if that is due after `decided` decisions; returns whether it was judged.

        A map that cannot be factorized is judged later.
        """
        if self._judge is None or decided - self._judged_at < self._interval(decided):
            return False
        try:
            posterior = whole()
        except IllConditionedError:
            return False
        if not len(posterior):
            return False
        self.quality = self._judge.judge(posterior)
        self.met = self.met + 1 if self.quality.meets(self.asked) else 0
        self._judged_at = decided
        if not self.met:
            self.horizon.judged(decided, self.quality.found_share)
        return True

    def _interval(self, decided: int) -> int:
        """Legs from the last judgement to the next one."""
        return CLOSE_LEGS if self.met or self.horizon.is_near(decided) else JUDGE_LEGS

    def snapshot(self) -> dict[str, Any]:
        """The state, for a journal; what mates announced is in the plans that it holds."""
        q = self.quality
        return {
            "met": self.met,
            "began_s": self._began_s,
            "horizon": self.horizon.end,
            "judged_at": self._judged_at,
            "quality": [q.found_share, q.undiscovered_m, q.deviation_m],
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        found_share, undiscovered_m, deviation_m = values["quality"]
        self.quality = Quality(found_share=found_share, undiscovered_m=undiscovered_m, deviation_m=deviation_m)
        self.met, self._began_s = values["met"], values["began_s"]
        self.horizon.end, self._judged_at = values["horizon"], values["judged_at"]


def plans_to_horizon(settings: PlannerSettings) -> bool:
    """Whether a mission is planned for a share found (`methods/horizon.py`).

    Only a team's tours are, if they are optimized again and not in stages. A single vehicle gains nothing by it
    (docs/evidence/gp.md).
    """
    planner, mission = settings.planner.complete(), settings.mission
    is_tour = mission.until.found is not None and planner.family_name == "tour" and bool(planner.tour_interval)
    return is_tour and mission.vehicles > 1 and not is_staged(mission)
