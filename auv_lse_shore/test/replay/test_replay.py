"""A recording played: which topics, at what pace, by which keys; and over real rclpy, with its clock."""

from __future__ import annotations

import json
import math
import os
import pty
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_record.recording import RecordedTopic, Recording, recording_in
from auv_lse_record.run_writer import write_run
from auv_lse_shore.replay.keys import Keys, meanings
from auv_lse_shore.replay.pace import Pace, is_command, last_of_each, select_topics
from auv_lse_shore.replay.report import _wall_s

main = verb_main("replay")

S = 10**9


def topic(name: str) -> RecordedTopic:
    return RecordedTopic(name=name, kind="std_msgs/msg/String", count=1, reliable=True, latched=False, depth=1)


TOPICS = {name: topic(name) for name in ("/clock", "/auv1/plan", "/auv1/waypoint", "/auv2/modem/tx", "/sim/status")}


def test_a_message_is_due_when_the_recordings_time_has_come() -> None:
    pace = Pace(10 * S, 4.0, 100.0)
    assert pace.now_ns(101.0) == 14 * S
    assert pace.wait_s(14 * S, 101.0) == 0.0
    assert pace.wait_s(18 * S, 101.0) == pytest.approx(1.0)


def test_a_pause_holds_the_time_and_the_right_arrow_goes_to_the_next_message() -> None:
    pace = Pace(0, 1.0, 0.0)
    pace.toggle(5.0)
    assert pace.now_ns(50.0) == 5 * S
    assert pace.wait_s(6 * S, 50.0) == float("inf")
    assert pace.wait_s(5 * S, 50.0) == float("inf"), "another message of the same time waits, too"
    pace.step_to(6 * S, 51.0)
    assert pace.now_ns(60.0) == 6 * S
    pace.toggle(70.0)
    assert pace.now_ns(71.0) == 7 * S, "goes on from the message stepped to"


def test_another_rate_begins_where_the_recording_is() -> None:
    pace = Pace(0, 1.0, 0.0)
    pace.change_rate(2.0, 10.0)
    assert pace.now_ns(11.0) == 12 * S


def test_commands_are_left_out_unless_asked_for() -> None:
    assert is_command("/auv12/waypoint")
    assert is_command("/glider3/modem/tx")
    assert not is_command("/auv1/modem/rx")
    chosen = select_topics(TOPICS)
    assert chosen.commands == ("/auv1/waypoint", "/auv2/modem/tx")
    assert [t.name for t in chosen.played] == ["/clock", "/auv1/plan", "/sim/status"]
    assert [t.name for t in select_topics(TOPICS, commands=True).played] == list(TOPICS)


def test_topics_are_chosen_with_wildcards_and_the_clock_always_is() -> None:
    chosen = select_topics(TOPICS, ["/auv1/*", "/nothing"])
    assert [t.name for t in chosen.played] == ["/clock", "/auv1/plan"]
    assert chosen.unknown == ("/nothing",)


def test_late_readers_get_the_last_message_of_each_latched_topic() -> None:
    messages = [("/a", 1, b"1"), ("/b", 2, b"2"), ("/a", 3, b"3")]
    assert last_of_each(messages) == [("/b", 2, b"2"), ("/a", 3, b"3")]


def test_keys_as_terminals_send_them() -> None:
    assert meanings(" \x1b[Cx\x1b[A\x1b[B") == ["pause", "next", "faster", "slower"]


def needs_ros() -> None:
    """Skips a test where there is no ROS."""
    for name in ("rclpy", "auv_lse_msgs"):
        pytest.importorskip(name, reason=f"needs {name} (scripts/test sets it up)")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nowhere"], "nowhere does not exist"),
        (["RUN", "--rate", "0"], "--rate must be a finite number above 0, not 0"),
        (["RUN", "--rate", "inf"], "--rate must be a finite number above 0, not inf"),
        (["RUN", "--start", "1e6"], "--start must be within the recording, 0 to"),
        (["RUN", "--domain", "999"], "ROS domain '999' is not a whole number from 0 to 232"),
        (
            ["RUN", "--topics", "/nothing"],
            "--topics: the recording has no /nothing; it has /auv1/",
        ),
    ],
)
def test_options_that_do_not_fit_the_recording_are_refused(
    tmp_path: Path, synthetic_run, capsys, arguments: list[str], expected: str
) -> None:
    if arguments != ["nowhere"]:  # that is seen before ROS is loaded
        needs_ros()
    write_run(synthetic_run(steps=1), tmp_path / "a run")
    assert main([str(tmp_path / "a run") if a == "RUN" else a for a in arguments]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--set", "planner.iterations=5"], "--set requires --recompute"),
        (["--csv", "steps.csv", "--report"], "--csv requires --recompute"),
        (["--out", "page"], "--out requires --report"),
        (["--report", "--recompute", "gp"], "--recompute and --report exclude each other"),
        (["--rate", "2", "--report"], "--rate plays a recording, so it excludes --recompute and --report"),
        (["--paused", "--recompute", "gp"], "--paused plays a recording"),
        (["--mission", "mission.yaml"], "--mission requires --recompute or --report"),
        (["--tolerance", "1e-3"], "--tolerance requires --recompute"),
        (["--recompute", "gp", "--csv", "no folder/steps.csv"], "there is no folder no folder"),
        (["--recompute", "gp", "--csv", "/tmp"], "--csv /tmp: this is a folder; name a file in it"),
        (["--report", "--out", __file__], "is not a folder; choose another name"),
        (["--recompute", "gp", "--tolerance", "-1"], "--tolerance must be at least 0, not -1"),
    ],
)
def test_options_that_would_be_ignored_are_refused(capsys, arguments: list[str], expected: str) -> None:
    assert main(["a run", *arguments]) == 2
    assert expected in capsys.readouterr().err


