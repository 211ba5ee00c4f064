"""Vehicles of real nodes (`auv_lse vehicle`) without hardware, for faults of their computers.

Each vehicle has a ROS domain of its own. The vehicles share nothing but the water, which carries their packets.
"""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.node.state_memory import forget_copy
from auv_lse_comms.packet.tag import Tagger
from auv_lse_comms.tdma import Tdma
from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from benchmarks.faults.bed.ledger import Ledger
from benchmarks.faults.kills import Program
from benchmarks.faults.sockets import family_of

if TYPE_CHECKING:
    from benchmarks.faults.bed.witness_node import Witness

#: The nodes of a vehicle.
NODES = ("gp_node", "safety_node", "planner_node", "modem_node")
#: A restarted node has to report within this time (s), a restarted computer within the other.
BACK_S, BOOTED_S = 10.0, 40.0
#: Area (m^2) for each leg of a mission.
LEG_AREA_M2 = 1400.0
#: Distance (m) between the starts of two vehicles.
APART_M = 20.0
_TDMA: dict[str, Any] = {"slot_s": 1.5, "guard_s": 0.05, "send_duration_s": 0.5, "max_range_m": 300.0}
_TAG_BYTES, _SESSION = 8, "faults"
#: Vehicles of the smallest mission: a vehicle alone would have no mate to send packets to.
_SMALLEST_TEAM = 2
#: Nodes that have not started after this time (s) never will.
_NEVER_S = 300.0


class Vehicle:
    """One vehicle's programs, and the witness of what they publish.

    Attributes:
        witness: The water around it.
        program: `auv_lse vehicle`; None between dives.
        out: Folder of its current dive.
    """

    def __init__(self, domain: int, witness: Witness) -> None:
        """Starts nothing yet."""
        self.number, self.witness = witness.vehicle, witness
        self.program: Program | None = None
        self.out = Path()
        self._domain = domain
        self._states: set[Path] = set()  # state files; a fault may delete them

    @property
    def running(self) -> Program:
        """Its programs; a dive must be under way."""
        assert self.program is not None
        return self.program

    def begin(self, file: Path, out: Path) -> None:
        """Begins a new dive of a mission file."""
        self._file, self.out = file, out
        self.witness.new_dive()
        self.launch()

    def launch(self) -> None:
        """Starts its programs, see `has_started`; in a dive that was not ended they continue it."""
        self.program = Program(
            "vehicle", f"auv{self.number}", str(self._file), "--out", str(self.out),
            "--domain", str(self._domain),
        )  # fmt: skip

    def has_started(self) -> bool:
        """Whether all nodes have started since `launch`.

        Raises:
            RuntimeError: if the command has ended instead.
        """
        if set(NODES) <= set(self.running.nodes):
            self._states |= set(self.out.glob("journal/*/*.state"))
            return True
        if self.running.process.poll() is not None:
            raise RuntimeError(f"auv_lse vehicle has not started its nodes: {''.join(self.running.text)[-2000:]}")
        return False

    def kill(self, node: str) -> None:
        """Kills one node."""
        self.witness.forget()
        pid = self.running.nodes.pop(node)  # until it is restarted
        os.kill(pid, signal.SIGKILL)
        _await_death(pid)
        self.witness.note_death()

    def cut_power(self) -> None:
        """Kills every program of the vehicle at once."""
        self.witness.forget()
        pids = sorted(self.pids())
        for pid in pids:  # parents first, so that none is restarted
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for pid in pids:
            _await_death(pid)
        self.end()
        self.witness.note_death()

    def end(self) -> None:
        """Ends the dive in an orderly way; its computer's memory is lost, as with a power loss."""
        if self.program is None:
            return
        if self.program.process.poll() is None:
            self.program.process.send_signal(signal.SIGTERM)
        self.program.wait(60.0)
        for path in self._states | set(self.out.glob("journal/*/*.state")):
            forget_copy(path)
        with contextlib.suppress(OSError), (self.out / "output").open("a") as output:
            output.write("".join(self.program.text))
        self.program = None

    def pids(self) -> list[int]:
        """Every process of the vehicle."""
        return list(family_of(self.running.process.pid))


def _await_death(pid: int) -> None:
    """Waits until a process that was killed can send nothing more."""
    until = time.monotonic() + _NEVER_S
    with contextlib.suppress(OSError):  # the process has ended
        while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX":
            if time.monotonic() > until:
                raise RuntimeError(f"process {pid} does not end although it was killed")
            time.sleep(0.001)


