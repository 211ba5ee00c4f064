"""Starts and ends the process of a vehicle's dive, `auv_lse vehicle`, which outlives the session."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_run.process.domain import vehicle_on
from auv_lse_run.remote.orders import ACTED, REFUSED, SILENT
from auv_lse_run.vehicle.run_vehicle import open_dive, vehicle_number

#: Name of the mission file in a vehicle's folder, and of the folder of its dives.
MISSION, DIVES = "mission.yaml", "dives"
#: Time (s) for a start to reserve its domain and for its nodes to be ready, and for nodes and recorder to end.
_START_S, _STOP_S = 15.0, 25.0
_STEP_S = 0.1
#: Nodes that every vehicle has.
_NODES = ("safety_node", "gp_node", "planner_node")


def start(folder: Path, name: str, domain: int) -> tuple[str, str]:
    """Starts a vehicle's nodes, or continues a dive that was not ended; returns outcome and text.

    Args:
        folder: The vehicle's folder, with the mission file.
        name: The vehicle, "auv2".
    """
    number = vehicle_number(name)
    if (running := vehicle_on(domain, number)) is not None:
        return ACTED, f"its nodes run already (dive {running[1]})"
    mission = folder / MISSION
    if not mission.is_file():
        return REFUSED, f"there is no mission file in {folder}; send one first: auv_lse fleet FILE send MISSION.yaml"
    try:
        out = _dive_to_continue(folder, name, mission) or folder / DIVES / f"{datetime.now():%Y-%m-%d-%H%M%S}-{name}"
        out.parent.mkdir(exist_ok=True)
        log, logged = out.with_suffix(".start.log"), _sizes(out, name)
        arguments = ("vehicle", name, str(mission), "--out", str(out), "--domain", str(domain), "--wait")
        with log.open("w") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "auv_lse_run", *arguments],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
    except (OSError, ParameterError) as error:
        return REFUSED, f"its nodes cannot be started: {error}"
    end_s = time.monotonic() + _START_S
    while time.monotonic() < end_s and process.poll() is None:
        if vehicle_on(domain, number) is not None and _are_ready(out, name, logged):
            break
        time.sleep(_STEP_S)
    if process.poll() is not None:
        lines = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
        errors = [line.strip() for line in lines if "error: " in line]
        why = [*errors[:1], *lines[-1:], f"exit code {process.returncode}"][0]
        return REFUSED, f"its nodes did not start: {why}"
    if vehicle_on(domain, number) is not None:
        return ACTED, f"its nodes start, in {out.name}"
    return SILENT, f"its nodes have not started within {_START_S:g} s; see {log}"


def _sizes(out: Path, name: str) -> dict[Path, int]:
    """The size (bytes) of each log of a vehicle's nodes; a recorder, which logs something else, is left out."""
    logs = (path for path in (out / "logs").glob(f"{name}.*.log") if "recorder" not in path.name)
    return {path: path.stat().st_size for path in logs}


def _are_ready(out: Path, name: str, before: Mapping[Path, int]) -> bool:
    """Whether all nodes have logged that they are ready since their logs had the sizes `before`."""
    try:
        sizes = _sizes(out, name)
        if not {f"{name}.{node}.log" for node in _NODES} <= {path.name for path in sizes}:
            return False
        old = {path: before.get(path, 0) for path in sizes}
        old = {path: size if size <= sizes[path] else 0 for path, size in old.items()}  # 0: it was started over
        return all(b" ready after " in path.read_bytes()[size:] for path, size in old.items())
    except OSError:
        return False


def stop(name: str, domain: int) -> tuple[str, str]:
    """Ends a vehicle's nodes, the recorder last; returns outcome and text."""
    number = vehicle_number(name)
    running = vehicle_on(domain, number)
    if running is None:
        return ACTED, "its nodes do not run"
    pid = running[2]
    if not pid:
        return REFUSED, "the process that keeps its nodes running is not known; end it on the vehicle"
    try:
        os.kill(pid, signal.SIGTERM)
    except ProcessLookupError:
        pass
    except PermissionError:
        return REFUSED, f"its nodes belong to another user (process {pid}); end them there"
    end_s = time.monotonic() + _STOP_S
    while time.monotonic() < end_s:
        if vehicle_on(domain, number) is None:
            return ACTED, "its nodes have ended"
        time.sleep(_STEP_S)
    return SILENT, f"its nodes have not ended within {_STOP_S:g} s"


def _dive_to_continue(folder: Path, name: str, mission: Path) -> Path | None:
    """The newest dive of this vehicle, if it was not ended: as after a reboot."""
    dives = sorted(path for path in (folder / DIVES).glob(f"*-{name}") if path.is_dir())
    if not dives or not (dives[-1] / f"{name}.dive").exists():
        return None
    record, out = open_dive(name, mission, dives[-1], folder / DIVES, False)
    return out if record.continued is not None or record.doubt else None
