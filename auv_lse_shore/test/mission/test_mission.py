"""Whole missions of real processes, short ones, and what they leave."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rich.console import Console

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from ground_helpers import SURVEY_FILES, write_survey
from verb_main import verb_main

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_comms.packet.codec import decode
from auv_lse_comms.tdma import Tdma
from auv_lse_record.recording import Recording, RecordingError, recording_in
from auv_lse_record.run_reader import read_run
from auv_lse_record.size_estimate import size_of
from auv_lse_shore.mission import mission as mission_module
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of

main = verb_main("mission")
replay = verb_main("replay")

pytestmark = [pytest.mark.ros, pytest.mark.mission]

ROOT = Path(__file__).resolve().parents[3]
STEPS = 12


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "auv_lse_run", "mission", *arguments]


@contextlib.contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A mission's process; one that still runs when a test fails is killed, so that the test ends."""
    with subprocess.Popen(
        command(*arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**environment(), "PYTHONUNBUFFERED": "1"},
        start_new_session=True,
    ) as process:
        try:
            yield process
        except BaseException:
            process.kill()
            raise


def environment() -> dict[str, str]:
    return {**os.environ, "AUV_LSE_ROOT": str(ROOT), "COLUMNS": "200"}


def fly(*arguments: str, timeout_s: float = 240.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=timeout_s, env=environment(), check=False
    )


