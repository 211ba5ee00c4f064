"""The states of a mission: every command in every state, limits, and an autopilot that is not ready."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

from auv_lse_common.vocabulary.mission_run import Action, Command, Given, MissionRun, RunState, Stop

HOLD, SURFACE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)
MESSAGES = Path(__file__).parents[3] / "auv_lse_msgs" / "msg"


def constants(message: str) -> dict[str, int]:
    """The numbers that a message names."""
    text = (MESSAGES / f"{message}.msg").read_text()
    return {name: int(value) for name, value in re.findall(r"^uint8 ([A-Z_]+)=(\d+)", text, re.MULTILINE)}


def in_state(state: RunState) -> MissionRun:
    """A mission in a state."""
    run = MissionRun(at_once=False, on_abort=SURFACE)
    path = {
        RunState.WAITING: (),
        RunState.RUNNING: (Command.GO,),
        RunState.HOLDING: (Command.GO, Command.HOLD),
        RunState.ABORTED: (Command.GO, Command.ABORT),
        RunState.ENDED: (Command.GO, Command.END),
    }[state]
    run.set_ready("")
    for command in path:
        assert run.command(command, "test") == ""
        run.set_ready("")
    assert run.status.state is state
    return run


W, R, H, A, E = RunState


@pytest.mark.parametrize(
    ("state", "after"),
    [  # GO, HOLD, SURFACE, ABORT, RESET, END; None: refused
        (W, (R, H, H, A, W, E)),
        (R, (R, H, H, A, R, E)),
        (H, (R, H, H, A, H, H)),
        (A, (None, A, A, A, H, A)),
        (E, (None, E, E, A, E, E)),
    ],
)
def test_every_command_in_every_state(state: RunState, after: tuple[RunState | None, ...]) -> None:
    for command, expected in zip(Command, after, strict=True):
        run = in_state(state)
        refused = run.command(command, "test")
        assert bool(refused) is (expected is None), (state, command, refused)
        assert run.status.state is (state if expected is None else expected), (state, command)


def test_numbers_agree_with_the_message_definitions() -> None:
    state = constants("MissionState")
    assert {m.name: m.value for m in RunState} | {m.name: m.value for m in Action} == state
    assert {m.name: m.value for m in Command} == constants("MissionCommand")


def test_action_follows_from_the_state() -> None:
    assert in_state(W).status.stop == HOLD
    assert in_state(R).status.stop is None
    assert in_state(E).status.stop == HOLD, "vehicle.at_end"
    run = in_state(R)
    run.command(Command.SURFACE, "test")
    assert (run.status.state, run.status.stop) == (H, SURFACE)
    run.command(Command.GO, "test")
    assert run.status.stop is None
    run.command(Command.ABORT, "auv2", team=True)
    assert run.status.stop == SURFACE
    assert run.status.team_abort
    assert "auv2" in run.status.reason


def test_abort_can_lead_to_a_known_position() -> None:
    run = MissionRun(True, Stop(action=Action.GO_TO, position_m=(5.0, -7.0)))
    assert run.status.stop is None
    run.command(Command.ABORT, "test")
    assert run.status.stop == Stop(action=Action.GO_TO, position_m=(5.0, -7.0))
    with pytest.raises(ValueError, match=r"GO_TO needs a finite north and east .*nan"):
        Stop(action=Action.GO_TO)
    with pytest.raises(ValueError, match=r"TRAVEL does not stop a vehicle; use HOLD, SURFACE or GO_TO"):
        Stop(action=Action.TRAVEL)


def test_a_vehicle_on_its_way_after_an_abort_can_be_stopped() -> None:
    """Somebody is in its way, and RESET may be refused because a limit is exceeded."""
    for command, stop in ((Command.HOLD, HOLD), (Command.SURFACE, SURFACE)):
        run = MissionRun(True, Stop(action=Action.GO_TO, position_m=(5.0, -7.0)))
        run.command(Command.ABORT, "al", team=True)
        assert run.command(command, "bo") == ""
        assert (run.status.state, run.status.stop, run.status.team_abort) == (A, stop, True)
        run.command(Command.HOLD, "bo")
        assert run.status.stop == stop, "HOLD does not keep it under water"
        assert run.command(Command.GO, "bo") != ""


def test_a_tripped_limit_is_latched_until_reset() -> None:
    run = in_state(R)
    run.trip("depth", SURFACE, "12.0 m deep")
    assert (run.status.state, run.status.stop, run.status.limits) == (H, SURFACE, ("depth: 12.0 m deep",))
    assert "12.0 m deep" in run.command(Command.GO, "test"), "refused, and says why"
    run.command(Command.HOLD, "test")
    assert run.status.stop == SURFACE, "an operator's hold does not sink it again"
    run.trip("link", HOLD, "no heartbeat")
    assert run.status.stop == SURFACE, "the milder limit does not, either"
    run.command(Command.RESET, "test")
    assert (run.status.state, run.status.stop, run.status.limits) == (H, HOLD, ())
    assert run.command(Command.GO, "test") == ""
    run.trip("leak", None, "a leak")
    assert run.status.state is A
    run.trip("depth", HOLD, "12.0 m deep")
    assert run.status.state is A, "nothing milder than an abort undoes it"


def test_a_command_that_sets_a_vehicle_in_motion_is_void_after_a_while() -> None:
    assert in_state(W).command(Command.GO, "test", given=Given(90.0, 100.0)) == ""
    late = in_state(W).command(Command.GO, "test", given=Given(40.0, 100.0))
    assert late == "GO: it may be up to 60 s old, and is void after 10 s. Give it again"
    assert "60 s old" in in_state(A).command(Command.RESET, "test", given=Given(40.0, 100.0))
    assert "has restarted since" in in_state(W).command(Command.GO, "test", given=Given(4000.0, 100.0))
    for command in (Command.HOLD, Command.SURFACE, Command.ABORT):
        assert in_state(R).command(command, "test", given=Given(40.0, 100.0)) == "", "these act however late"


@pytest.mark.parametrize("stop", [Command.HOLD, Command.SURFACE])
def test_go_that_arrives_again_after_the_hold_of_another_operator_is_void(stop: Command) -> None:
    run = in_state(R)
    assert run.command(stop, "bo", given=Given(None, 102.0)) == ""
    again = MissionRun(at_once=False, on_abort=SURFACE)
    again.restore(json.loads(json.dumps(run.snapshot())))  # a restarted node has not forgotten it
    for one in (run, again):
        refusal = one.command(Command.GO, "al", given=Given(101.0, 103.0))
        assert refusal.startswith(f"GO: {stop.name} was given after it (HOLDING: {stop.name} by bo)"), refusal
        assert one.status.state is H
        assert one.command(Command.GO, "al", given=Given(102.5, 103.0)) == "", "given after the hold"
        assert one.command(Command.GO, "al", given=Given(102.5, 104.0)) == "", "the answer was lost"


def test_reset_does_not_undo_an_abort_that_was_given_after_it() -> None:
    run = in_state(A)
    assert run.command(Command.RESET, "al", given=Given(101.0, 101.1)) == ""
    assert run.command(Command.RESET, "al", given=Given(101.0, 102.0)) == "", "the answer was lost"
    assert "RESET was given after it" in run.command(Command.GO, "al", given=Given(100.9, 102.5))
    run.command(Command.ABORT, "bo", given=Given(now_s=103.0))
    assert "ABORT was given after it" in run.command(Command.RESET, "al", given=Given(101.0, 104.0))
    assert run.status.state is A


def test_reset_does_not_undo_a_limit_that_tripped_after_it() -> None:
    run = in_state(H)
    run.trip("leak", SURFACE, "leak: water in the hull")
    run.note_trip(103.0)
    again = MissionRun(at_once=False, on_abort=SURFACE)
    again.restore(json.loads(json.dumps(run.snapshot())))
    for one in (run, again):
        refusal = one.command(Command.RESET, "al", given=Given(101.0, 104.0))
        assert refusal == "RESET: a limit has tripped since it was given (leak: water in the hull). Give it again"
        assert one.limits
        assert one.command(Command.RESET, "al", given=Given(103.5, 104.0)) == "", "given after the trip"
        assert not one.limits


def test_commands_from_before_a_reboot_do_not_count() -> None:
    """The clock of the commands begins anew."""
    run = in_state(R)
    run.command(Command.HOLD, "bo", given=Given(now_s=90000.0))
    assert run.command(Command.GO, "al", given=Given(50.0, 51.0)) == ""


def test_an_order_that_waited_for_the_vehicle_counts_as_long_as_its_operator_wants() -> None:
    late = Given(1000.0, 1300.0, 600.0)
    assert in_state(W).command(Command.GO, "al", given=late) == ""
    refusal = in_state(W).command(Command.GO, "al", given=late._replace(valid_s=200.0))
    assert refusal == "GO: it may be up to 300 s old, and is void after 200 s. Give it again"
    run = in_state(W)
    run.command(Command.HOLD, "bo", given=Given(now_s=1290.0))
    assert "HOLD was given after it" in run.command(Command.GO, "al", given=late)


@pytest.mark.parametrize("given", [Given(math.nan, 100.0), Given(40.0, 100.0, math.nan)])
def test_a_time_that_is_no_number_makes_no_command_count(given: Given) -> None:
    assert "Give it again" in in_state(W).command(Command.GO, "al", given=given)


@pytest.mark.parametrize("command", [Command.GO, Command.RESET])
def test_an_order_from_before_the_vehicle_started_is_void(command: Command) -> None:
    rebooted = in_state(H).command(command, "al", given=Given(-200.0, 100.0, 600.0))
    assert "has restarted since" in rebooted
    run = in_state(H)
    run.note_start(1200.0)
    again = MissionRun(at_once=False, on_abort=SURFACE)
    again.note_start(1250.0)
    again.restore(json.loads(json.dumps(run.snapshot())))  # a restarted node continues the same dive
    for one in (run, again):
        refusal = one.command(command, "al", given=Given(1000.0, 1300.0, 600.0))
        assert "nodes have started since it was given" in refusal
        assert one.command(command, "al", given=Given(1201.0, 1300.0, 600.0)) == ""
    run.note_start(1299.0)
    assert run.command(command, "al", given=Given(1295.0, 1300.0, 600.0)) == "", "meant for what starts"


def test_unready_autopilot_delays_the_mission_and_later_holds_it() -> None:
    run = MissionRun(at_once=True, on_abort=SURFACE)
    run.set_ready("the autopilot is not armed")
    assert (run.status.state, run.status.reason) == (W, "the autopilot is not armed")
    run.set_ready("")
    assert run.status.state is R
    run.set_ready("the autopilot is in mode 19")
    assert (run.status.state, run.status.stop) == (H, HOLD)
    run.set_ready("")
    assert run.status.state is R, "it goes on by itself"


@pytest.mark.parametrize("state", RunState)
def test_restarted_mission_keeps_its_state(state: RunState) -> None:
    run = in_state(state)
    run.trip("depth", SURFACE, "12.0 m deep")
    again = MissionRun(at_once=True, on_abort=SURFACE)
    again.restore(json.loads(json.dumps(run.snapshot())))
    assert again.status == run.status
    assert again.command(Command.GO, "test") == run.command(Command.GO, "test") != ""


@pytest.mark.parametrize(
    ("state", "under_water", "resume", "after", "stop"),
    [
        (RunState.RUNNING, True, True, RunState.RUNNING, None),
        (RunState.RUNNING, True, False, RunState.HOLDING, SURFACE),
        (RunState.RUNNING, False, True, RunState.HOLDING, SURFACE),
        (RunState.HOLDING, True, True, RunState.HOLDING, SURFACE),
        (RunState.HOLDING, False, True, RunState.HOLDING, HOLD),
        (RunState.ABORTED, True, True, RunState.ABORTED, SURFACE),
        (RunState.ABORTED, False, True, RunState.ABORTED, SURFACE),
        (RunState.ENDED, True, True, RunState.ENDED, HOLD),
    ],
)
def test_after_a_reboot_a_mission_resumes_surfaces_or_waits_for_go_at_the_surface(
    state: RunState, under_water: bool, resume: bool, after: RunState, stop: Stop | None
) -> None:
    run = MissionRun(at_once=True, on_abort=SURFACE)
    run.restore(json.loads(json.dumps(in_state(state).snapshot())))
    run.pause("rebooted")
    if state is RunState.RUNNING:
        assert (run.status.state, run.status.stop) == (RunState.HOLDING, HOLD), "until its depth is known"
    run.after_reboot(under_water, resume)
    assert (run.status.state, run.status.stop) == (after, stop)
    if state is RunState.RUNNING and not under_water:
        assert run.command(Command.GO, "test") == ""
        assert run.status.state is RunState.RUNNING


def test_a_command_of_an_endless_sender_fits_into_a_state_file() -> None:
    run = in_state(RunState.RUNNING)
    assert run.command(Command.ABORT, 20_000 * "x") == ""
    assert len(json.dumps(run.snapshot())) < 1000


@pytest.mark.parametrize("then", [None, HOLD, SURFACE])
def test_the_end_stops_the_vehicle_and_its_planner(then: Stop | None) -> None:
    """It failed: a vehicle in state ENDED went on travelling, because the END had come too early."""
    run = MissionRun(at_once=True, on_abort=SURFACE, at_end=SURFACE)
    run.command(Command.END, "planner_node")
    assert run.status.state is RunState.ENDED
    assert run.status.stop == SURFACE
    assert run.status.blocked_reason == "the mission is ENDED: the last leg is complete"
    assert run.status.stop_after(then) == (None if then == SURFACE else SURFACE), "it completes its last leg"
    run.command(Command.HOLD, "operator")
    assert run.status.stop_after(SURFACE) == HOLD
    run.command(Command.ABORT, "operator")
    assert run.status.stop_after(SURFACE) == SURFACE, "no longer at its last leg"


@pytest.mark.parametrize("state", [RunState.ENDED, RunState.ABORTED])
@pytest.mark.parametrize("command", [Command.HOLD, Command.SURFACE])
def test_a_command_to_a_mission_that_is_over_moves_the_vehicle_and_keeps_the_reason(
    state: RunState, command: Command
) -> None:
    run = in_state(state)
    reason = run.status.reason
    assert run.command(command, "operator") == ""
    assert (run.status.state, run.status.reason) == (state, reason)
    assert run.status.stop == (SURFACE if command is Command.SURFACE or state is RunState.ABORTED else HOLD)
    run.trip("depth", SURFACE, "12.0 m deep")
    assert run.status.reason == reason
    assert run.status.limits == ("depth: 12.0 m deep",)
    run.command(Command.ABORT, "operator")
    assert run.status.reason == (reason if state is RunState.ABORTED else "ABORT by operator")


def test_a_go_after_a_reset_counts_although_a_busy_vehicle_takes_the_reset_or_its_repetition_later() -> None:
    run = in_state(RunState.ABORTED)
    reset = {"at_s": 100.0, "valid_s": 10.0}
    assert run.command(Command.RESET, "shore", given=Given(now_s=103.0, **reset)) == ""
    assert run.command(Command.RESET, "shore", given=Given(now_s=106.0, **reset)) == "", "sent again before the answer"
    assert "RESET was given after it" in run.command(Command.GO, "shore", given=Given(99.0, 106.5))
    assert run.command(Command.GO, "shore", given=Given(105.0, 107.0)) == ""
    assert run.status.state is RunState.RUNNING
    assert run.command(Command.RESET, "shore", given=Given(now_s=107.5, **reset)) == ""
    assert run.status.state is RunState.RUNNING


def test_a_reset_without_a_time_was_given_when_it_arrives_and_an_older_one_makes_it_no_older() -> None:
    run = in_state(RunState.ABORTED)
    assert run.command(Command.RESET, "by hand", given=Given(now_s=103.0)) == ""
    assert run.command(Command.RESET, "shore", given=Given(100.0, 104.0)) == ""
    assert "RESET was given after it" in run.command(Command.GO, "shore", given=Given(102.0, 105.0))
    run.command(Command.RESET, "shore", given=Given(5.0, 6.0))  # after a reboot
    assert "RESET was given after it" in run.command(Command.GO, "shore", given=Given(4.0, 7.0))
    assert run.command(Command.HOLD, "shore", given=Given(100.0, 106.0)) == ""
    assert "HOLD was given after it" in run.command(Command.GO, "shore", given=Given(105.5, 107.0)), (
        "a stop: on arrival"
    )
