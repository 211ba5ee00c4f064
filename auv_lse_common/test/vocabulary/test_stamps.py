from auv_lse_common.vocabulary.stamps import stamped


def test_times_are_rounded_as_ros_stamps() -> None:
    assert stamped(1.0) == 1.0
    assert stamped(12.1234567894) == 12.123456789
    assert stamped(0.1 + 0.2) == stamped(0.3)