def nodes_of(folder: Path, executable: str = "") -> list[int]:
    """Processes that were started with this run's mission file, all or those of an executable."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if f"{folder}/mission.yaml" in line and executable in line:
            found.append(int(path.parent.name))
    return found


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("mission") / "run"
    return folder, fly("--steps", str(STEPS), "--seed", "5", "--packet-loss", "0.2", "--out", str(folder))


def test_a_mission_leaves_a_whole_run_folder(mission: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, process = mission
    assert process.returncode == 0, process.stdout + process.stderr
    names = {p.name for p in folder.iterdir()}
    assert {"bag", "mission.yaml", "summary.json", "isobath.geojson", "report.html", "logs"} <= names
    assert any(name.endswith(".png") for name in names)
    summary = json.loads((folder / "summary.json").read_text())
    for key in (
        "vehicles",
        "steps",
        "method",
        "seed",
        "team_reward",
        "lower_bound",
        "risk_before",
        "risk_after",
        "f1",
        "misclassified_m2",
        "packets_sent",
        "packets_received",
        "sim_s",
        "wall_s",
    ):
        assert key in summary
    assert (summary["vehicles"], summary["steps"], summary["seed"]) == (3, STEPS, 5)
    assert summary["risk_after"] < summary["risk_before"]
    assert summary["packets_sent"] > 6
    assert not nodes_of(folder), "a process was left behind"
    again = Settings.load(folder / "mission.yaml")
    assert again.mission.seed == 5
    assert again.to_parameter_file() == (folder / "mission.yaml").read_text(), "the file is complete"


def test_the_recording_ends_with_every_vehicles_end_and_its_map_then(
    mission: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, _ = mission
    states: dict[int, list[tuple[float, RunState]]] = {}
    maps: dict[int, list[float]] = {}
    with Recording(recording_in(folder)) as recording:
        for value in recording.values({"mission/state", "field"}):
            if value.topic.name == "field":
                maps.setdefault(value.vehicle, []).append(value.stamp_s)
            else:
                states.setdefault(value.vehicle, []).append((value.stamp_s, value.value.status.state))
    assert set(states) == {1, 2, 3}
    for vehicle, found in states.items():
        ended_s, state = found[-1]
        assert state is RunState.ENDED, f"auv{vehicle} ends in {state}"
        assert maps[vehicle][-1] >= ended_s


def test_two_independent_readers_find_every_packet_whole_and_in_its_slot(
    mission: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    folder, _ = mission
    settings = Settings.load(folder / "mission.yaml")
    run = read_run(folder)  # through rosbags
    by_rosbags = [(p.stamp_s, p.source, p.payload) for p in run.sent]
    by_mcap = []
    counts: dict[str, int] = {}
    with (folder / "bag" / "bag.mcap").open("rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic.endswith("modem/tx"):
                stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
                by_mcap.append((stamp, message.source, bytes(message.payload)))
    assert sorted(by_mcap) == sorted(by_rosbags)
    assert by_mcap
    tdma = {k: Tdma(settings.tdma, k, 3) for k in (1, 2, 3)}
    for stamp, source, payload in by_mcap:
        assert len(payload) == 252
        assert tdma[source].slot(stamp).owner == source
        assert tdma[source].may_send(stamp)
        packet = decode(payload)
        assert 0 <= packet.plan.step <= STEPS
    ticks = counts["/clock"]
    for k in (1, 2, 3):
        assert counts[f"/auv{k}/odometry"] == counts[f"/truth/auv{k}/odometry"] == ticks, "nothing is lost on the way"
        assert counts[f"/auv{k}/plan"] == counts[f"/auv{k}/waypoint"] == STEPS
        assert counts[f"/auv{k}/kernel_centers"] >= counts[f"/auv{k}/field"] > 1, "with each map"
        assert counts[f"/auv{k}/risk_map"] > 1


def test_the_recording_is_as_large_as_it_was_estimated(
    mission: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, done = mission
    expected_mb = size_of(Settings.load(folder / "mission.yaml")).mission_mb
    mb = sum(file.stat().st_size for file in (folder / "bag").iterdir()) / 1e6
    assert expected_mb / 1.5 <= mb <= 1.5 * expected_mb
    assert f"the recording takes about {expected_mb:.0f} MB" in done.stdout


def test_both_wirings_decide_alike(mission: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = mission
    settings = Settings.load(folder / "mission.yaml")
    by_ros = read_run(folder)
    by_fleet = Fleet(settings, ground_of(settings)).run()
    assert [p.payload for p in by_ros.sent] == [p.payload for p in by_fleet.sent], "every packet, to the last bit"
    for ros, fleet in zip(by_ros.vehicles, by_fleet.vehicles, strict=True):
        assert len(ros.decisions) == len(fleet.decisions) == STEPS
        for a, b in zip(ros.decisions, fleet.decisions, strict=True):
            assert (a.now_s, a.step, a.plan) == (b.now_s, b.step, b.plan)
            assert a.jbar == b.jbar


def test_nodes_in_processes_of_their_own_decide_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a launch file starts them: each node then subscribes for itself."""
    whole, counts = mission_module.mission_processes, []

    def apart(*arguments: Any, together: bool, **options: Any) -> Any:
        processes = whole(*arguments, **options)
        counts.append((together, len(processes)))
        return processes

    monkeypatch.setattr(mission_module, "mission_processes", apart)
    folder = tmp_path / "run"
    size = ["--vehicles", "2", "--steps", "4", "--seed", "5", "--no-report"]
    assert main([*size, "--out", str(folder)]) == 0
    assert counts == [(True, 10)], "two vehicles of four nodes, the recorder, the simulator"
    settings = Settings.load(folder / "mission.yaml")
    sent = [packet.payload for packet in read_run(folder).sent]
    assert sent == [packet.payload for packet in Fleet(settings, ground_of(settings)).run().sent]
    assert len(sent) > 3


