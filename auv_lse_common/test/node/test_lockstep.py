import re
from pathlib import Path

from auv_lse_common.node.lockstep import Answer, Answers, Gate, Ready, Ticks, phases_of
from auv_lse_common.topics.table import PHASES, VEHICLE_TOPICS, announces, waits_for


def test_gate_opens_only_when_every_announced_message_has_arrived() -> None:
    gate = Gate(("a", "b"))
    assert gate.ready() is None
    gate.announce(1, "a", 2)
    gate.count("a", 2)
    assert gate.ready() is None, "b has not been announced"
    assert gate.missing() == {"b": "0, then nothing"}
    gate.announce(1, "b", 1)
    assert gate.ready() is None
    assert gate.missing() == {"b": "0 of 1"}
    gate.count("b")
    assert gate.ready() == 1
    gate.handled(1)
    assert gate.ready() is None


def test_early_messages_and_announcements_wait_for_their_tick() -> None:
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


def test_revision_counts_as_all_earlier_messages() -> None:
    gate = Gate(("centers",))
    gate.announce(1, "centers", 5)
    gate.reach("centers", 4)
    assert gate.ready() is None
    gate.reach("centers", 6)
    gate.reach("centers", 2)
    assert gate.ready() == 1


def test_gate_without_inputs_is_always_open() -> None:
    gate = Gate(())
    assert gate.ready() == 1
    gate.handled(1)
    assert gate.ready() == 2


def planner_at_tick_1() -> Ticks:
    ticks = Ticks(("planner",))
    ticks.begin(1, 2.5, {"sounding": 7, "modem/rx": 0, "odometry": 1, "dead_reckoning": 0, "fix": 0})
    ticks.done("modem", 1, (1, 0, 0, 0))
    ticks.done("gp", 1, (4, 1, 0))
    ticks.done("safety", 1, (0,))
    return ticks


def test_phase_begins_when_all_its_inputs_have_arrived() -> None:
    ticks = planner_at_tick_1()
    ticks.arrived("odometry")
    ticks.arrived("team/plans")
    assert ticks.ready() is None, "the map's fourth revision is missing"
    ticks.arrived_up_to("kernel_centers", 4)
    assert ticks.ready() is None, "the vehicle's position on the map is missing"
    ticks.arrived("corrected")
    assert ticks.ready() == Ready(phase="planner", tick=1, now_s=2.5)
    ticks.handled("planner", 1)
    assert ticks.ready() is None
    assert ticks.last("planner") == 1


def test_announcements_may_precede_the_tick() -> None:
    ticks = Ticks(("modem", "modem_sent"))
    ticks.done("planner", 1, (0, 0))
    ticks.done("safety", 1, (0,))
    assert ticks.ready() is None, "the tick has no stamp yet"
    ticks.begin(1, 1.0, {"sounding": 0, "modem/rx": 0, "odometry": 1, "dead_reckoning": 0, "fix": 0})
    assert ticks.ready() == Ready(phase="modem", tick=1, now_s=1.0)
    ticks.handled("modem", 1)
    assert ticks.ready() == Ready(phase="modem_sent", tick=1, now_s=1.0)


def test_phase_without_inputs_waits_for_the_tick() -> None:
    ticks = Ticks(("micromodem",))
    assert ticks.ready() is None
    ticks.begin(1, 1.0, {"sounding": 3, "modem/rx": 0, "odometry": 1, "dead_reckoning": 0, "fix": 0})
    assert ticks.ready() == Ready(phase="micromodem", tick=1, now_s=1.0)


def test_mates_abort_arrives_before_the_safety_phase_of_the_same_tick() -> None:
    ticks = Ticks(("safety",))
    ticks.begin(1, 1.0, {"odometry": 1, "altitude": 1, "mission/command": 0})
    ticks.arrived("odometry")
    ticks.arrived("altitude")
    assert ticks.ready() is None, "modem_node has not said what it has heard"
    ticks.done("modem", 1, (1, 0, 0, 1))
    assert ticks.ready() is None, "the call is on its way"
    ticks.arrived("team/command")
    assert ticks.ready() == Ready(phase="safety", tick=1, now_s=1.0)


def test_time_is_monotonic() -> None:
    ticks = planner_at_tick_1()
    ticks.now_s = 3.0  # a message overtook the announcement of tick 2
    ticks.begin(2, 2.75, {})
    assert ticks.now_s == 3.0


def test_every_input_of_a_phase_is_announced_by_the_simulator_or_by_another_phase() -> None:
    by_simulator = {name for name, topic in VEHICLE_TOPICS.items() if topic.tick_count}
    announced = by_simulator | {topic for phase in PHASES for topic in announces(phase)}
    for phase in PHASES:
        assert set(waits_for(phase)) <= announced, phase


def test_the_order_of_announced_totals_is_that_of_the_message_definition() -> None:
    assert announces("modem") == ("team/plans", "team/samples", "team/navigation", "team/command")
    assert announces("gp") == ("kernel_centers", "corrected", "map/quality")
    assert announces("planner") == ("plan", "waypoint")
    assert announces("vehicle_link") == ("targets", "waypoint")
    assert waits_for("modem_sent") == ("mission/state", "plan")


def test_the_message_has_a_constant_for_every_phase() -> None:
    text = (Path(__file__).parents[3] / "auv_lse_msgs" / "msg" / "LockstepDone.msg").read_text()
    constants = dict(re.findall(r'^string (\w+)="(\w+)"', text, re.MULTILINE))
    assert constants == {name.upper(): name for name in PHASES}


def test_answers_of_one_process_are_combined() -> None:
    safety = Answer(phase="safety", totals=(2,), finished=False)
    planner = Answer(phase="planner", totals=(7, 8), finished=True)
    sent = Answer(phase="modem_sent", totals=(5,), finished=False)
    answers = Answers()
    for phase in ("safety", "planner", "modem_sent"):
        answers.expect(phase)
    assert answers.add(1, safety) is None
    assert answers.add(1, planner) is None
    assert answers.add(2, safety) is None, "a phase may be ahead"
    together = answers.add(1, sent)
    assert together == Answer(phase="safety+planner+modem_sent", totals=(2, 7, 8, 5), finished=True)
    assert [(part.phase, part.totals) for part in phases_of(together)] == [
        ("safety", (2,)),
        ("planner", (7, 8)),
        ("modem_sent", (5,)),
    ]
    assert answers.add(1, planner) == planner, "answered again: told at once"
    lost = Answer(phase="micromodem_lost", totals=(1,), finished=False)
    assert answers.add(2, lost) == lost, "expected by nobody"
    assert answers.add(2, planner) is None
    assert answers.add(2, sent) is not None


def test_answer_of_a_single_phase_is_passed_on_immediately() -> None:
    answers = Answers()
    answers.expect("modem_sent")
    sent = Answer(phase="modem_sent", totals=(0,), finished=False)
    assert answers.add(1, sent) == sent
    assert list(phases_of(Answer(phase="gp", totals=(), finished=False))) == [
        Answer(phase="gp", totals=(), finished=False)
    ], "the greeting at tick 0 counts nothing"
