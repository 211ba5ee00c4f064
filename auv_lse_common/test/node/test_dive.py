"""The id of a dive: made once, carried in messages, compared."""

from types import SimpleNamespace

import pytest

from auv_lse_common.node.dive import (
    DIVE_VARIABLE,
    ForeignMessages,
    dive_of,
    is_foreign,
    is_simulation,
    new_dive,
    own_dive,
    tagged,
    vehicle_of,
)
from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS

DIVE, OTHER, SIM, SIM_2 = (f"{kind}-1123-184534-{k}f2a" for k, kind in enumerate(("auv1", "auv1", "sim", "sim")))


@pytest.mark.parametrize("kind", ["sim", "auv2", "auv255"])
def test_an_id_names_its_kind(kind):
    dive = new_dive(kind)
    assert dive.startswith(f"{kind}-")
    assert is_simulation(dive) == (kind == "sim")
    assert vehicle_of(dive) == ("" if kind == "sim" else kind)
    assert dive_of(f"{dive}/auv2/dvl") == dive, "as version 0.2 wrote frames"


def test_ids_of_one_second_differ():
    assert len({new_dive("sim") for _ in range(20)}) > 1


@pytest.mark.parametrize("frame", ["", "map", "auv1/dvl", "sim/map", "sim-1/map", "robot-1123-184534-3f2a/map"])
def test_other_frames_have_no_id(frame):
    assert dive_of(frame) == ""


def test_the_environment_names_the_dive(monkeypatch):
    monkeypatch.setenv(DIVE_VARIABLE, "auv1-1123-184534-3f2a")
    assert own_dive() == "auv1-1123-184534-3f2a"
    monkeypatch.delenv(DIVE_VARIABLE)
    assert own_dive() == ""


@pytest.mark.parametrize("name", [row.name for row in VEHICLE_TOPICS.values()])
def test_no_topic_takes_a_message_of_another_dive(name):
    topic = VEHICLE_TOPICS[name]
    for own in ("", DIVE, SIM):
        for sender in {DIVE, OTHER, SIM, SIM_2} - {own}:
            assert is_foreign(topic, sender, own)
        assert not is_foreign(topic, own, own)
    assert not is_foreign(topic, "", "")


def test_messages_without_an_id_come_from_operators_and_own_drivers():
    def taken(own):
        return {row.name for row in VEHICLE_TOPICS.values() if not is_foreign(row, "", own)}

    measured = {"sounding", "odometry", "dead_reckoning", "fix", "navsat", "altitude", "pressure", "autopilot"}
    anybody = {"mission/command", "dive", "diagnostics"}
    assert taken(DIVE) == {"modem/rx", "modem/sent", "modem/failed"} | measured | anybody
    assert taken(SIM) == anybody
    assert not is_foreign(MISSION_TOPICS["/mission/command"], "", SIM)


def test_the_projects_messages_carry_the_id():
    own, clock = SimpleNamespace(dive=""), object()
    assert tagged(own, SIM).dive == SIM
    assert tagged(clock, SIM) is clock


def test_a_topic_on_which_the_own_dive_publishes_takes_no_message_without_an_id():
    """A recording that is played in a vehicle's domain looks like a user's driver."""
    foreign, odometry, command = ForeignMessages(DIVE), VEHICLE_TOPICS["odometry"], VEHICLE_TOPICS["mission/command"]
    assert not foreign.ignores(odometry, "", 0.0), "a user's driver"
    for topic in (odometry, command):
        assert not foreign.ignores(topic, DIVE, 1.0)
    assert foreign.ignores(odometry, "", 2.0)
    assert not foreign.ignores(command, "", 2.0), "operators"
    assert not ForeignMessages("").ignores(odometry, "", 2.0)


def test_foreign_messages_are_counted_and_forgotten_after_a_minute():
    foreign = ForeignMessages(DIVE)
    odometry, waypoint = VEHICLE_TOPICS["odometry"], VEHICLE_TOPICS["waypoint"]
    assert not foreign.ignores(odometry, DIVE, 0.0)
    assert foreign.problems(0.0) == {}
    for t in range(3):
        assert foreign.ignores(odometry, OTHER, float(t))
    assert foreign.ignores(waypoint, "", 2.0)
    assert foreign.ignores(MISSION_TOPICS["/lockstep/tick"], SIM, 2.0)
    found = foreign.problems(3.0)
    assert set(found) == {OTHER, "", SIM}
    assert found[OTHER].startswith(f"{OTHER} publishes in this ROS domain, too: 3 messages ignored (odometry).")
    assert foreign.problems(70.0) == {}
    assert foreign.ignores(odometry, OTHER, 100.0)
    assert ": 1 message ignored" in foreign.problems(100.0)[OTHER]


def test_a_flood_of_ids_is_counted_together():
    foreign, odometry = ForeignMessages(DIVE), VEHICLE_TOPICS["odometry"]
    for number in range(1000):
        assert foreign.ignores(odometry, f"auv2-1123-184534-{number:04x}", 1.0)
    assert foreign.ignores(odometry, "x" * 1000, 1.0)
    found = foreign.problems(1.0)
    assert len(found) == 9
    assert found["one of several further dives"].startswith(
        "one of several further dives publishes in this ROS domain, too: 993 "
    )
    assert foreign.ignores(odometry, "x" * 1000, 100.0)
    assert list(foreign.problems(100.0)) == ["x" * 40], "the others are gone"
