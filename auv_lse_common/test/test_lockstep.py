from auv_lse_common.lockstep import Gate


def test_gate_opens_only_when_every_announced_message_has_arrived() -> None:
    gate = Gate(("a", "b"))
    assert gate.ready() is None
    gate.announce(1, "a", 2)
    gate.count("a", 2)
    assert gate.ready() is None, "b has not been announced"
    gate.announce(1, "b", 1)
    assert gate.ready() is None
    assert gate.missing() == {"b": "0 of 1"}
    gate.count("b")
    assert gate.ready() == 1
    gate.handled(1)
    assert gate.ready() is None


def test_early_messages_and_announcements_of_later_ticks_wait_their_turn() -> None:
    gate = Gate(("a",))
    gate.announce(2, "a", 3)
    gate.count("a", 3)
    assert gate.ready() is None, "tick 1 comes first"
    gate.announce(1, "a", 1)
    assert gate.ready() == 1
    gate.handled(1)
    assert gate.ready() == 2
    gate.handled(2)
    gate.announce(1, "a", 9)
    assert gate.ready() is None
    assert gate.tick == 2


def test_a_revision_counts_as_all_before_it() -> None:
    gate = Gate(("centers",))
    gate.announce(1, "centers", 5)
    gate.reach("centers", 4)
    assert gate.ready() is None
    gate.reach("centers", 6)
    gate.reach("centers", 2)
    assert gate.ready() == 1
