"""The environment that keeps ROS traffic on this computer, unless the user names a network.

Everything that the project starts gets it before its middleware is loaded: missions, vehicles, launch files, nodes
started by `ros2 run`, viewers, inspection commands and tests. `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` alone does not
do this: it limits discovery, while Fast DDS still listens on every address. Cyclone DDS binds its receiving sockets to
every address whatever its profile says (seen with 11.0), so it is refused until the user names a network.
"""

import os
from collections.abc import Mapping
from pathlib import Path

#: Variables with which a user names a network for ROS, and those of one middleware's own profile.
RANGE_VARIABLES = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
FASTDDS_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
NETWORK_VARIABLES = (*RANGE_VARIABLES, *FASTDDS_VARIABLES, "CYCLONEDDS_URI")
#: Folder of the ament index with a file for each middleware.
_MIDDLEWARES = "share/ament_index/resource_index/rmw_typesupport"
_FASTDDS_PROFILE = Path(__file__).with_name("fastdds_localhost.xml")


class ConfinementError(ValueError):
    """ROS cannot run in the environment, or not without a network that the user does not name."""


def confined(domain: int | None = None, environment: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment of a process that takes part in ROS: its traffic stays on this computer.

    A range, peers, a discovery server or a profile of the user's own are kept as they are. Peers alone add only those
    peers: the subnet is not searched. The result is the same when this is called again with it.

    Args:
        domain: ROS domain; None: that of `environment`.
        environment: The environment to start from; None: this process's.

    Raises:
        ConfinementError: with Cyclone DDS, if no network is named; if discovery is off, or the middleware is not
            installed.
    """
    result = dict(os.environ if environment is None else environment)
    if domain is not None:
        result["ROS_DOMAIN_ID"] = str(domain)
    if (discovery := result.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")).upper() == "OFF":
        raise ConfinementError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE={discovery}: no node finds another one. Unset it to stay on this computer, "
            "or set SUBNET"
        )
    installed = _installed(result)
    if installed and result.get("RMW_IMPLEMENTATION") and _middleware(result) not in installed:
        raise ConfinementError(
            f"RMW_IMPLEMENTATION={_middleware(result)} is not installed. Unset it, or choose one of "
            f"{', '.join(installed)}"
        )
    if names_network(result):
        if result.get("ROS_STATIC_PEERS"):
            result["ROS_AUTOMATIC_DISCOVERY_RANGE"] = result.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "LOCALHOST"
        profile = next((result[name] for name in FASTDDS_VARIABLES if result.get(name)), "")
        # Fast DDS reads one of the names before release 3, and the other one since.
        return {**dict.fromkeys(FASTDDS_VARIABLES, profile), **result} if profile else result
    if "cyclonedds" in _middleware(result):
        raise ConfinementError(
            f"RMW_IMPLEMENTATION={result['RMW_IMPLEMENTATION']}: Cyclone DDS receives on every network, and no profile "
            "prevents that. Unset it to use Fast DDS, which stays on this computer, or name a network: "
            "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET, ROS_STATIC_PEERS or CYCLONEDDS_URI"
        )
    has_profile = "fastrtps" in _middleware(result)
    return result | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT" if has_profile else "LOCALHOST",
        "ROS_LOCALHOST_ONLY": "",  # Fast DDS would add a transport that listens on every address
        **dict.fromkeys(FASTDDS_VARIABLES, str(_FASTDDS_PROFILE)),
    }


def confine(domain: int | None = None) -> None:
    """Gives this process the environment of `confined`, with its errors. Call it before `rclpy.init`."""
    os.environ.update(confined(domain))


def names_network(environment: Mapping[str, str]) -> bool:
    """Whether the user names a range, peers, a discovery server or a profile, for the middleware in use.

    Of the ranges, SYSTEM_DEFAULT is left to a profile, which counts by itself. A profile whose file is missing does not
    count: Fast DDS would listen on every address without it.
    """
    if environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "SUBNET":
        return True
    if any(environment.get(name) for name in RANGE_VARIABLES[1:]):
        return True
    if "cyclonedds" in _middleware(environment):
        return bool(environment.get("CYCLONEDDS_URI"))
    profiles = {environment.get(name, "") for name in FASTDDS_VARIABLES} - {"", str(_FASTDDS_PROFILE)}
    return any(Path(profile).is_file() for profile in profiles)


def reach(environment: Mapping[str, str]) -> str:
    """Where ROS finds nodes with an environment, for messages: "on this computer", or through a named network."""
    if not names_network(environment):
        return "on this computer"
    ours = {"", "LOCALHOST", "SYSTEM_DEFAULT", str(_FASTDDS_PROFILE)}
    found: dict[str, str] = {}  # names by value: `confined` gives one profile two of them
    for name in NETWORK_VARIABLES:
        value = environment.get(name, "")
        if value not in ours and (name not in FASTDDS_VARIABLES or Path(value).is_file()):
            found.setdefault(value, name)
    return f"through {', '.join(f'{name}={value}' for value, name in found.items())}"


def watch_variables(domain: int) -> str:
    """The variables to export in another terminal so that its ROS commands find `domain`, in shell syntax."""
    is_local = is_confined(confined(domain))
    return f"ROS_DOMAIN_ID={domain}" + (" ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST" if is_local else "")


def is_confined(environment: Mapping[str, str]) -> bool:
    """Whether an environment keeps ROS traffic on this computer, as `confined` does without a named network."""
    return environment.get(FASTDDS_VARIABLES[0]) == str(_FASTDDS_PROFILE) and not names_network(environment)


def _installed(environment: Mapping[str, str]) -> list[str]:
    """The middlewares that the sourced ROS has; none if it is not known."""
    prefixes = [Path(prefix) for prefix in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    found = {file.name for prefix in prefixes for file in (prefix / _MIDDLEWARES).glob("rmw_*")}
    return sorted(found - {"rmw_implementation"})


def _middleware(environment: Mapping[str, str]) -> str:
    return environment.get("RMW_IMPLEMENTATION") or "rmw_fastrtps_cpp"
