"""ROS domains of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from auv_lse_common.process import domain
from auv_lse_common.process.domain import (
    DomainError,
    busy_domains,
    domain_number,
    local_environment,
    lock_file,
    node_environment,
    own_domain,
    taken_domain,
)


@pytest.fixture(autouse=True)
def _locks_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domain.tempfile, "gettempdir", lambda: str(tmp_path))


def test_no_two_missions_get_the_same_domain_and_busy_ones_are_found() -> None:
    assert busy_domains() == []
    with own_domain() as first, own_domain() as second, taken_domain(150) as third:
        assert first != second
        assert busy_domains() == sorted((first, second, third))
        with pytest.raises(DomainError, match=rf"ROS domain {first}: another mission"), taken_domain(first):
            pass
    assert busy_domains() == []


def test_a_lock_on_a_file_that_was_removed_meanwhile_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    lock, removed = domain.fcntl.flock, []

    def slow(file: Any, how: int) -> None:
        if not removed:  # the mission before ends between opening and locking: its file goes, and others make a new one
            removed.append(True)
            lock_file(7).unlink()
        lock(file, how)

    monkeypatch.setattr(domain.fcntl, "flock", slow)
    with pytest.raises(DomainError, match="ROS domain 7"), taken_domain(7):
        pass
    with taken_domain(7):
        assert busy_domains() == [7]


def test_all_domains_taken_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domain, "DOMAINS", range(5, 6))
    with own_domain() as only:
        assert only == 5
        with pytest.raises(DomainError, match=r"all ROS domains 5\.\.5 are in use"), own_domain():
            pass


@pytest.mark.parametrize("text", ["", "-1", "233", "1.5", "x"])
def test_a_domain_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(DomainError, match="expected a whole number from 0 to 232"):
        domain_number(text)
    assert domain_number("17") == 17


def test_environments(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "3")
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE", raising=False)
    assert node_environment()["ROS_DOMAIN_ID"] == "3"
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in node_environment(5)
    local = local_environment(tmp_path, 5)
    assert local["ROS_DOMAIN_ID"] == "5"
    assert local["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(tmp_path / "config" / "fastdds_localhost.xml")


def test_a_vehicle_keeps_to_its_machine_unless_the_user_says_otherwise(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in (*domain.RANGE_VARIABLES, "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)
    alone = domain.vehicle_environment(tmp_path, 7)
    assert alone["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(tmp_path / "config" / "fastdds_localhost.xml")
    assert (alone["ROS_AUTOMATIC_DISCOVERY_RANGE"], alone["ROS_DOMAIN_ID"]) == ("SYSTEM_DEFAULT", "7")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    assert domain.vehicle_environment(tmp_path, 7)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    asked = domain.vehicle_environment(tmp_path, 7)
    assert asked["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in asked
