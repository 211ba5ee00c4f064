"""Topics outside of the stack: those that the mission file names, up to a size."""

from __future__ import annotations

from auv_lse_record.extra_topics import ExtraTopics


def test_a_camera_is_recorded_only_if_it_is_named() -> None:
    none = ExtraTopics((), 100.0)
    assert none.wants("/rosout"), "ROS's logs"
    assert not none.wants("/camera/image_raw")
    some = ExtraTopics(("/camera/*/info", "/imu"), 100.0)
    assert some.wants("/imu")
    assert some.wants("/camera/front/info")
    assert not some.wants("/camera/front/image_raw")
    assert not some.wants("/imu/raw")
    assert not ExtraTopics(("*",), 100.0).concerns("/rosout"), "it has no limit"


def test_the_limit_ends_them_and_names_the_largest() -> None:
    topics = ExtraTopics(("/*",), 1.0)
    assert topics.take("/imu", 300_000)
    assert topics.take("/camera", 700_000), "just as much as allowed"
    assert not topics.problem
    assert not topics.take("/imu", 1)
    assert not topics.take("/imu", 1)
    assert "record.topics_mb = 1 MB, most of it /camera" in topics.problem
    assert ExtraTopics(("/*",), 0.0).take("/camera", 10**12), "no limit"
