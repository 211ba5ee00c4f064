"""ROS domains of this machine."""

from __future__ import annotations

import getpass
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

import pytest

from auv_lse_common.support.confinement import NETWORK_VARIABLES, is_confined
from auv_lse_run.inspect import domain_choice
from auv_lse_run.inspect.domain_choice import join
from auv_lse_run.process import domain
from auv_lse_run.process.domain import (
    SIMULATOR_DOMAINS,
    DomainError,
    busy_domains,
    check_own,
    dive_on,
    domain_number,
    domains_with_participants,
    has_participants,
    lock_file,
    loopback_problem,
    node_environment,
    note_run,
    own_domain,
    run_on,
    simulation_domain,
    simulator_domain,
    simulator_of,
    user_of,
    vehicle_domain,
    wanted_domain,
)


@pytest.fixture(autouse=True)
def _locks_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domain.tempfile, "gettempdir", lambda: str(tmp_path))


def test_no_two_missions_get_the_same_domain_and_busy_ones_are_found(tmp_path: Path) -> None:
    assert busy_domains() == []
    with own_domain() as first, own_domain() as second:
        assert first != second
        assert {first, second} <= set(SIMULATOR_DOMAINS)
        assert busy_domains() == sorted((first, second))
        note_run(first, tmp_path / "a run", "sim-1123-184534-3f2a")
        used = rf"ROS domain {first} is in use by sim-1123-184534-3f2a in {tmp_path}/a run\. Leave"
        with pytest.raises(DomainError, match=used), simulator_domain(str(first)):
            pass
        assert (run_on(first), dive_on(first)) == (tmp_path / "a run", "sim-1123-184534-3f2a")
        assert simulator_of(tmp_path / "a run") == str(first)
        assert simulator_of(tmp_path) is None
    assert busy_domains() == []
    assert dive_on(first) is None


def test_a_vehicle_that_a_simulation_runs_itself_is_refused_a_second_time(tmp_path: Path) -> None:
    with simulation_domain(None, tmp_path / "a run", 2) as number:
        for vehicle in (1, 2):
            taken = rf"already has the nodes of auv{vehicle} \(sim-\S+ in {tmp_path}/a run\)"
            with pytest.raises(DomainError, match=taken), vehicle_domain(number, vehicle, True):
                pass
        with vehicle_domain(number, 3, True) as same:
            assert same == number
    with simulation_domain(None, tmp_path / "a run") as number, vehicle_domain(number, 1, True):
        assert number in busy_domains(), "without vehicles of its own, as the verb sim"


@pytest.mark.parametrize("call", ["simulator_domain(None).__enter__()", "confine_to(90)"])
def test_a_network_of_this_computer_that_is_down_is_named_at_once(call: str) -> None:
    code = f"from auv_lse_run.process.domain import confine_to, simulator_domain; {call}"
    free = {name: value for name, value in os.environ.items() if name not in NETWORK_VARIABLES}
    command = ["unshare", "--net", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=free)
    if "unshare failed" in done.stderr or "Operation not permitted" in done.stderr:
        pytest.skip("this process may make no network of its own")
    assert "interface lo) is down" in done.stderr
    assert loopback_problem() == ""


@pytest.mark.parametrize("number", [0, 81, 101, 150])
def test_a_simulation_keeps_off_the_domains_of_vehicles(number: int) -> None:
    with pytest.raises(
        DomainError, match=rf"ROS domain {number} is for vehicles; a simulation or a replay uses 1 to 80"
    ):
        simulator_domain(str(number)).__enter__()


@pytest.mark.parametrize("number", [1, 80])
def test_a_vehicle_keeps_off_the_domains_of_simulations(number: int) -> None:
    refused = rf"ROS domain {number} is for simulations, as all of 1 to 80; .* 81 to 101 or 0.*: --domain (8|9|10)\d"
    with pytest.raises(DomainError, match=refused), vehicle_domain(number, 3, simulated=False):
        pass


def test_vehicles_share_a_domain_but_not_a_name(tmp_path: Path) -> None:
    with vehicle_domain(90, 1, simulated=False), vehicle_domain(90, 2, simulated=False):
        note_run(90, tmp_path, "auv2-1123-184534-3f2a", vehicle=2)
        assert busy_domains() == [90]
        assert run_on(90) is None, "the live page looks for simulations there"
        running = r"already has the nodes of auv2 \(auv2-1123-184534-3f2a in "
        with pytest.raises(DomainError, match=running), vehicle_domain(90, 2, simulated=False):
            pass
    assert busy_domains() == []
    assert list(tmp_path.glob("*.lock")) == []


def test_a_simulated_vehicle_joins_its_simulator_alone(tmp_path: Path) -> None:
    with own_domain() as domain:
        note_run(domain, tmp_path, "sim-1123-184534-3f2a")
        with vehicle_domain(domain, 1, simulated=True) as joined:
            assert joined == domain
    with pytest.raises(DomainError, match="has no simulator of this machine"):
        vehicle_domain(domain, 1, simulated=True).__enter__()


def test_a_note_that_cannot_be_written_is_an_error_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr("auv_lse_run.process.domain.lock_file", lambda *_: tmp_path / "missing" / "a.lock")
    with pytest.raises(DomainError, match=r"a\.lock: the note for other commands cannot be written: No such file"):
        note_run(91, tmp_path, "sim-1123-184534-3f2a")


