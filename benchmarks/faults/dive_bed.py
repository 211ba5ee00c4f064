"""One vehicle of real nodes (`scripts/vehicle`) without hardware, for faults of its computer."""

from __future__ import annotations

import contextlib
import math
import os
import re
import secrets
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.process.domain import VEHICLE_DOMAINS, own_domain
from auv_lse_comms.packet.tag import Tagger
from benchmarks.faults.kills import Program
from benchmarks.faults.sockets import family_of

if TYPE_CHECKING:
    from benchmarks.faults.witness_node import Witness

#: The nodes of the vehicle.
NODES = ("gp_node", "safety_node", "planner_node", "modem_node")
#: A restarted node has to report within this time (s), a restarted computer within the other.
BACK_S, BOOTED_S = 10.0, 40.0
#: Area (m^2) for each leg of the default mission.
LEG_AREA_M2 = 1400.0
_TDMA = {"slot_s": 1.5, "guard_s": 0.05, "send_duration_s": 0.5, "max_range_m": 300.0}
_TAG_BYTES, _SESSION = 8, "faults"


class DiveBed:
    """A vehicle's dives in a folder, and their witness."""

    def __init__(self, folder: Path, domain: int, witness: Witness, key: Path, say: Callable[[str], None]) -> None:
        """Starts nothing yet."""
        self.witness = witness
        self.say = say
        self.program: Program | None = None
        self.out = folder
        self._folder, self._domain, self._key = folder, domain, key
        self._dives = 0

    def dive(
        self, after_reboot: str = "surface", steps: int = 500, speed_mps: float = 10.0, method: str = "plain"
    ) -> None:
        """Begins a new dive, and waits until the vehicle is under way.

        Args:
            after_reboot: As `safety.after_reboot`.
            steps: Legs of the mission; the area has room for them.
            speed_mps: Speed of the vehicle.
            method: Planning method.

        Raises:
            RuntimeError: if it does not get under way.
        """
        self.end()
        self._dives += 1
        self.out = self._folder / f"dive{self._dives}"
        self.out.mkdir(parents=True)
        half_m = max(400.0, 0.5 * math.sqrt(steps * LEG_AREA_M2))
        sections = {
            "mission": {"vehicles": 2, "steps": steps, "seed": 7},
            "area": {"polygon_m": [-half_m, -half_m, half_m, -half_m, half_m, half_m, -half_m, half_m]},
            "planner": {"method": method, "iterations": 10, "replan_lead_s": 0.5},
            "vehicle": {"depth_m": 3.0, "speed_mps": speed_mps, "start": "at_once"},
            "safety": {"after_reboot": after_reboot, "patience_s": 1.0},
            "tdma": _TDMA,
            "packet": {"tag": True, "key_file": str(self._key), "tag_bytes": _TAG_BYTES, "session": _SESSION},
        }
        (self.out / "vehicles.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": sections}}))
        self.witness.new_dive()
        self.start()
        if not self.witness.wait(lambda: self.witness.last_step >= 1, 60.0) < 60.0:
            raise RuntimeError(f"the vehicle has not got under way; see {self.out / 'logs'}")

    def start(self) -> None:
        """Starts the vehicle's programs, and waits for all its nodes; in a dive that was not ended continues it.

        Raises:
            RuntimeError: if they do not start.
        """
        self.program = Program(
            "auv_lse_common.commands.vehicle", "auv1", str(self.out / "vehicles.yaml"), "--out", str(self.out),
            "--domain", str(self._domain),
        )  # fmt: skip
        nodes = set(NODES)
        program = self.program
        self.witness.wait(lambda: nodes <= set(program.nodes) or program.process.poll() is not None, 120.0)
        if not nodes <= set(program.nodes):
            raise RuntimeError(f"scripts/vehicle has not started its nodes: {''.join(program.text)[-2000:]}")
        if match := re.search(r"dive (auv1-\S+?)[,;]", "".join(program.text)):
            self.witness.dive = match[1]

    def kill(self, node: str) -> None:
        """Kills one node."""
        assert self.program is not None
        os.kill(self.program.nodes[node], signal.SIGKILL)

    def cut_power(self) -> None:
        """Kills every program of the vehicle at once."""
        assert self.program is not None
        for pid in sorted(family_of(self.program.process.pid)):  # parents first, so that none is restarted
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.program.wait(20.0)
        self.end()

    def end(self) -> None:
        """Ends the dive in an orderly way."""
        if self.program is None:
            return
        if self.program.process.poll() is None:
            self.program.process.send_signal(signal.SIGTERM)
            self.program.wait(40.0)
        with (self.out / "output").open("a") as output:
            output.write("".join(self.program.text))
        self.program = None

    def pids(self) -> list[int]:
        """Every process of the vehicle."""
        assert self.program is not None
        return list(family_of(self.program.process.pid))


@contextmanager
def dive_bed(folder: Path, say: Callable[[str], None]) -> Iterator[DiveBed]:
    """A bed on a ROS domain of its own; its vehicle is ended with the context."""
    from benchmarks.faults.witness_node import Witness  # ROS: only these faults need it

    folder.mkdir(parents=True)
    secret = secrets.token_bytes(32)
    key = folder / "key"
    key.touch(0o600)
    key.write_text(secret.hex())
    tagger = Tagger(secret, _TAG_BYTES, _SESSION)
    with own_domain(VEHICLE_DOMAINS) as domain, Witness(domain, TdmaConfig(**_TDMA), tagger) as witness:
        bed = DiveBed(folder, domain, witness, key, say)
        try:
            yield bed
        finally:
            bed.end()
