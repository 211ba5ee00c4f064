"""Which starts of a vehicle continue its dive, and which begin a new one."""

from __future__ import annotations

import os
import shutil
import signal
import threading
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import DOUBT_VARIABLE, NODES, SECOND_VARIABLE, START_VARIABLE, StateFile, open_state
from auv_lse_common.node.state_memory import MemoryCopy, forget_copy
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_run.process.domain import VEHICLE_DOMAINS, DomainError, own_domain
from auv_lse_run.process.interrupt import Interrupt, signals_raised
from auv_lse_run.vehicle import dive_record, run_vehicle
from auv_lse_run.vehicle.dive_record import DiveRecord, StateFolderError, copy_folders


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    file = tmp_path / "vehicles.yaml"
    file.write_text("mission")
    return file


def opened(environment: dict[str, str], node: str) -> StateFile:
    """The state file of a node, as the node opens it."""
    return open_state(Path(environment[FOLDER_VARIABLE]) / f"auv2.{node}.state", {"node": node}, environment)


def begun(folder: Path, mission: Path, state: RunState | None = None, under_water: bool = False) -> Any:
    """A dive that has begun, with the last state of its safety node; returns record and environment."""
    record = DiveRecord(folder, 2, mission)
    environment = record.begin(folder / "dive", "auv2-1123-184534-3f2a")
    if state is not None:
        file = opened(environment, "safety_node")
        assert not file.lost
        file.write({"run": {"state": int(state)}, "under_water": under_water})
    return record, environment


def test_a_dive_under_water_is_continued_with_a_start_of_its_own(tmp_path: Path, mission: Path) -> None:
    _, first = begun(tmp_path, mission, RunState.RUNNING, True)
    again = DiveRecord(tmp_path, 2, mission)
    assert again.continued == tmp_path / "dive"
    second = again.begin(tmp_path / "other", "auv2-1123-999999-3f2a")
    assert {k for k in first if first[k] != second[k]} == {START_VARIABLE}
    assert second[DIVE_VARIABLE] == "auv2-1123-184534-3f2a"


@pytest.mark.parametrize(
    ("state", "under_water", "continued"),
    [
        (None, False, False),
        (RunState.WAITING, False, False),
        (RunState.WAITING, True, True),
        (RunState.RUNNING, False, True),
        (RunState.HOLDING, False, True),
        (RunState.ABORTED, False, True),
        (RunState.ENDED, False, False),
        (RunState.ENDED, True, True),
    ],
)
@pytest.mark.parametrize("ended", [False, True])
def test_what_continues(
    tmp_path: Path, mission: Path, state: RunState | None, under_water: bool, continued: bool, ended: bool
) -> None:
    record, _ = begun(tmp_path, mission, state, under_water)
    if ended:  # by SIGTERM, as when the operator or the computer stops it
        record.end()
        continued = under_water
    assert (DiveRecord(tmp_path, 2, mission).continued is not None) is continued


@pytest.mark.parametrize(("number", "ends"), [(signal.SIGINT, True), (signal.SIGTERM, True), (signal.SIGHUP, False)])
def test_a_lost_connection_ends_no_dive(
    tmp_path: Path, mission: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, ends: bool
) -> None:
    """A vehicle at the surface in mid-mission, whose operator's SSH session breaks, was not asked to end its dive."""
    monkeypatch.setattr(run_vehicle, "vehicle_domain", lambda *_: nullcontext())
    monkeypatch.setattr(run_vehicle, "note_run", lambda *_: None)
    (tmp_path / "dive").mkdir()
    begun(tmp_path, mission, RunState.RUNNING)
    record = DiveRecord(tmp_path, 2, mission)
    processes: Any = SimpleNamespace(simulated=False, vehicle=2)
    with signals_raised():
        interrupt = Interrupt()
        with run_vehicle.begin_dive(processes, "97", mission, tmp_path / "dive", record):
            file = opened(record.begin(tmp_path / "dive", "auv2-1123-184534-3f2a"), "safety_node")
            file.write({"run": {"state": int(RunState.RUNNING)}, "under_water": False})
            signal.raise_signal(number)
        assert interrupt.signal == number
    assert (DiveRecord(tmp_path, 2, mission).continued is None) is ends


