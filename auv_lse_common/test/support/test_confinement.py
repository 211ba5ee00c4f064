"""The environment that keeps ROS traffic on this computer: what it holds, and the sockets of a participant in it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from auv_lse_common.support.confinement import (
    NETWORK_VARIABLES,
    ConfinementError,
    confine,
    confined,
    is_confined,
    reach,
    watch_variables,
)

BARE = {name: value for name, value in os.environ.items() if name not in NETWORK_VARIABLES}
OPEN = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
#: Without a ROS that is sourced, so that every middleware may be installed.
CYCLONE = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "AMENT_PREFIX_PATH": ""}


def test_nothing_named_means_this_computer() -> None:
    environment = confined(7, BARE)
    assert environment["ROS_DOMAIN_ID"] == "7"
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SYSTEM_DEFAULT", "which leaves the range to the profile"
    profile = Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"])
    addresses = {node.text for node in ElementTree.parse(profile).iter() if node.tag.endswith("address")}
    assert addresses & {"127.0.0.1"}
    assert is_confined(environment)
    assert not is_confined(BARE)
    assert confined(None, environment) == environment, "a child process gets the same"


def test_messages_name_the_network_in_which_nodes_are_looked_for(tmp_path: Path) -> None:
    assert reach(confined(7, BARE)) == "on this computer"
    assert reach(confined(7, BARE | OPEN)) == "through ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"
    peers, profile = {"ROS_STATIC_PEERS": "192.0.2.9"}, tmp_path / "own.xml"
    missing = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}
    assert reach(confined(7, BARE | peers | missing)) == "through ROS_STATIC_PEERS=192.0.2.9"
    profile.write_text("<profiles/>")
    shown = reach(confined(7, BARE | missing))
    assert shown == f"through FASTRTPS_DEFAULT_PROFILES_FILE={profile}", "once, though `confined` sets both names"


def test_cyclone_dds_needs_a_network_since_it_listens_on_every_one() -> None:
    with pytest.raises(ConfinementError, match=r"=rmw_cyclonedds_cpp: .* Unset it to use Fast DDS.* or name a network"):
        confined(7, BARE | CYCLONE)
    assert confined(None, BARE | CYCLONE | OPEN) == BARE | CYCLONE | OPEN
    own = BARE | CYCLONE | {"CYCLONEDDS_URI": "file:///etc/cyclone.xml"}
    assert confined(None, own) == own
    assert is_confined(confined(None, own | {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"})), "not Fast DDS's profile"


@pytest.mark.parametrize("other", [{}, {"ROS_STATIC_PEERS": "192.0.2.9"}, CYCLONE])
def test_a_range_in_which_no_nodes_find_each_other_is_refused(other: dict[str, str]) -> None:
    with pytest.raises(ConfinementError, match=r"^ROS_AUTOMATIC_DISCOVERY_RANGE=off: .* Unset it.* or set SUBNET"):
        confined(7, BARE | other | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "off"})


def test_a_middleware_that_is_not_installed_is_named_with_those_that_are(tmp_path: Path) -> None:
    for prefix, name in (("a", "rmw_fastrtps_cpp"), ("a", "rmw_implementation"), ("b", "rmw_zenoh_cpp")):
        resource = tmp_path / prefix / "share/ament_index/resource_index/rmw_typesupport" / name
        resource.parent.mkdir(parents=True, exist_ok=True)
        resource.touch()
    sourced = BARE | {"AMENT_PREFIX_PATH": f"{tmp_path / 'a'}:{tmp_path / 'b'}"}
    expected = (
        r"^RMW_IMPLEMENTATION=rmw_foo is not installed. Unset it, or choose one of rmw_fastrtps_cpp, rmw_zenoh_cpp$"
    )
    with pytest.raises(ConfinementError, match=expected):
        confined(7, sourced | OPEN | {"RMW_IMPLEMENTATION": "rmw_foo"})
    zenoh = confined(7, sourced | {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"})
    assert zenoh["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_an_unknown_middleware_searches_this_computer_only() -> None:
    environment = confined(7, BARE | CYCLONE | {"RMW_IMPLEMENTATION": "rmw_connextdds"})
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


@pytest.mark.parametrize("named", [OPEN, {"ROS_DISCOVERY_SERVER": "a:1"}])
def test_a_network_that_the_user_names_is_kept(named: dict[str, str]) -> None:
    environment = confined(None, BARE | named)
    assert environment == BARE | named
    assert not is_confined(environment)


def test_named_peers_open_no_more_than_the_peers() -> None:
    environment = confined(None, BARE | {"ROS_STATIC_PEERS": "192.0.2.9"})
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in environment
    both = BARE | OPEN | {"ROS_STATIC_PEERS": "192.0.2.9"}
    assert confined(None, both) == both


def test_a_profile_counts_if_it_is_there(tmp_path: Path) -> None:
    profile = tmp_path / "own.xml"
    named = BARE | {"FASTDDS_DEFAULT_PROFILES_FILE": str(profile)}
    assert is_confined(confined(None, named)), "without its profile Fast DDS listens on every address"
    profile.write_text("<profiles/>")
    assert confined(None, named)["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(profile), "Jazzy reads this name"


def test_a_wish_for_this_computer_is_served_by_the_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    for wish in ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1"}):
        environment = confined(None, BARE | wish)
        assert is_confined(environment)
        assert environment["ROS_LOCALHOST_ONLY"] == ""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    confine(9)
    assert is_confined(os.environ)
    assert os.environ["ROS_DOMAIN_ID"] == "9"


def test_another_terminal_is_told_the_range(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watch_variables(3) == "ROS_DOMAIN_ID=3 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
    monkeypatch.setenv("ROS_STATIC_PEERS", "192.0.2.9")
    assert watch_variables(3) == "ROS_DOMAIN_ID=3"


@pytest.mark.ros
def test_a_new_participant_announces_itself_often() -> None:
    """Newcomers drop answers to their own start, so they wait for the next announcement of each of the others.

    Fast DDS's default is 5 announcements, and one every 3 s after that.
    """
    program = "import rclpy\nrclpy.init()\nnode = rclpy.create_node('newcomer')\ninput()\n"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 7400 + 250 * 102 + 10 + 2 * 60))  # where a 60th participant of domain 102 would listen
        end.settimeout(30.0)
        with subprocess.Popen([sys.executable, "-c", program], env=confined(102, BARE), stdin=subprocess.PIPE) as node:
            try:
                end.recv(65536)
                began = time.monotonic()
                for _ in range(25):
                    end.recv(65536)
                assert time.monotonic() - began < 10.0
            finally:
                node.kill()