def test_a_domain_with_nodes_that_reserved_nothing_is_not_taken() -> None:
    """A participant's first UDP port is bound, as by a node that was started by hand."""
    with own_domain() as free, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stray:
        stray.bind(("127.0.0.1", 7400 + 250 * free + 10))
        assert has_participants(free)
        assert free in domains_with_participants()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stray:
        stray.bind(("127.0.0.1", 7400 + 250 * free + 12))  # the second participant; the first has ended
        with pytest.raises(DomainError, match="has other nodes of this machine"), simulator_domain(str(free)):
            pass
        with pytest.raises(DomainError, match="are in use"), own_domain([free]):
            pass
    assert not has_participants(free)


def test_a_lock_on_a_file_that_was_removed_meanwhile_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    lock, removed = domain.fcntl.flock, []
    monkeypatch.setattr(domain, "has_participants", lambda number: False)  # a vehicle may run on this computer

    def slow(file: Any, how: int) -> None:
        if not removed:  # the mission before ends between opening and locking: its file goes, and others make a new one
            removed.append(True)
            lock_file(97).unlink()
        lock(file, how)

    monkeypatch.setattr(domain.fcntl, "flock", slow)
    with pytest.raises(DomainError, match=r"97\.\.97 are in use"), own_domain([97]):
        pass
    with own_domain([97]):
        assert busy_domains() == [97]


def test_a_wish_is_an_option_or_a_variable_other_than_ros_default(monkeypatch: pytest.MonkeyPatch) -> None:
    for value, wanted in (("", None), ("0", None), ("7", "7"), ("x", "x")):
        monkeypatch.setenv("ROS_DOMAIN_ID", value)
        assert wanted_domain(None) == wanted
    assert wanted_domain("0") == "0"


@pytest.mark.parametrize("text", ["", "-1", "233", "1.5", "x"])
def test_a_domain_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(DomainError, match="is not a whole number from 0 to 232"):
        domain_number(text)
    assert domain_number("17") == 17


def test_the_environment_of_a_node(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "3")
    assert node_environment()["ROS_DOMAIN_ID"] == "3"
    of_node = node_environment(5)
    assert (of_node["ROS_DOMAIN_ID"], of_node["OMP_NUM_THREADS"]) == ("5", "1")
    assert is_confined(of_node)


def test_commands_without_a_domain_reach_no_simulation_of_another_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(domain_choice, "confine_to", lambda number: None)  # it sets this process's environment
    with simulator_domain(None) as number:
        note_run(number, tmp_path / "a run", "sim-1123-184534-3f2a")
        assert join(None, commands=True) == number
        used = f"ROS domain {number}, in use on this machine by sim-1123-184534-3f2a in {tmp_path}/a run\n"
        assert capsys.readouterr().err == used
        monkeypatch.setattr(domain.os, "geteuid", lambda: 54321)
        refused = rf"sim-1123-184534-3f2a in .*, started by {getpass.getuser()} \(ROS domain {number}\)\. To command it"
        with pytest.raises(DomainError, match=refused):
            join(None, commands=True)
        assert join(None) == number, "to watch it is harmless"
        assert join(str(number), commands=True) == number
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        assert join(None, commands=True) == number


def test_commands_on_a_vehicle_reach_the_nodes_that_a_service_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(domain_choice, "confine_to", lambda number: None)  # it sets this process's environment
    with vehicle_domain(90, 2, simulated=False):
        note_run(90, tmp_path, "auv2-1123-184534-3f2a", vehicle=2)
        monkeypatch.setattr(domain.os, "geteuid", lambda: 54321)
        assert join(None, commands=True) == 90
        assert "by auv2-1123-184534-3f2a in" in capsys.readouterr().err
    check_own(90)


def test_notes_of_a_killed_mission_name_no_later_user_of_its_domain(tmp_path: Path) -> None:
    """As a replay, which notes nothing, after a simulation that was killed."""
    with own_domain() as number:
        pass
    for vehicle in (0, 1):
        note_run(number, tmp_path, "sim-1123-184534-3f2a", vehicle)
    try:
        with simulator_domain(str(number)):
            assert (dive_on(number), run_on(number), user_of(number)) == ("", None, "another mission")
            with vehicle_domain(number, 1, simulated=True):
                assert user_of(number, 1) == "another mission"
    finally:
        lock_file(number, 1).unlink(missing_ok=True)


def _as_another_user(monkeypatch: pytest.MonkeyPatch) -> None:
    open_file = Path.open

    def refused(path: Path, mode: str = "r", *others: Any, **more: Any) -> IO[Any]:
        if mode == "a" and path.exists():
            raise PermissionError(13, "Permission denied", str(path))
        return open_file(path, mode, *others, **more)

    monkeypatch.setattr(domain.os, "geteuid", lambda: 54321)
    monkeypatch.setattr(Path, "open", refused)


def test_a_lock_file_that_another_user_s_killed_process_left_is_named_with_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This user can neither lock nor remove it: to end a mission of its note helps nobody."""
    for number, vehicle in ((5, 0), (81, 1)):
        note_run(number, tmp_path, "auv1-1123-184534-3f2a", vehicle)
    _as_another_user(monkeypatch)
    left = r"{0} is left over from a process of \w+ that has ended\. Remove it: sudo rm {0}"
    with pytest.raises(DomainError, match=left.format(lock_file(81, 1))), vehicle_domain(81, 1, simulated=False):
        pass
    with pytest.raises(DomainError, match=left.format(lock_file(5))), simulator_domain("5"):
        pass
    with simulator_domain(None) as number:
        assert number != 5, "a free one is taken"


def test_a_lock_that_another_user_holds_names_the_mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with own_domain() as number:
        note_run(number, tmp_path, "sim-1123-184534-3f2a")
        _as_another_user(monkeypatch)
        with pytest.raises(DomainError, match="is in use by sim-1123-184534-3f2a"), simulator_domain(str(number)):
            pass
