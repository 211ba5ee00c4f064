"""The end of a mission by the quality of its maps."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.map.quality import Quality
from auv_lse_planner.vehicle.until import CLOSE_LEGS, IN_A_ROW, JUDGE_LEGS, Until

SILENCE_S = 600.0


def until(reached: bool = True, **asked: float) -> Until:
    settings = PlannerSettings.from_parameters(
        {"mission": {"vehicles": 3, "until": asked or {"undiscovered_m": 100.0}}}, "test", 1
    )
    made = Until(settings, OperatingArea(settings.area), [2, 3])
    made.met = IN_A_ROW if reached else 0
    return made


def test_a_vehicle_ends_once_every_mate_has_announced_the_quality() -> None:
    own = until()
    assert not own.agreed(0.0, SILENCE_S)
    own.hear(10.0, 2, True)
    assert not own.agreed(11.0, SILENCE_S)
    own.hear(12.0, 3, False)
    assert not own.agreed(13.0, SILENCE_S)
    own.hear(400.0, 3, True)
    assert own.agreed(401.0, SILENCE_S)


def test_no_packet_ends_a_vehicle_whose_own_map_lacks_the_quality() -> None:
    own = until(reached=False)
    own.hear(1.0, 2, True)
    own.hear(1.0, 3, True)
    assert not own.agreed(2.0, SILENCE_S)
    assert not own.agreed(10_000.0, SILENCE_S)


def test_a_silent_mate_is_not_waited_for() -> None:
    own = until()
    assert not own.agreed(5.0, SILENCE_S), "no mate was heard yet"
    own.hear(10.0, 2, True)
    own.hear(100.0, 3, False)
    assert not own.agreed(700.0, SILENCE_S)
    assert own.agreed(701.0, SILENCE_S), "silent for longer than the limit"
    alone = until()
    assert not alone.agreed(50.0, SILENCE_S)
    assert not alone.agreed(650.0, SILENCE_S)
    assert alone.agreed(651.0, SILENCE_S), "never heard since the first decision"


def test_without_a_request_nothing_is_judged_and_nothing_ends() -> None:
    settings = PlannerSettings.from_parameters({}, "test", 1)
    own = Until(settings, OperatingArea(settings.area), [])
    posterior = Posterior(settings.gp)
    posterior.extend(Centers(np.array([[10.0, 10.0]]), np.array([9.0]), np.array([0.2])))
    assert not own.judge(JUDGE_LEGS, lambda: posterior)
    assert not own.agreed(100.0, SILENCE_S)


@pytest.mark.parametrize(
    ("asked", "met"),
    [
        ({"found": 0.8}, True),
        ({"found": 0.9}, False),
        ({"undiscovered_m": 250.0}, True),
        ({"undiscovered_m": 200.0}, False),
        ({"deviation_m": 6.0}, True),
        ({"deviation_m": 5.0}, False),
        ({"found": 0.8, "undiscovered_m": 250.0, "deviation_m": 5.0}, False),
    ],
)
def test_everything_that_is_asked_for_must_be_met(asked: dict[str, Any], met: bool) -> None:
    quality = Quality(found_share=0.85, undiscovered_m=220.0, deviation_m=5.5)
    assert quality.meets(until(**asked).asked) is met
    nothing = dataclasses.replace(quality, deviation_m=float("nan"))
    assert nothing.meets(until(deviation_m=100.0).asked) is False, "no line found"


def refused() -> Posterior:
    raise IllConditionedError("two centers at one location")


def test_a_map_is_judged_every_few_legs_and_the_state_survives_a_restart() -> None:
    own = until(reached=False, undiscovered_m=1e5)
    posterior = Posterior(PlannerSettings.from_parameters({}, "test", 1).gp)
    assert not own.judge(JUDGE_LEGS, lambda: posterior), "no sounding"
    posterior.extend(Centers(np.array([[10.0, 10.0]]), np.array([9.0]), np.array([0.2])))
    assert not own.judge(JUDGE_LEGS, refused), "centers that cannot be factorized"
    assert not own.judge(JUDGE_LEGS - 1, lambda: posterior), "not due"
    assert own.judge(JUDGE_LEGS + 1, lambda: posterior)
    assert not own.reached, "found once only"
    assert not own.judge(JUDGE_LEGS + CLOSE_LEGS, lambda: posterior), "not due"
    assert own.judge(JUDGE_LEGS + CLOSE_LEGS + 1, lambda: posterior)
    assert own.reached
    assert 100.0 < own.quality.undiscovered_m < 1e5
    assert not own.agreed(7.0, SILENCE_S)
    again = until(reached=False, undiscovered_m=1e5)
    again.restore(json.loads(json.dumps(own.snapshot())))
    assert again.reached
    assert again.quality.undiscovered_m == own.quality.undiscovered_m
    assert not again.agreed(606.0, SILENCE_S)
    assert again.agreed(608.0, SILENCE_S), "silent since before the restart"


def test_a_quality_that_is_lost_again_is_no_longer_announced() -> None:
    own = until(reached=False, undiscovered_m=1e5)
    posterior = Posterior(PlannerSettings.from_parameters({}, "test", 1).gp)
    posterior.extend(Centers(np.array([[10.0, 10.0]]), np.array([9.0]), np.array([0.2])))
    for step in (5, 10):
        own.judge(step, lambda: posterior)
    assert own.reached
    own.asked = dataclasses.replace(own.asked, undiscovered_m=0.1)  # no map has that
    own.judge(15, lambda: posterior)
    assert not own.reached
    own.asked = dataclasses.replace(own.asked, undiscovered_m=1e5)
    own.judge(20, lambda: posterior)
    assert not own.reached, "the count begins anew"