def test_a_lost_connection_is_in_the_log_of_the_dive(tmp_path: Path) -> None:
    """The terminal, which shows why nodes end, is gone."""
    processes: Any = SimpleNamespace(simulated=False, lockstep=False, vehicle=2)
    with signals_raised():
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGHUP)).start()
        assert run_vehicle._keep_running(processes, [], tmp_path, {}) == 130
    text = (tmp_path / "auv2.vehicle.log").read_text()
    assert text.endswith(" auv2: all nodes have ended after SIGHUP: the terminal or SSH session was closed\n")


def test_another_mission_file_or_vehicle_is_a_new_dive(tmp_path: Path, mission: Path) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    assert DiveRecord(tmp_path, 3, mission).continued is None
    mission.write_text("another")
    assert DiveRecord(tmp_path, 2, mission).continued is None


def test_a_dive_whose_safety_state_is_torn_is_continued(tmp_path: Path, mission: Path) -> None:
    record, environment = begun(tmp_path, mission, RunState.RUNNING, True)
    path = Path(environment[FOLDER_VARIABLE]) / "auv2.safety_node.state"
    path.write_bytes(path.read_bytes()[:-1])
    assert DiveRecord(tmp_path, 2, mission).continued is not None
    record.end()
    assert DiveRecord(tmp_path, 2, mission).continued is not None


@pytest.mark.parametrize(
    ("node", "cure"), [("planner_node", "End the dive with Ctrl-C"), ("modem_node", "RESET and GO continue")]
)
def test_the_start_names_what_lets_a_vehicle_go_on(tmp_path: Path, mission: Path, node: str, cure: str) -> None:
    _, environment = begun(tmp_path, mission, RunState.RUNNING, True)
    path = Path(environment[FOLDER_VARIABLE]) / f"auv2.{node}.state"
    path.write_bytes(path.read_bytes()[:-1])
    again = DiveRecord(tmp_path, 2, mission)
    assert again.continued is not None
    assert node in again.doubt
    assert again.cure.startswith(cure)


def test_with_a_damaged_record_the_nodes_trust_nothing(tmp_path: Path, mission: Path) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    path = tmp_path / "auv2.dive"
    path.write_bytes(path.read_bytes()[:100])
    again = DiveRecord(tmp_path, 2, mission)
    assert again.continued is None
    environment = again.begin(tmp_path / "new", "auv2-1123-184534-ffff")
    for node in NODES:
        assert opened(environment, node).lost
    assert "not trusted" in opened(environment, "safety_node").loss_of("planner_node"), "GO is refused"
    assert again.cure.startswith("End the dive with Ctrl-C")


def full(*_: object, **__: object) -> None:
    raise OSError(28, os.strerror(28))


def test_a_simulated_dive_does_not_start_without_room_for_its_state(
    tmp_path: Path, mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dive_record, "begin_state", full)
    with pytest.raises(StateFolderError, match=r"No space left on device\. No mission starts"):
        DiveRecord(tmp_path, 2, mission, simulated=True).begin(tmp_path / "dive", "auv2-1123-184534-3f2a")


def test_without_room_for_its_state_a_vehicle_holds(
    tmp_path: Path, mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dive_record, "begin_state", full)
    environment = DiveRecord(tmp_path, 2, mission).begin(tmp_path / "dive", "auv2-1123-184534-3f2a")
    assert "No space left on device. No mission starts" in environment[DOUBT_VARIABLE]
    assert "is missing" in opened(environment, "safety_node").loss_of("planner_node")
    assert all("is missing" in opened(environment, node).lost for node in NODES)


