"""The expected size of a recording, before the mission."""

from __future__ import annotations

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.size_estimate import lack_of_space, size_of

DAY = {
    "mission.steps": 1200, "mission.vehicles": 3,
    "area.polygon_m": [0.0, 0.0, 2000.0, 0.0, 2000.0, 2000.0, 0.0, 2000.0],
}  # fmt: skip


def test_a_default_mission_takes_the_size_that_was_measured() -> None:
    """Seed 1, 100 legs: 8 MB."""
    size = size_of(Settings.load(None, {}))
    assert 8.0 / 1.2 < size.mission_mb < 8.0 * 1.2
    assert size.mission_mb / 3.0 < size.vehicle_mb < size.mission_mb / 2.5


def test_a_working_day_stays_within_its_aim_whatever_the_area() -> None:
    assert size_of(Settings.load(None, DAY)).mission_mb < 400.0
    wide = {**DAY, "area.polygon_m": [2.0 * x for x in DAY["area.polygon_m"]]}
    assert size_of(Settings.load(None, wide)).mission_mb < 400.0


def test_without_a_limit_maps_grow_with_the_area_and_the_mission() -> None:
    whole = size_of(Settings.load(None, {**DAY, "record.map_bytes_per_s": 0.0})).mission_mb
    assert whole > 2000.0


def test_the_lack_of_space_is_named_with_its_remedy() -> None:
    assert lack_of_space(100.0, 300.0, 200.0) == ""
    text = lack_of_space(101.0, 300.0, 200.0)
    assert text.startswith("record.folder has 100 MB of free space beyond record.least_free_mb (200 MB), but")
    assert "about 101 MB" in text
    assert "record.map_bytes_per_s" in text
