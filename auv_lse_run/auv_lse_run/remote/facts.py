"""What a vehicle reports about itself before a dive: software, disk, files, domain, and what its own checks find."""

import hashlib
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.installed_copy import commit_of, copy_of
from auv_lse_common.support.missing_packages import is_installed
from auv_lse_common.support.plurals import counted
from auv_lse_run.process.domain import has_participants, vehicle_on
from auv_lse_run.remote.dive_process import MISSION
from auv_lse_run.remote.vehicle_folder import VehicleFolder, sha256_of

#: Longest time (s) of one of the vehicle's own checks.
_CHECK_S = 45.0
#: First words of the lines in which those checks report an error, a warning or a missing part, with their levels.
_LEVELS = {"error": "error", "warning": "warning", "MISSING": "error", "error:": "error"}


def facts(folder: VehicleFolder, number: int, domain: int, thorough: bool) -> dict[str, Any]:
    """The answer to a laptop's request for facts before a dive.

    Args:
        thorough: Whether the vehicle's own checks run, which ask its devices for up to 45 s.
    """
    copy = copy_of("auv_lse_common")
    running = vehicle_on(domain, number)
    problem = folder.problem()
    is_file = (folder.folder / MISSION).is_file()
    return {
        "identity": _identity(folder.folder),
        "owner": folder.owner(),
        "mission": _mission(folder.folder / MISSION, number) if is_file else {},
        "version": "?" if copy is None else copy.version,
        "commit": commit_of(copy.folder) if copy is not None and copy.kind == "checkout" else "",
        "problem": problem,
        "free_mb": shutil.disk_usage(folder.folder).free / 1e6 if folder.folder.is_dir() else 0.0,
        "hashes": {} if problem else folder.hashes([MISSION]),
        "has_ros": is_installed("rclpy") and is_installed("auv_lse_msgs"),
        "running": None if running is None else {"folder": running[0], "dive": running[1]},
        "domain_in_use": running is None and has_participants(domain),
        "findings": own_checks(folder.folder / MISSION, number, running is not None) if thorough and is_file else [],
    }


def _identity(folder: Path) -> str:
    """An identifier that no other folder on any computer has; "" if the folder is missing."""
    try:
        machine = Path("/etc/machine-id").read_text().strip()
    except OSError:
        machine = platform.node()
    try:
        status = folder.stat()
    except OSError:
        return ""
    return hashlib.sha256(f"{machine} {status.st_dev} {status.st_ino}".encode()).hexdigest()[:16]


def _mission(file: Path, number: int) -> dict[str, Any]:
    """What the mission file on this vehicle sets for the team, and the hashes of the files that it names."""
    try:
        settings = Settings.load(file)
        safety = section(
            SafetyConfig, parameters_for(read_parameter_file(file), f"/auv{number}/s"), "safety", str(file)
        )
    except ParameterError as error:
        return {"error": str(error)}
    if number > settings.mission.vehicles:
        return {"error": f"{file} has {counted(settings.mission.vehicles, 'vehicle')}, and this is auv{number}"}
    own = settings.vehicle(number)
    named = {
        "packet.key_file": settings.packet.key_file if settings.packet.tag else "",
        "link.key_file": own.link.key_file,
        "gp.survey_file": own.gp.survey_file,
    }
    hashes = {}
    for parameter, name in named.items():
        path = file.parent / name
        if name:
            hashes[parameter] = sha256_of(path) if path.is_file() else ""
    return {
        "guard_s": settings.tdma.guard_s,
        "min_battery": safety.min_battery,
        "least_free_mb": settings.record.least_free_mb,
        "hashes": hashes,
    }


def own_checks(mission: Path, number: int, is_running: bool) -> list[dict[str, str]]:
    """What the checks on the vehicle find, each with its part ("mission file", "autopilot", "modem"), level and text.

    Args:
        is_running: Whether its nodes run; they then use autopilot and modem themselves.
    """
    calls: dict[str, Sequence[str]] = {}
    if is_installed("auv_lse_shore"):
        calls["mission file"] = ("check", str(mission), "--vehicle", f"auv{number}", "--quiet")
    try:
        own = parameters_for(read_parameter_file(mission), f"/auv{number}/settings")
        link, modem = section(LinkConfig, own, "link", str(mission)), section(ModemConfig, own, "modem", str(mission))
    except ParameterError as error:
        return [{"part": "mission file", "level": "error", "text": str(error)}]
    if link.kind == "mavlink" and not is_running:
        key = ("--key", link.key_file) if link.key_file else ()
        target = str(link.autopilot_system_id or number)
        mode = ("--mode", link.mode, "--pressure", link.pressure) if link.pressure != "none" else ("--mode", link.mode)
        calls["autopilot"] = ("autopilot-check", link.endpoint, "--vehicle", target, *mode, *key)
    if modem.kind == "micromodem" and not is_running:
        calls["modem"] = ("modem-check", modem.port, "--vehicle", str(number), "--mission", str(mission))
    with ThreadPoolExecutor() as pool:
        found = pool.map(lambda part: _checked(part, calls[part], mission.parent), calls)
    return [finding for findings in found for finding in findings]


def _checked(part: str, arguments: Sequence[str], folder: Path) -> list[dict[str, str]]:
    try:
        done = subprocess.run(
            [sys.executable, "-m", "auv_lse_run", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_CHECK_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return [{"part": part, "level": "error", "text": f"auv_lse {arguments[0]} did not end: {error}"}]
    found = findings_in(part, f"{done.stdout}\n{done.stderr}")
    if done.returncode and not any(finding["level"] == "error" for finding in found):
        last = next((line for line in reversed((done.stderr or done.stdout).splitlines()) if line.strip()), "")
        found.append({"part": part, "level": "error", "text": f"auv_lse {arguments[0]} failed: {last}"})
    return found


def findings_in(part: str, output: str) -> list[dict[str, str]]:
    """The errors and warnings in the output of a check."""
    found = []
    for line in output.splitlines():
        first, _, text = line.strip().partition(" ")
        if first in _LEVELS and text.strip():
            found.append({"part": part, "level": _LEVELS[first], "text": text.strip()})
    return found