def test_a_dive_continues_on_a_full_disk(tmp_path: Path, mission: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    monkeypatch.setattr(dive_record, "begin_state", full)
    assert not DiveRecord(tmp_path, 2, mission).begin(tmp_path / "dive", "")[DOUBT_VARIABLE]


def test_a_dive_of_another_mission_file_that_was_not_ended_holds_the_next_one(tmp_path: Path, mission: Path) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    mission.write_text("another")
    record = DiveRecord(tmp_path, 2, mission)
    assert "was not ended" in record.doubt
    assert record.cure == "RESET and GO continue"
    environment = record.begin(tmp_path / "new", "auv2-1123-184534-ffff")
    assert "was not ended" in opened(environment, "safety_node").lost
    assert not opened(environment, "planner_node").lost, "RESET and GO begin the new dive"
    assert not opened(environment, "safety_node").loss_of("planner_node")


def test_a_second_copy_remembers_a_dive_whose_folder_was_removed(tmp_path: Path, mission: Path) -> None:
    copies = tmp_path / "copies"
    folder = tmp_path / "card"
    record = DiveRecord(folder, 2, mission, copies=[copies])
    assert not record.doubt
    environment = record.begin(folder / "dive", "auv2-1123-184534-3f2a")
    opened(environment, "safety_node").write({"run": {"state": int(RunState.ABORTED)}, "under_water": False})
    assert not DiveRecord(folder, 2, mission, copies=[copies]).doubt
    for state in folder.rglob("*.state"):
        forget_copy(state)  # as a reboot does
    shutil.rmtree(folder)
    again = DiveRecord(folder, 2, mission, copies=[copies])
    assert "has dive auv2-1123-184534-3f2a" in again.doubt
    after = again.begin(folder / "new", "auv2-1123-184534-ffff")
    opened(after, "safety_node").write({"run": {"state": int(RunState.HOLDING)}, "under_water": False})
    again.end()
    assert not DiveRecord(folder, 2, mission, copies=[copies]).doubt, "an orderly end ends the doubt, too"
    assert not DiveRecord(tmp_path / "another card", 2, mission, copies=[copies]).doubt


def test_an_unwritable_folder_for_second_copies_is_reported_and_no_reason_to_hold(
    tmp_path: Path, mission: Path
) -> None:
    (tmp_path / "file").write_text("")
    record = DiveRecord(tmp_path, 2, mission, copies=[tmp_path / "file" / "copies"])
    environment = record.begin(tmp_path / "dive", "auv2-1123-184534-3f2a")
    assert "Not a directory" in record.copies_problem
    assert (environment[SECOND_VARIABLE], environment[DOUBT_VARIABLE]) == ("", "")


def test_where_second_copies_go(monkeypatch: pytest.MonkeyPatch) -> None:
    assert copy_folders("/mnt/copies") == [Path("/mnt/copies")]
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/auv_lse:/var/lib/other")
    assert copy_folders("") == [Path("/var/lib/auv_lse"), Path("/home/me/.local/state/auv_lse")]
    monkeypatch.delenv("HOME")
    assert len(copy_folders("")) == 2, "the home of the user's entry"


def copies_of(environment: dict[str, str]) -> list[bool]:
    """Whether each node's state file has a copy in memory."""
    return [MemoryCopy(Path(environment[FOLDER_VARIABLE]) / f"auv2.{node}.state").text is not None for node in NODES]


def test_a_dive_that_ended_under_water_leaves_its_state_in_memory_until_another_dive_begins(
    tmp_path: Path, mission: Path
) -> None:
    record, environment = begun(tmp_path, mission, RunState.RUNNING, True)
    record.end()
    assert any(copies_of(environment)), "the next start continues it"
    mission.write_text("another")
    again = DiveRecord(tmp_path, 2, mission)
    assert any(copies_of(environment)), "nothing has begun yet"
    again.begin(tmp_path / "other", "auv2-1123-199999-3f2a")
    assert not any(copies_of(environment))


def test_a_simulated_dive_leaves_nothing_in_memory(tmp_path: Path, mission: Path) -> None:
    record = DiveRecord(tmp_path, 2, mission, simulated=True)
    environment = record.begin(tmp_path / "dive", "sim-1123-184534-3f2a")
    state = opened(environment, "safety_node")
    state.write({"run": {"state": int(RunState.RUNNING)}, "under_water": True})
    assert any(copies_of(environment))
    record.end()
    assert not any(copies_of(environment))


def test_a_copy_that_is_the_record_itself_is_no_other_dive(tmp_path: Path, mission: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "one")
    processes: Any = SimpleNamespace(simulated=False, vehicle=2)
    record = DiveRecord(tmp_path / "one", 2, mission, copies=[tmp_path / "one", tmp_path / "link"])
    with (
        own_domain(VEHICLE_DOMAINS) as domain,
        run_vehicle.begin_dive(processes, str(domain), mission, tmp_path / "a", record),
    ):
        assert (tmp_path / "one" / "auv2.dive").exists()


@pytest.mark.parametrize("shared", ["copies", "record"])
def test_two_dives_at_once_never_share_a_record(tmp_path: Path, mission: Path, shared: str) -> None:
    """In two domains: the second one replaced the first one's second copies, or its record."""
    processes: Any = SimpleNamespace(simulated=False, vehicle=2)
    folders = [tmp_path / ("same" if shared == "record" else name) for name in ("one", "other")]
    copies = [tmp_path / ("same copies" if shared == "copies" else f"copies {i}") for i in range(2)]
    taken = (copies[0] if shared == "copies" else folders[0]) / "auv2.dive"
    with own_domain(VEHICLE_DOMAINS) as first, own_domain(VEHICLE_DOMAINS) as second:
        records = [DiveRecord(f, 2, mission, copies=[c]) for f, c in zip(folders, copies, strict=True)]
        dives = [
            run_vehicle.begin_dive(processes, str(domain), mission, tmp_path / name, record)
            for domain, name, record in zip((first, second), "ab", records, strict=True)
        ]
        with dives[0]:
            kept = taken.read_bytes()
            refused = rf"{taken} belongs to a running dive in ROS domain {first} \(process {os.getpid()}\)"
            with pytest.raises(DomainError, match=refused), dives[1]:
                pass
            assert taken.read_bytes() == kept
        again = DiveRecord(folders[1], 2, mission, copies=[copies[1]])
        with run_vehicle.begin_dive(processes, str(second), mission, tmp_path / "b", again):
            assert taken.exists(), "the other one has ended"


@pytest.mark.parametrize("under_water", [True, False])
def test_a_start_that_read_its_record_before_another_dive_ended_is_refused(
    tmp_path: Path, mission: Path, under_water: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would begin a new dive under water, or continue one that has ended."""
    monkeypatch.setattr(run_vehicle, "first_signal", lambda: signal.SIGINT)
    processes: Any = SimpleNamespace(simulated=False, vehicle=2)
    (tmp_path / "one").mkdir()
    with own_domain(VEHICLE_DOMAINS) as domain:
        early = DiveRecord(tmp_path, 2, mission)
        dive = run_vehicle.begin_dive(
            processes, str(domain), mission, tmp_path / "one", DiveRecord(tmp_path, 2, mission)
        )
        with dive as (_, environment):
            state = {"run": {"state": int(RunState.RUNNING)}, "under_water": under_water}
            opened(environment, "safety_node").write(state)
            if not under_water:
                early = DiveRecord(tmp_path, 2, mission)
                assert early.continued is not None
        changed = "another start of auv2 changed it while this one began. Start again"
        with (
            pytest.raises(DomainError, match=changed),
            run_vehicle.begin_dive(processes, str(domain), mission, tmp_path / "two", early),
        ):
            pass
        assert (DiveRecord(tmp_path, 2, mission).continued is not None) is under_water