def test_both_wirings_end_alike_with_the_quality_asked_for(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    asked = ("--set", "mission.until.undiscovered_m=5000.0", "--set", "vehicle.at_end=surface")
    size = ("--vehicles", "2", "--steps", "30", "--seed", "5", "--packet-loss", "0.2")
    done = fly(*size, *asked, "--out", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    settings = Settings.load(folder / "mission.yaml")
    by_ros, by_fleet = read_run(folder), Fleet(settings, ground_of(settings)).run()
    assert [p.payload for p in by_ros.sent] == [p.payload for p in by_fleet.sent], "every packet, to the last bit"
    for ros, fleet in zip(by_ros.vehicles, by_fleet.vehicles, strict=True):
        assert 5 < len(ros.decisions) < 30
        assert [(d.now_s, d.plan) for d in ros.decisions] == [(d.now_s, d.plan) for d in fleet.decisions]
        assert ros.decisions[-1].plan.quality_reached
    assert json.loads((folder / "summary.json").read_text())["quality_reached"] is True
    assert f"ended because the quality asked for was reached, at step {by_ros.steps} of 30" in done.stdout
    assert re.search(r"quality: at most [\d,]+ m undiscovered \(required 5000 m\)", done.stdout)
    assert "interrupted" not in done.stdout
    assert replay([str(folder), "--recompute", "planner"]) == 0


def test_computed_again_from_its_recording_the_mission_is_the_same(
    mission: tuple[Path, subprocess.CompletedProcess[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = mission
    assert replay([str(folder), "--recompute", "gp,planner"]) == 0
    out = capsys.readouterr().out
    assert f"planner: {3 * STEPS} decisions compared, 0 differ" in out
    assert re.search(r"gp: [1-9]\d* maps compared, 0 differ", out)
    assert replay([str(folder / "bag"), "--recompute", "gp", "--set", "gp.length_scale_m=60.0"]) == 1
    out = capsys.readouterr().out
    assert "changed: gp.length_scale_m: 85.0 -> 60.0" in out
    assert "0 differ" not in out


def test_two_missions_over_a_survey_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    """The guide's page of your own lake flies over soundings, the other kind of survey."""
    write_survey(tmp_path)
    ground = ("--bathymetry", str(tmp_path / SURVEY_FILES[1]), "--area", "0", "0", "400", "400")
    folders = [tmp_path / "a", tmp_path / "b"]
    processes = [
        subprocess.Popen(
            command(*ground, "--vehicles", "1", "--steps", "4", "--seed", "9", "--no-report", "--out", str(folder)),
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment(),
        )
        for folder in folders
    ]  # fmt: skip
    outputs = [process.communicate(timeout=200)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], outputs
    assert "too large" in outputs[0], "a warning: the area is far too large for 4 steps"
    assert "%" in outputs[0], "with the coverage to expect"
    first, second = (read_run(folder) for folder in folders)
    assert [p.payload for p in first.sent] == [p.payload for p in second.sent], "the same seed gives the same run"
    assert (first.vehicles[0].soundings.rows == second.vehicles[0].soundings.rows).all()
    assert len(first.vehicles[0].soundings) > 20
    assert first.origin is not None
    with (folders[0] / "bag" / "bag.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    counts = {summary.channels[key].topic: n for key, n in summary.statistics.channel_message_counts.items()}
    assert counts["/auv1/navsat"] == counts["/auv1/odometry"]


def _decided(folder: Path) -> bool:
    """Whether the recording of a running mission holds a decision."""
    try:
        return bool(read_run(folder).vehicles[0].decisions)
    except (OSError, RecordingError):
        return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_every_process_and_leaves_a_readable_recording(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C, and a closed SSH session."""
    folder = tmp_path / "run"
    with started("--vehicles", "1", "--out", str(folder), "--no-report") as process:
        until = time.monotonic() + 90.0
        while not _decided(folder):
            assert time.monotonic() < until, "the mission did not get going"
            time.sleep(0.2)
        process.send_signal(number)
        began = time.monotonic()
        while nodes_of(folder):
            assert time.monotonic() - began < 5.0, "processes are still there 5 s after the signal"
            time.sleep(0.1)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 128 + number, output
    assert read_run(folder).vehicles[0].decisions, "the recording is readable"


def test_a_recording_begun_before_the_first_tick_is_removed_on_ctrl_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings.load(None, {"record.folder": str(tmp_path / "bag")})

    def interrupted(*arguments: Any) -> dict[str, float]:
        (tmp_path / "bag").mkdir()
        (tmp_path / "bag" / "metadata.yaml").write_text("begun")
        arguments[4].signal = signal.SIGINT
        return {"start": 1.0}

    monkeypatch.setattr("auv_lse_shore.mission.mission.conduct", interrupted)
    shown = io.StringIO()
    code = mission_module.fly(settings, tmp_path, Console(file=shown), [], contextlib.nullcontext(7))
    assert code == 130
    assert "nothing was recorded" in shown.getvalue()
    assert not (tmp_path / "bag").exists()


def test_ctrl_c_before_the_first_tick_and_during_the_report_prints_what_was_recorded(tmp_path: Path) -> None:
    for folder, sign, last, there in (
        (tmp_path / "early", "to watch from another terminal", "interrupted before the first tick", False),
        (tmp_path / "late", None, "For its report: auv_lse replay", True),
    ):
        with started("--vehicles", "1", "--steps", "1", "--out", str(folder)) as process:
            until = time.monotonic() + 90.0
            while sign is None and not (folder / "logs" / "times.json").exists() and time.monotonic() < until:
                time.sleep(0.01)
            assert sign is None or _reads(process, sign)
            time.sleep(0.3)
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=60)
        assert process.returncode == 130, output
        assert last in output
        assert "Traceback" not in output
        assert "error" not in output
        assert (folder / "bag" / "metadata.yaml").exists() == there
        assert not (folder / "report.html").exists()
        assert not nodes_of(folder)


def test_the_report_begins_when_its_libraries_are_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both would import at the same time otherwise, and Ctrl-C then could stop both for good."""
    settings = Settings.load(None, {"record.folder": str(tmp_path / "bag")})
    events: list[str] = []

    def load() -> None:
        time.sleep(0.3)
        events.append("loaded")

    def conduct(*arguments: Any) -> dict[str, float]:
        arguments[-1]()
        return {"mission": 1.0}

    monkeypatch.setattr(mission_module, "preload_report", load)
    monkeypatch.setattr(mission_module, "conduct", conduct)
    monkeypatch.setattr(mission_module, "conclude", lambda *_, **__: events.append("report"))
    console = Console(file=io.StringIO())
    assert mission_module.fly(settings, tmp_path, console, [], contextlib.nullcontext(7)) == 0
    assert events == ["loaded", "report"]


def _reads(process: subprocess.Popen[str], text: str) -> bool:
    """Whether a process says `text`; reads on until it does."""
    assert process.stdout is not None
    return any(text in line for line in iter(process.stdout.readline, ""))


def test_a_node_that_dies_is_named_with_its_last_words(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with started("--vehicles", "1", "--out", str(folder), "--no-report") as process:
        until = time.monotonic() + 90.0
        victim: Any = None
        while victim is None:
            assert time.monotonic() < until, "the mission did not get going"
            time.sleep(0.2)
            if (folder / "bag" / "bag.mcap").exists() and (folder / "bag" / "bag.mcap").stat().st_size > 20_000:
                victim = next(iter(nodes_of(folder, "gp_node")), None)
        maps = Path(f"/proc/{victim}/maps").read_text()
        os.kill(victim, signal.SIGKILL)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 1, output
    assert "auv1 ended unexpectedly" in output, "in lockstep a vehicle's nodes share a process"
    assert "auv1.log" in output
    assert f"The mission is recorded up to here. For its report: auv_lse replay {folder} --report" in output
    assert not nodes_of(folder)
    assert "/dev/shm/fastrtps" not in maps, "shared memory of a node that is killed would stay"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--vehicles", "21"], "mission.vehicles"),
        (["--set", "planner.iteratons=5"], "did you mean 'iterations'"),
        (["--set", "planner.iterations"], "is not NAME=VALUE"),
        (["--method", "psychic"], "psychic"),
        (["--packet-loss", "1.5"], "packet_loss"),
        (["--bathymetry", "nowhere.csv"], "nowhere.csv"),
        (["--water-level", "372"], "--water-level is for a bathymetry, and there is none"),
        (["--depths"], "--depths is for a bathymetry, and there is none"),
        (["nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_words_and_nothing_is_made(
    tmp_path: Path, arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main([*arguments, "--out", str(folder)]) == 2
    assert expected in capsys.readouterr().err
    assert not folder.exists()


def test_a_run_folder_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("data")
    process = fly("--out", str(tmp_path))
    assert process.returncode == 2
    assert "not empty" in process.stderr
    assert "Traceback" not in process.stdout + process.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]
