"""The end of a mission by the quality of its maps."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_planner.vehicle.until import IN_A_ROW, Until

GOOD = Quality(found_share=0.85, undiscovered_m=220.0, deviation_m=5.5)


def until(reached: bool = True, **asked: float) -> Until:
    """One of three vehicles. It begins at 0 s; `planner.plan_expiry_s` is 600 s."""
    settings = PlannerSettings.from_parameters(
        {"mission": {"vehicles": 3, "until": asked or {"undiscovered_m": 250.0}}}, "test", 1
    )
    made = Until(settings, OperatingArea(settings.area), [2, 3])
    made.begin_decision(0.0, 0)
    made.met = IN_A_ROW if reached else 0
    return made


def judged(own: Until, now_s: float, is_current: bool = True, **changed: float) -> None:
    """A judgement at `now_s` (s) of a map of that revision."""
    quality = dataclasses.replace(GOOD, stamp_s=now_s, revision=int(now_s), **changed)
    assert own.judged(now_s, quality, 10, is_current)


def test_a_vehicle_ends_once_every_mate_has_announced_the_quality() -> None:
    own = until()
    assert not own.agreed(0.0)
    own.hear(10.0, 2, True)
    assert not own.agreed(11.0)
    own.hear(12.0, 3, False)
    assert not own.agreed(13.0)
    own.hear(400.0, 3, True)
    assert own.agreed(401.0)


def test_no_packet_ends_a_vehicle_whose_own_map_lacks_the_quality() -> None:
    own = until(reached=False)
    own.hear(1.0, 2, True)
    own.hear(1.0, 3, True)
    assert not own.agreed(2.0)
    assert not own.agreed(10_000.0)
    judged(own, 10_001.0, undiscovered_m=300.0)
    assert not own.ends


def test_a_silent_mate_is_not_waited_for() -> None:
    own = until()
    assert not own.agreed(5.0), "no mate was heard yet"
    own.hear(10.0, 2, True)
    own.hear(100.0, 3, False)
    assert not own.agreed(700.0)
    assert own.agreed(701.0), "silent for longer than the limit"
    alone = until()
    assert not alone.agreed(600.0)
    assert alone.agreed(601.0), "never heard since the first decision"


def test_without_a_request_nothing_counts_and_nothing_ends() -> None:
    settings = PlannerSettings.from_parameters({}, "test", 1)
    own = Until(settings, OperatingArea(settings.area), [])
    own.begin_decision(0.0, 0)
    for now_s in (1.0, 2.0):
        assert not own.judged(now_s, dataclasses.replace(GOOD, stamp_s=now_s), 10, True)
    assert not own.ends
    assert not own.reached


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
    quality = GOOD
    assert until(**asked).asked.is_met(quality) is met
    nothing = dataclasses.replace(quality, deviation_m=float("nan"))
    assert until(deviation_m=100.0).asked.is_met(nothing) is False, "no line found"


def test_the_mission_ends_on_the_second_judgement_in_a_row_that_finds_the_quality() -> None:
    own = until(reached=False)
    own.hear(1.0, 2, True)
    own.hear(1.0, 3, True)
    for now_s, undiscovered_m, ends in ((30.0, 220.0, False), (60.0, 260.0, False), (90.0, 220.0, False),
                                        (120.0, 220.0, True), (150.0, 260.0, False)):  # fmt: skip
        judged(own, now_s, undiscovered_m=undiscovered_m)
        assert own.ends is ends, now_s


def test_the_mission_ends_only_on_a_judgement_of_the_current_map() -> None:
    own = until()
    own.hear(1.0, 2, True)
    own.hear(1.0, 3, True)
    judged(own, 30.0, is_current=False)
    assert own.reached, "it is announced"
    assert not own.ends, "the planner has a newer map"
    judged(own, 60.0)
    assert own.ends
    judged(own, 90.0, is_current=False)
    assert not own.ends


def test_a_judgement_that_is_received_again_counts_once() -> None:
    own = until(reached=False)
    judged(own, 30.0)
    assert not own.judged(31.0, own.quality, 11, True)
    assert own.met == 1


def test_the_state_survives_a_restart() -> None:
    own = until(reached=False)
    for now_s in (30.0, 60.0):
        judged(own, now_s)
    assert own.reached
    again = until(reached=False)
    again.restore(json.loads(json.dumps(own.snapshot())))
    assert again.reached
    assert again.quality == own.quality
    assert not again.judged(61.0, own.quality, 11, True), "the latched message comes again"
    assert not again.agreed(600.0)
    assert again.agreed(601.0), "silent since before the restart"