def test_the_report_is_made_anew_from_the_recording(tmp_path: Path, synthetic_run, capsys) -> None:
    run = synthetic_run(steps=4)
    write_run(run, tmp_path / "run")
    assert main([str(tmp_path / "run"), "--report"]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["steps"] == 4
    assert summary["f1"] is not None, "the truth was recorded, so the ground is the mission file's"
    assert "<html" in (tmp_path / "run" / "report.html").read_text()
    assert str(tmp_path / "run" / "report.html") in capsys.readouterr().out
    for vehicle in run.vehicles:
        vehicle.truth = np.empty((0, 4))
    write_run(run, tmp_path / "at sea")
    assert main([str(tmp_path / "at sea" / "bag"), "--report", "--out", str(tmp_path / "page")]) == 0
    assert json.loads((tmp_path / "page" / "summary.json").read_text())["f1"] is None, "no truth: none is made up"


@pytest.mark.parametrize("text", ["[]", "null", "[" * 3000])
def test_a_damaged_summary_is_made_anew_with_the_report(tmp_path: Path, text: str) -> None:
    (tmp_path / "summary.json").write_text(text)
    assert math.isnan(_wall_s(tmp_path))


def test_a_terminal_that_is_closed_meanwhile_is_not_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    """As at the end of an SSH session: SIGHUP ends the replay, with its exit code."""
    outside, inside = pty.openpty()
    with os.fdopen(inside) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keys() as keys:
            assert keys.available
            os.close(outside)


class Pressed:
    """Keys pressed one after another, one at each look."""

    available = True

    def __init__(self, *keys: str) -> None:
        self.keys = list(keys)

    def wait(self, seconds: float) -> list[str]:
        if not self.keys:
            raise KeyboardInterrupt
        return [self.keys.pop(0)]


@pytest.mark.ros
def test_the_right_arrow_plays_one_message_of_several_with_one_stamp(tmp_path: Path, synthetic_run) -> None:
    needs_ros()
    from auv_lse_shore.replay.player_node import Player

    write_run(synthetic_run(steps=2), tmp_path)
    with Recording(recording_in(tmp_path)) as recording:
        at_start = [stamp for _, stamp, _ in recording.raw(recording.topics)].count(recording.start_ns)
        assert at_start > 3, "several messages have the first stamp"
        keys = Pressed("next", "next", "next")
        with Player(recording, tuple(recording.topics.values()), keys) as player, pytest.raises(KeyboardInterrupt):
            player.play(recording.start_ns, recording.end_ns, 1.0, True, lambda p: None)
        assert player.progress.messages == 3


@pytest.mark.ros
def test_a_rate_that_the_machine_cannot_reach_shows_no_time_beyond_the_messages(tmp_path: Path, synthetic_run) -> None:
    needs_ros()
    from auv_lse_shore.replay.player_node import Player

    write_run(synthetic_run(steps=2), tmp_path)
    with Recording(recording_in(tmp_path)) as recording:
        length_s = (recording.end_ns - recording.start_ns) * 1e-9
        with Player(recording, tuple(recording.topics.values()), Pressed()) as player:
            progress = player.play(recording.start_ns, recording.end_ns + 1, 1e6, False, lambda p: None)
    assert progress.at_s <= length_s + 1e-6


@pytest.mark.ros
def test_a_recording_played_over_rclpy(tmp_path: Path, synthetic_run) -> None:
    needs_ros()
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rosgraph_msgs.msg import Clock

    from auv_lse_msgs import msg as messages

    write_run(synthetic_run(steps=6), tmp_path)  # 94 s
    command = [sys.executable, "-m", "auv_lse_run", "replay", str(tmp_path), "--rate", "10", "--start", "30"]
    environment = {**os.environ, "AUV_LSE_ROOT": str(Path(__file__).resolve().parents[3])}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        domain = int(re.search(r"ROS_DOMAIN_ID=(\d+)", process.stdout.readline())[1])
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        node = rclpy.create_node("viewer", context=context)
        times, steps, legs = [], [], []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(Clock, "/clock", lambda m: times.append(m.clock.sec + 1e-9 * m.clock.nanosec), 100)
        node.create_subscription(messages.Plan, "/auv1/plan", lambda m: steps.append(m.step), latched)
        node.create_subscription(messages.Waypoint, "/auv1/waypoint", legs.append, 10)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        until = time.monotonic() + 60.0
        while process.poll() is None and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)
        rest = process.stdout.read()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert process.returncode == 0, rest
    assert times == sorted(times), "the clock runs"
    assert times[-1] > 90.0
    assert 30.0 <= times[0] < 80.0
    assert steps[0] >= 1, "the plan of before the start is latched"
    assert steps[-1] == 5
    assert not legs, "commands are left out"
    assert "messages" in rest
