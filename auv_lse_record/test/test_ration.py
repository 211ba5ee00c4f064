"""The recorder's ration: bytes of maps are bounded by time, whatever their size, and what is recorded fits together."""

from __future__ import annotations

from collections import defaultdict

import pytest

from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.topics.table import VEHICLE_TOPICS, find_topic
from auv_lse_record.message_types import stamp_of
from auv_lse_record.ration import Ration

RATE = RecordConfig().map_bytes_per_s


def message(stamp_s: float, size: int) -> bytes:
    """A serialized message of `size` bytes."""
    whole = int(stamp_s)
    stamp = whole.to_bytes(4, "little", signed=True) + round((stamp_s - whole) * 1e9).to_bytes(4, "little")
    return (b"\0\1\0\0" + stamp).ljust(size, b"\0")


def recorded(ration: Ration, mission_s: int, cells: int, rest: bool = True) -> dict[str, list[bytes]]:
    """What is recorded of a mission with centers every second, a map every 30 s, and a path every leg."""
    found: dict[str, list[bytes]] = defaultdict(list)

    def publish(name: str, stamp_s: float, size: int) -> None:
        topic = f"/auv2/{name}"
        for kept, data in ration.take(topic, find_topic(topic), message(stamp_s, size)):
            found[kept].append(data)

    for now_s in range(1, mission_s + 1):
        publish("kernel_centers", now_s, 40 * min(now_s // 4, 3000) + 100)
        if now_s % 30 == 0:
            publish("field", now_s, 16 * cells + 100)
            publish("risk_map", now_s, cells + 100)
            for _ in range(3):
                publish("isobath", now_s, 20 * cells // 16)
        if now_s % 16 == 0:
            publish("path", now_s, 72 * (mission_s - now_s) // 16 + 100)
    for kept, data in ration.rest() if rest else ():
        found[kept].append(data)
    return found


@pytest.mark.parametrize(("cells", "mission_s"), [(16_800, 18_850), (160_000, 18_850), (4_000_000, 2_000)])
def test_bytes_of_maps_and_paths_are_bounded_by_time(cells: int, mission_s: int) -> None:
    found = recorded(Ration(RATE), mission_s, cells)
    size = {topic: sum(map(len, each)) for topic, each in found.items()}
    assert size.pop("/auv2/path") <= 0.035 * RATE * mission_s + 300_000
    assert len(found["/auv2/kernel_centers"]) == len(found["/auv2/field"]) == len(found["/auv2/risk_map"])
    largest = 16 * cells + 120_000 + cells + 3 * 20 * cells // 16
    assert sum(size.values()) <= RATE * mission_s + 3 * largest, "and the first, the last, and one more"


def test_a_short_missions_maps_are_all_recorded() -> None:
    found = recorded(Ration(RATE), 1600, 16_800)
    assert [stamp_of(data) for data in found["/auv2/field"]] == [30.0 * (i + 1) for i in range(53)]
    assert len(found["/auv2/path"]) == 100


def test_each_map_has_its_centers_and_its_isobath() -> None:
    found = recorded(Ration(RATE), 5000, 160_000)
    fields = [stamp_of(data) for data in found["/auv2/field"]]
    assert fields[0] == 30.0
    assert fields[-1] == 4980.0, "the last one is recorded at the end"
    for name, each in (("kernel_centers", 1), ("risk_map", 1), ("isobath", 3)):
        assert [stamp_of(data) for data in found[f"/auv2/{name}"]] == [s for s in fields for _ in range(each)]


def test_centers_that_arrive_before_or_after_their_map_are_recorded() -> None:
    """The recorder's subscriptions are in no order; a map that has not changed keeps its older centers."""
    ration, centers, fields = Ration(RATE), find_topic("/auv1/kernel_centers"), find_topic("/auv1/field")

    def take(name: str, stamp_s: float) -> list[tuple[str, float]]:
        found = {"kernel_centers": centers, "field": fields}[name]
        return [
            (t, stamp_of(data)) for t, data in ration.take(f"/auv1/{name}", found, message(stamp_s, int(RATE) // 2))
        ]

    assert take("kernel_centers", 1.0) == []
    assert take("field", 3.5) == [("/auv1/field", 3.5), ("/auv1/kernel_centers", 1.0)]
    assert take("kernel_centers", 3.5) == [("/auv1/kernel_centers", 3.5)]
    assert take("kernel_centers", 4.5) == []
    assert take("kernel_centers", 5.5) == []
    assert take("field", 5.0) == [("/auv1/field", 5.0), ("/auv1/kernel_centers", 4.5)]
    assert take("field", 5.5) == []
    assert [stamp_of(data) for _, data in ration.rest()] == [5.5, 5.5], "the last map, with its centers"
    assert take("field", 1.0)[0] == ("/auv1/field", 1.0), "a second mission in one recording"


def test_a_map_that_arrives_before_older_centers_is_recorded_with_them() -> None:
    """Topics are in no order: with the map of 3 s, the centers of 2 s belong to it and may come after it."""
    ration, rows = Ration(RATE), {n: find_topic(f"/auv1/{n}") for n in ("kernel_centers", "field")}

    def take(name: str, stamp_s: float, size: int = 100) -> list[tuple[str, float]]:
        kept = ration.take(f"/auv1/{name}", rows[name], message(stamp_s, size))
        return [(topic.removeprefix("/auv1/"), stamp_of(data)) for topic, data in kept]

    take("kernel_centers", 1.0)
    assert take("field", 3.0, int(9 * RATE)) == [("field", 3.0), ("kernel_centers", 1.0)]
    assert take("kernel_centers", 2.0) == [("kernel_centers", 2.0)]
    assert take("kernel_centers", 1.5) == [], "older than what is recorded"
    assert take("field", 7.0) == [], "the next map is not due"
    assert take("kernel_centers", 6.0) == []
    assert take("kernel_centers", 8.0) == []
    rest = [(topic.removeprefix("/auv1/"), stamp_of(data)) for topic, data in ration.rest()]
    assert rest[0] == ("field", 7.0)
    assert rest[-1] == ("kernel_centers", 6.0)


def test_a_map_before_any_centers_is_recorded_with_those_that_come_later() -> None:
    ration, rows = Ration(RATE), {n: find_topic(f"/auv1/{n}") for n in ("kernel_centers", "field")}
    for stamp_s in (3.0, 1.0):  # the second one begins another mission in the same recording
        assert len(ration.take("/auv1/field", rows["field"], message(stamp_s, 100))) == 1
        assert len(ration.take("/auv1/kernel_centers", rows["kernel_centers"], message(stamp_s - 0.5, 100))) == 1


def test_without_a_rate_everything_is_recorded() -> None:
    assert not any(Ration(0.0).concerns(find_topic(f"/auv1/{name}")) for name in VEHICLE_TOPICS)
    concerned = {name for name in VEHICLE_TOPICS if Ration(1.0).concerns(find_topic(f"/auv1/{name}"))}
    assert concerned == {"field", "kernel_centers", "risk_map", "isobath", "path"}
    assert not Ration(1.0).concerns(None)
    for name in concerned:
        leader = VEHICLE_TOPICS[name].recorded_with
        assert not leader or VEHICLE_TOPICS[leader].ration > 0.0