class DiveBed:
    """A team's dives in a folder.

    Attributes:
        vehicles: The vehicles that fly, by number.
        out: Folder of the current dive.
    """

    def __init__(self, folder: Path, vehicles: Mapping[int, Vehicle], key: Path) -> None:
        """Starts nothing yet."""
        self.vehicles = vehicles
        self.out = folder
        self._folder, self._key = folder, key
        self._dives = 0
        for sender in vehicles.values():
            sender.witness.send = partial(self._carry, sender.number)

    def _carry(self, source: int, payload: bytes) -> None:
        """Carries a packet to all mates."""
        for number, vehicle in self.vehicles.items():
            if number != source:
                vehicle.witness.receive(source, payload)

    def dive(
        self,
        after_reboot: str = "surface",
        steps: int = 500,
        speed_mps: float = 10.0,
        method: str = "plain",
        more: Mapping[str, Mapping[str, Any]] | None = None,
        runs: Path | None = None,
    ) -> None:
        """Begins a new dive, and waits until every vehicle is under way.

        Args:
            after_reboot: As `safety.after_reboot`.
            steps: Legs of the mission; the area has room for those of all vehicles.
            speed_mps: Speed of the vehicles.
            runs: Folder of the vehicles' run folders; None: beside the mission file.

        Raises:
            RuntimeError: if one does not get under way.
        """
        self.end()
        self._dives += 1
        self.out = self._folder / f"dive{self._dives}"
        self.out.mkdir(parents=True)
        half_m = max(400.0, 0.5 * math.sqrt(len(self.vehicles) * steps * LEG_AREA_M2))
        sections = {
            "mission": {"vehicles": max(_SMALLEST_TEAM, len(self.vehicles)), "steps": steps, "seed": 7},
            "area": {"polygon_m": [-half_m, -half_m, half_m, -half_m, half_m, half_m, -half_m, half_m]},
            "planner": {"method": method, "iterations": 10, "replan_lead_s": 0.5},
            "vehicle": {"depth_m": 3.0, "speed_mps": speed_mps, "start": "at_once"},
            "safety": {"after_reboot": after_reboot, "patience_s": 1.0, "state_copies": str(self.out / "copies")},
            "tdma": _TDMA,
            "packet": {"tag": True, "key_file": str(self._key), "tag_bytes": _TAG_BYTES, "session": _SESSION},
            **(more or {}),
        }
        patterns: dict[str, Any] = {"/**": {"ros__parameters": sections}}
        for number in self.vehicles:
            north_m, east_m = start_of(number)
            start = {"start_north_m": north_m, "start_east_m": east_m}
            patterns[f"/auv{number}/**"] = {"ros__parameters": {"vehicle": start}}
        file = self.out / "vehicles.yaml"
        file.write_text(yaml.safe_dump(patterns))
        for vehicle in self.vehicles.values():
            vehicle.begin(file, (runs or self.out) / f"auv{vehicle.number}")
        for vehicle in self.vehicles.values():
            self.start(vehicle)
        ledgers = [vehicle.witness.ledger for vehicle in self.vehicles.values()]
        if math.isnan(self.wait(lambda: all(ledger.last_step >= 1 for ledger in ledgers), _NEVER_S)):
            raise RuntimeError(f"a vehicle has not got under way; see the logs in {self.out}")

    def start(self, vehicle: Vehicle) -> None:
        """Waits until the nodes of a vehicle have started; launches it first if it is not running.

        Raises:
            RuntimeError: if they do not start.
        """
        if vehicle.program is None:
            vehicle.launch()
        if math.isnan(self.wait(vehicle.has_started, _NEVER_S)):
            raise RuntimeError(f"the nodes of auv{vehicle.number} have not started; see {vehicle.out / 'logs'}")

    def wait(self, condition: Callable[[], Any], seconds: float) -> float:
        """Moves the vehicles until `condition` holds; returns how long it took (s), NaN if it does not in time."""
        began = time.monotonic()
        while not condition():
            if time.monotonic() - began > seconds:
                return math.nan
            for vehicle in self.vehicles.values():
                vehicle.witness.spin(0.02 / len(self.vehicles))
        return time.monotonic() - began

    def spend(self, seconds: float) -> None:
        """Moves the vehicles for a time (s)."""
        self.wait(lambda: False, seconds)

    def obeys(self, order: str) -> bool:
        """Orders vehicle 1 to "HOLD" or "ABORT", or "" nothing; returns whether it obeys in time."""
        from auv_lse_msgs.msg import MissionCommand, MissionState

        if not order:
            return True
        water = self.vehicles[1].witness
        water.order(getattr(MissionCommand, order))
        wanted = MissionState.ABORTED if order == "ABORT" else MissionState.HOLDING
        return not math.isnan(self.wait(lambda: water.is_in(wanted), 5.0))

    def resume(self) -> bool:
        """Resets and resumes the mission of vehicle 1; returns whether steps are decided again."""
        from auv_lse_msgs.msg import MissionCommand, MissionState

        water = self.vehicles[1].witness
        for command, state in ((MissionCommand.RESET, MissionState.HOLDING), (MissionCommand.GO, MissionState.RUNNING)):
            if not water.is_in(MissionState.RUNNING):
                water.order(command)
                self.wait(partial(water.is_in, state), 5.0)
        step = water.ledger.last_step
        return not math.isnan(self.wait(lambda: water.ledger.last_step > step, 10.0))

    def end(self) -> None:
        """Ends the dive in an orderly way."""
        for vehicle in self.vehicles.values():
            vehicle.end()


def start_of(vehicle: int) -> tuple[float, float]:
    """Where a vehicle starts: north and east (m)."""
    return 0.0, APART_M * (vehicle - 1)


@contextmanager
def dive_bed(folder: Path, vehicles: int = 1) -> Iterator[DiveBed]:
    """A context with a bed of vehicles, each in a ROS domain of its own; they end with it."""
    from benchmarks.faults.bed.witness_node import Witness  # ROS: only these faults need it

    folder.mkdir(parents=True)
    secret = secrets.token_bytes(32)
    key = folder / "key"
    key.touch(0o600)
    key.write_text(secret.hex())
    tagger = Tagger(secret, _TAG_BYTES, _SESSION)
    team: dict[int, Vehicle] = {}
    with ExitStack() as kept:
        for k in range(1, vehicles + 1):
            domain = kept.enter_context(own_domain(VEHICLE_DOMAINS))
            slots = Tdma(TdmaConfig(**_TDMA), k, max(_SMALLEST_TEAM, vehicles))
            witness = kept.enter_context(Witness(k, domain, start_of(k), Ledger(k, slots, tagger)))
            team[k] = Vehicle(domain, witness)
        bed = DiveBed(folder, team, key)
        try:
            yield bed
        finally:
            bed.end()
