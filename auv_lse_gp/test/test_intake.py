"""The order in which the map takes what has come in, and what its diagnostics say."""

from __future__ import annotations

import json

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.health import Health, Level, Recent
from auv_lse_gp.health import map_health, map_totals
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthMap


def intake() -> MapIntake:
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 300.0, 0.0, 300.0, 300.0, 0.0, 300.0)))
    return MapIntake(DepthMap(GpConfig(), LevelSet(), area))


def test_own_soundings_come_first_then_samples_by_stamp_and_source() -> None:
    own = intake()
    own.add_samples(2.0, 3, [[250.0, 0.0, 15.0]])
    own.add_samples(2.0, 2, [[200.0, 0.0, 14.0]])
    own.add_samples(1.0, 3, [[150.0, 0.0, 13.0]])
    own.add_soundings([(5.0, 100.0, 0.0, 12.0), (4.0, 50.0, 0.0, 11.0)])
    assert own.step(1.0)
    assert np.array_equal(own.map.centers.locations_m[:, 0], [50.0, 100.0, 150.0, 200.0, 250.0])
    assert not own.step(1.0), "each is taken once"
    assert len(own.map.centers) == 5


def test_diagnostics_warn_of_rejected_soundings() -> None:
    own = intake()
    recent = Recent()

    def health(now_s: float) -> Health:
        gated = own.gate.counts
        return map_health(own.map, 0.0015, 0.002, gated, recent.of(now_s, map_totals(own.map, gated)))

    assert health(0.0).text == "ok"
    own.add_soundings([(1.0, 0.0, 0.0, float("nan"))])
    own.step(1.0)
    found = health(1.0)
    assert found.level is Level.WARN
    assert found.text.startswith("1 sounding refused recently, 1 in total: sounding: north_m=0.0")
    assert found.values["update_ms"] == "1.50"
    assert found.values["last_refused"]
    own.add_soundings([(100.0, 0.0, 0.0, 10.0), (101.0, 1.0, 0.0, 30.0)])
    own.step(101.0)
    assert health(200.0).text == "own soundings rejected recently: 1 jump (1 in total)"
    assert health(400.0).text == "ok", "one spike is not told for the whole dive"
    assert health(401.0).values["soundings jump"] == 1


def test_diagnostics_warn_when_own_soundings_stop() -> None:
    own = intake()

    def health(now_s: float) -> Health:
        own.step(now_s)
        return map_health(own.map, 0.0, 0.0, {}, {}, quiet_s=now_s - own.sounded_s)

    assert health(5.0).text == "ok"
    own.add_soundings([(10.0, 0.0, 0.0, 10.0)])
    assert health(10.0).text == "ok"
    own.add_soundings([(60.0, 0.0, 0.0, float("nan"))])
    assert health(70.0).text == "ok"
    found = health(71.0)
    assert (found.level, found.text) == (
        Level.WARN,
        "no own sounding for 61 s: no echo, or a silent sounder?",
    )
    assert health(40.0).text == "ok", "a clock that is set back"
    own.add_soundings([(200.0, 0.0, 0.0, 10.0)])
    assert health(200.0).text == "ok"


def test_queued_inputs_survive_the_journal_exactly() -> None:
    one, other = intake(), intake()
    one.add_soundings([(4.0, 50.1, 0.3, 11.7), (5.0, 100.0, 0.0, 12.0)])
    one.add_samples(2.0, 3, np.array([[250.0, 0.1, 15.0]]))
    one.add_fix(Fix(stamp_s=1.0, north_m=2.0, east_m=3.0, raw_north_m=2.5, raw_east_m=3.5, std_m=1.5))
    other.put_back(json.loads(json.dumps(one.waiting())))
    assert other.waiting() == one.waiting()
    assert one.step(6.0)
    assert other.step(6.0)
    assert np.array_equal(one.map.centers.locations_m, other.map.centers.locations_m)
