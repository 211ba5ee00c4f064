"""The fleet file: which vehicles there are, and how they are reached."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import read_yaml
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.vocabulary.vehicle_name import vehicle_names
from auv_lse_run.process.domain import VEHICLE_DOMAINS

#: What `auv_lse fleet init` writes without arguments: hosts as `~/.ssh/config` may name them.
DEFAULT_HOSTS = ("auv1", "auv2")
_HEAD = """\
# The vehicles of auv_lse fleet (docs/guide/field-day.md). For each, with defaults in brackets:
#   host     name or address; a Host of ~/.ssh/config is one, too
#   user     who logs in [as ~/.ssh/config says, else you]
#   port     port of SSH [as ~/.ssh/config says, else 22]
#   folder   folder on the vehicle for mission file and dives [auv_lse, below the user's home]
#   command  how auv_lse is called there [auv_lse]; examples:
#            checkout:  /opt/auv_lse/scripts/auv_lse
#            venv:      ~/venv/bin/auv_lse
#            colcon:    . /opt/ros/jazzy/setup.sh && . ~/ros_ws/install/setup.sh && auv_lse
#            container: docker exec -i -u auv auv_lse auv_lse
#   domain   ROS domain [80 plus the vehicle's number]
# ssh_config: another file than ~/.ssh/config
"""


class FleetFileError(ValueError):
    """The fleet file is wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteVehicle:
    """A vehicle and how it is reached.

    Attributes:
        name: "auv2".
        host: Name or address, or a Host of the SSH configuration.
        user: Who logs in; "": as SSH is configured.
        port: Port of SSH; 0: as SSH is configured.
        command: Shell text that runs auv_lse there.
        domain: ROS domain of its nodes.
    """

    name: str
    host: str
    user: str = ""
    port: int = 0
    folder: str = "auv_lse"
    command: str = "auv_lse"
    domain: int = 0

    @property
    def number(self) -> int:
        """Its number: 2 for auv2."""
        return int(self.name.removeprefix("auv"))

    @property
    def address(self) -> str:
        """As people write it: auv@auv2.local."""
        return f"{self.user}@{self.host}" if self.user else self.host

    @property
    def login(self) -> str:
        """The command with which a person logs in."""
        return f"ssh{f' -p {self.port}' if self.port else ''} {self.address}"


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetFile:
    """A fleet file's content.

    Attributes:
        vehicles: In order of their numbers.
        ssh_config: SSH's configuration; None: SSH's own default.
    """

    path: Path
    vehicles: tuple[RemoteVehicle, ...]
    ssh_config: Path | None = None

    def chosen(self, names: list[str]) -> list[RemoteVehicle]:
        """The vehicles with these names, as people type them (`vehicle_name`); all for none, or for `all`.

        Raises:
            FleetFileError: if one is not in the file.
        """
        known, wanted = {vehicle.name: vehicle for vehicle in self.vehicles}, vehicle_names(names)
        if not wanted:
            return list(self.vehicles)
        for name in wanted:
            if name not in known:
                raise FleetFileError(f"{name} is not in {self.path}, which has {', '.join(known)}.")
        return [known[name] for name in wanted]


def refuse_folder(path: Path) -> None:
    """Checks that a path is not a folder.

    Raises:
        FleetFileError: with the cure.
    """
    if path.is_dir():
        raise FleetFileError(f"{path} is a folder. Name the fleet file in it, such as {path / 'fleet.yaml'}.")


def read_fleet(path: Path) -> FleetFile:
    """Reads a fleet file.

    Raises:
        FleetFileError: naming the wrong key and value.
    """
    refuse_folder(path)
    if not path.is_file():
        raise FleetFileError(
            f"{path}: there is no such file. Write one: auv_lse fleet {shlex.quote(str(path))} init USER@HOST ..."
        )
    try:
        found = read_yaml(path)
    except ParameterError as error:
        raise FleetFileError(str(error)) from error
    if not isinstance(found, dict) or not isinstance(found.get("vehicles"), dict) or not found["vehicles"]:
        raise FleetFileError(f"{path}: the key 'vehicles' is missing; under it, write each vehicle with its host.")
    for key in found:
        if key not in ("vehicles", "ssh_config"):
            raise FleetFileError(f"{path}: {key!r} is not known. The keys are 'vehicles' and 'ssh_config'.")
    vehicles = [_vehicle(path, str(name), values or {}) for name, values in found["vehicles"].items()]
    config = found.get("ssh_config")
    if config is not None:
        config = path.parent / Path(str(config)).expanduser()
        if not config.is_file():
            raise FleetFileError(f"{path}: ssh_config: there is no file {config}.")
    vehicles.sort(key=lambda vehicle: vehicle.number)
    return FleetFile(path=path, vehicles=tuple(vehicles), ssh_config=config)


_KINDS: dict[str, type] = {"host": str, "user": str, "port": int, "folder": str, "command": str, "domain": int}
_KIND_NAMES = {str: "a text", int: "a whole number"}


def _vehicle(path: Path, name: str, values: Any) -> RemoteVehicle:
    where = f"{path}: {name}"
    if not re.fullmatch(r"auv([1-9]\d{0,2})", name) or int(name[3:]) > 255:
        raise FleetFileError(f"{where} is not a vehicle's name. Names are auv1 to auv255.")
    if not isinstance(values, dict) or not values.get("host"):
        raise FleetFileError(f"{where}: the key 'host' is missing.")
    for key, value in values.items():
        if key not in _KINDS:
            raise FleetFileError(f"{where}: {key!r} is not known. The keys are {', '.join(_KINDS)}.")
        if type(value) is not _KINDS[key]:
            raise FleetFileError(f"{where}: {key} is {value!r}; write {_KIND_NAMES[_KINDS[key]]}.")
    if not 0 <= values.get("port", 0) <= 65535:
        raise FleetFileError(f"{where}: port is {values['port']}; ports are 1 to 65535.")
    for key in ("host", "user"):
        if str(values.get(key, "")).startswith("-") or re.search(r"\s", str(values.get(key, ""))):
            raise FleetFileError(f"{where}: {key} is {values[key]!r}; it has a space, or begins with a dash.")
    domain = values.get("domain", VEHICLE_DOMAINS[0] - 1 + int(name[3:]))
    if not 0 <= domain <= 232:
        raise FleetFileError(f"{where}: domain is {domain}; ROS domains are 0 to 232.")
    return RemoteVehicle(name=name, **{**values, "domain": domain})


def fleet_text(hosts: list[str]) -> str:
    """The text of a new fleet file.

    Args:
        hosts: As SSH takes them, in order of the vehicles' numbers: USER@HOST, HOST, USER@HOST:PORT.

    Raises:
        FleetFileError: if one cannot be read.
    """
    lines = [_HEAD, "vehicles:\n"]
    for number, text in enumerate(hosts or DEFAULT_HOSTS, 1):
        match = re.fullmatch(r"(?:([^@:\s]+)@)?(\[[^\]]+\]|[^@:\s]+)(?::(\d+))?", text)
        if match is None:
            raise FleetFileError(f"{text!r} is not a host. Write USER@HOST, or USER@HOST:PORT.")
        user, host, port = match.groups()
        lines.append(f"  auv{number}:\n    host: {host.strip('[]')!r}\n".replace("'", '"'))
        lines.append(f'    user: "{user}"\n' if user else "")
        lines.append(f"    port: {port}\n" if port else "")
    return "".join(lines)
