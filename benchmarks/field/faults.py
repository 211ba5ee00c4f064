"""Ten faults of a field day, each injected into a fleet of three, and what check or watch prints about it."""

import contextlib
import io
import json
import os
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_run.command.main import main
from benchmarks.field.side import CLOCK, STATE
from benchmarks.field.sshd import Field, free_port, side_command

_MISSION = """\
/**:
  ros__parameters:
    mission: {vehicles: 3}
    packet: {tag: true, key_file: team.key, session: field}
"""
_GOOD: dict[str, Any] = {
    "mission": {"state": "WAITING", "reason": "waits for GO", "limits": [], "warnings": [], "age_s": 0.5},
    "position": {"north_m": 1.0, "east_m": 2.0, "depth_m": 0.1, "speed_mps": 0.0, "age_s": 0.1},
    "autopilot": {"heard": True, "armed": True, "battery": 0.9, "age_s": 0.5},
    "path": None,
    "health": [],
}


class Team:
    """Three vehicles, ready for a dive: their folders, and their entries in the fleet file."""

    def __init__(self, folder: Path, field: Field, port: int) -> None:
        """Makes the folders, and sends the mission.

        Args:
            folder: For the laptop's files.
            port: Of the sshd that answers for all vehicles.
        """
        self.field = field
        self.folders = [folder / f"auv{k}" for k in (1, 2, 3)]
        self.entries: dict[str, dict[str, object]] = {}
        for k, own in enumerate(self.folders, 1):
            own.mkdir(parents=True)
            self.entries[f"auv{k}"] = {
                "port": port,
                "folder": str(own),
                "command": side_command("benchmarks.field.side"),
            }
        (folder / "team.key").write_text("ab" * 32)
        (folder / "team.key").chmod(0o600)
        (folder / "vehicles.yaml").write_text(_MISSION)
        self._name = f"{folder.name}.yaml"
        self.said = self.fleet("send", str(folder / "vehicles.yaml"))
        for own in self.folders:
            self.write_state(own, _GOOD)

    def write_state(self, folder: Path, state: dict[str, Any]) -> None:
        """Makes the nodes of a vehicle report a state."""
        (folder / STATE).write_text(json.dumps(state))

    def fleet(self, *words: str) -> str:
        """Runs `auv_lse fleet`; returns its output."""
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            main(["fleet", str(self.field.fleet_file(self.entries, self._name)), *words])
        return text.getvalue()


@dataclass(frozen=True, slots=True)
class FieldFault:
    """A fault.

    Attributes:
        inject: Puts it into a team that is ready; a context while it lasts.
        words: Words that the output must have.
        verb: The command that has to name it.
    """

    inject: Callable[[Team], contextlib.AbstractContextManager[None]]
    words: tuple[str, ...]
    verb: tuple[str, ...] = ("check", "--quick")


Injector = Callable[[Team], None]


def _once(inject: Injector) -> Callable[[Team], contextlib.AbstractContextManager[None]]:
    @contextlib.contextmanager
    def lasting(team: Team) -> Iterator[None]:
        inject(team)
        yield

    return lasting


def _modem_dead(team: Team) -> None:
    for own in team.folders:
        (own / STATE).unlink()  # no nodes: the check opens the modem itself
        mission = own / "mission.yaml"
        mission.write_text(_MISSION + f'    modem: {{kind: micromodem, port: "tcp://127.0.0.1:{free_port()}"}}\n')


def _clock_off(team: Team) -> None:
    (team.folders[1] / CLOCK).write_text("7.5")


def _wrong_file(team: Team) -> None:
    (team.folders[2] / "mission.yaml").write_text(_MISSION.replace("vehicles: 3", "vehicles: 3, steps: 9"))


@contextlib.contextmanager
def _full_disk(team: Team) -> Iterator[None]:
    """The folder of auv2 is a file system of 1 MB, which needs root; without, its mission wants more space."""
    own, mission = team.folders[1], (team.folders[1] / "mission.yaml").read_text()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(own)]
    if os.geteuid() == 0 and subprocess.run(mount, check=False, capture_output=True).returncode == 0:
        try:
            (own / "mission.yaml").write_text(mission)
            (own / "filling").write_bytes(bytes(900_000))
            team.write_state(own, _GOOD)
            yield
        finally:
            subprocess.run(["umount", str(own)], check=True)
    else:
        (own / "mission.yaml").write_text(mission + "    record: {least_free_mb: 1.0e+12}\n")
        yield


def _no_fix(team: Team) -> None:
    team.write_state(team.folders[0], {**_GOOD, "position": None})


def _battery(team: Team) -> None:
    team.write_state(team.folders[0], {**_GOOD, "autopilot": {**_GOOD["autopilot"], "battery": 0.15}})


def _silent(team: Team) -> None:
    team.entries["auv3"]["port"] = free_port()


def _one_number(team: Team) -> None:
    team.entries["auv3"]["folder"] = str(team.folders[1])


def _key_missing(team: Team) -> None:
    (team.folders[1] / "team.key").unlink()


def _old_version(team: Team) -> None:
    old = team.folders[0] / "old_auv_lse"
    old.write_text(
        "#!/bin/sh\necho 'error: auv_lse has no verb vehicle-side. List the verbs: auv_lse --help' >&2\nexit 2\n"
    )
    old.chmod(0o755)
    team.entries["auv1"]["command"] = str(old)


#: The faults, by the names of the page on the field day.
FAULTS: dict[str, FieldFault] = {
    "modem dead": FieldFault(_once(_modem_dead), ("modem: ",), ("check",)),
    "clock off": FieldFault(_once(_clock_off), ("auv2: its clock is +7.5",)),
    "wrong file": FieldFault(_once(_wrong_file), ("auv3: its mission file",)),
    "full disk": FieldFault(_full_disk, ("auv2: its disk has",)),
    "no fix": FieldFault(_once(_no_fix), ("auv1: it has no position",)),
    "battery": FieldFault(_once(_battery), ("auv1: its battery has 15 % left",)),
    "vehicle silent": FieldFault(_once(_silent), ("auv3: Its computer answers, but SSH does not run",)),
    "two with one number": FieldFault(_once(_one_number), ("auv3: its folder is that of auv2",)),
    "key missing": FieldFault(_once(_key_missing), ("auv2: the file of packet.key_file is missing",)),
    "old version": FieldFault(_once(_old_version), ("auv1: An old version of auv_lse is there",)),
}


@contextlib.contextmanager
def team_on_deck(folder: Path) -> Iterator[Callable[[str], Team]]:
    """A context with a maker of teams, each in a folder of its own, behind one sshd."""
    field = Field(folder)
    with field.computer("deck") as computer:
        field.trust("deck", computer.port)
        yield lambda name: Team(folder / name.replace(" ", "-"), field, computer.port)


def printed(fault: FieldFault, team: Team) -> str:
    """The output about a team with a fault."""
    with fault.inject(team):
        return team.fleet(*fault.verb)
