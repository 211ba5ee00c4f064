"""Judges the map of one vehicle again and again during a mission that `mission.until` may end early.

A judgement takes seconds of processor time. So it is done in *slices* between the node's other work. It concerns the
map as it was at its beginning. If the last judgement found the quality, the mission may end on the next one. The map
then stands still (`holds`) until that is done: new soundings wait.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_common.vocabulary.map_quality import UNKNOWN, Quality
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.work import Job
from auv_lse_gp.map.online import OnlineGp
from auv_lse_gp.map.quality import QualityJudge

#: Time (s) from one judgement to the next, and close to the quality asked for: five and two usual legs.
PERIOD_S, CLOSE_PERIOD_S = 75.0, 30.0
#: A map that has this share of the quality is close to it.
CLOSE_SHARE = 0.8
#: Operations of a slice, 30 to 60 ms on a core of 2024: the longest takes 57 ms at 12,000 centers (`auv_lse bench gp`).
#: And the time (s) that one takes of a tick in lockstep; a vehicle does one in each step of `gp_node`.
SLICE, SLICE_S = 6e8, 0.05


class QualityWatch:
    """Judges a map again and again.

    Attributes:
        quality: Quality of the map at the last judgement.
    """

    def __init__(self, gp: GpConfig, level_set: LevelSetConfig, area: OperatingArea, asked: UntilConfig) -> None:
        self.quality = UNKNOWN
        self._asked = asked
        self._judge = QualityJudge(gp, level_set, area)
        self._job: Job[Quality] | None = None
        self._last_s = math.nan  # beginning of the last judgement; before the first, when the mission began

    @classmethod
    def of(
        cls, gp: GpConfig, level_set: LevelSetConfig, area: OperatingArea, asked: UntilConfig
    ) -> QualityWatch | None:
        """The watch of a mission; None if it ends with its last step only."""
        return cls(gp, level_set, area, asked) if asked.is_asked else None

    @property
    def is_judging(self) -> bool:
        """Whether a judgement is not done yet."""
        return self._job is not None

    @property
    def holds(self) -> bool:
        """Whether the map must not change, because the mission may end on the judgement that is not done yet."""
        return self.is_judging and self._asked.is_met(self.quality)

    def begin_if_due(self, now_s: float, gp: OnlineGp) -> bool:
        """Begins a judgement of the map if one is due; call it only while the mission runs.

        Returns:
            Whether the state has changed.
        """
        if self.is_judging or not len(gp):
            return False
        if math.isnan(self._last_s) or now_s < self._last_s:  # the clock may have been set back
            self._last_s = now_s
            return True
        if now_s - self._last_s < self._period_s or gp.revision == self.quality.revision:
            return False
        self._last_s = now_s
        self._job = Job(self._judge.judge_in_parts(gp.centers, gp.revision))
        return True

    @property
    def _period_s(self) -> float:
        return CLOSE_PERIOD_S if self._asked.is_met(self.quality, CLOSE_SHARE) else PERIOD_S

    def advance(self, now_s: float) -> Quality | None:
        """Does one slice of the judgement; returns the quality once it is done.

        A map that cannot be factorized is judged later.
        """
        if self._job is None:
            return None
        try:
            if not self._job.advance(SLICE):
                return None
        except IllConditionedError:
            self._job = None
            return None
        assert self._job.result is not None
        self.quality, self._job = dataclasses.replace(self._job.result, stamp_s=now_s), None
        return self.quality

    def stop(self) -> None:
        """Abandons the judgement."""
        self._job = None

    def snapshot(self) -> dict[str, Any]:
        """The state as JSON values, for a journal, without the judgement that is not done yet."""
        return {"last_s": self._last_s, "quality": dataclasses.asdict(self.quality), "judging": self.is_judging}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`; a judgement that was not done is due again."""
        self.quality = Quality(**values["quality"])
        self._last_s = -math.inf if values["judging"] else values["last_s"]


def slices(tick_s: float) -> int:
    """Number of slices in a tick of a simulated mission."""
    return max(1, round(tick_s / SLICE_S))
