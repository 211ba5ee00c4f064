"""Checks the computer of a vehicle: its devices, files and packages."""

from __future__ import annotations

import importlib.util
import os
import stat
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.settings import check_send_duration
from auv_lse_shore.check.findings import Findings

#: Install commands of packages that a node imports only when needed.
_PACKAGES = {
    "pymavlink": "pip install pymavlink",
    "serial": "sudo apt install python3-serial (or pip install pyserial)",
}


def check_machine(settings: Settings, number: int, simulated: bool, findings: Findings) -> None:
    """Checks what vehicle `number` needs on this machine.

    Args:
        settings: The mission.
        number: The vehicle.
        simulated: Whether the file has a section sim; nodes then wait for a simulator.
        findings: Takes what is found.
    """
    if number > settings.mission.vehicles:
        findings.error(f"auv{number}: expected one of the mission's {settings.mission.vehicles} vehicles")
        return
    own = settings.vehicle(number)
    if simulated:
        findings.warning(
            f"{settings.where}: has a section sim, so the nodes wait for a simulator; expected a file from "
            "scripts/mission --for-vehicles"
        )
    if own.modem.kind == "micromodem":
        try:
            check_send_duration(settings.tdma, own.modem, settings.where)
        except ParameterError as error:
            findings.error(str(error))
        _check_device("modem.port", own.modem.port, findings)
        if "://" not in own.modem.port:
            _check_package("serial", f"modem.port = {own.modem.port}", findings)
    else:
        findings.warning(
            f"auv{number}: modem.kind: got {own.modem.kind!r}, which drives no modem; expected 'micromodem'"
        )
    if own.link.kind == "mavlink":
        _check_package("pymavlink", "link.kind = mavlink", findings)
        if own.link.endpoint.startswith("serial://"):
            _check_device("link.endpoint", own.link.endpoint.removeprefix("serial://").rsplit(":", 1)[0], findings)
    else:
        findings.warning(
            f"auv{number}: link.kind: got {own.link.kind!r}, which drives no autopilot; expected 'mavlink'"
        )
    if own.gp.survey_file and not Path(own.gp.survey_file).is_file():
        findings.error(f"gp.survey_file: got {own.gp.survey_file!r}; expected a file on this machine")
    if settings.packet.tag:
        _check_key(Path(settings.packet.key_file), findings)
    if settings.record.folder and not any(map(importlib.util.find_spec, ("rosbag2_py", "rosbags"))):
        findings.error(
            "record.folder: recording needs rosbag2_py or rosbags. Fix: sudo apt install ros-jazzy-rosbag2-py, or pip "
            "install rosbags"
        )
    if not settings.record.folder:
        findings.warning("record.folder: got ''; expected a folder, or the dive is not recorded")


def _check_device(name: str, port: str, findings: Findings) -> None:
    if "://" in port:
        findings.note(f"{name} = {port}: not checked; it must be reachable when the node starts")
    elif not Path(port).exists():
        findings.error(f"{name}: got {port}; expected a device on this machine")
    elif not stat.S_ISCHR(os.stat(port).st_mode):
        findings.error(f"{name}: got {port}; expected a serial device")
    elif not os.access(port, os.R_OK | os.W_OK):
        findings.error(f"{name}: no access to {port}. Fix: sudo usermod -aG dialout $USER, then log in again")
    else:
        findings.note(f"{name} = {port}: found")


def _check_package(package: str, why: str, findings: Findings) -> None:
    if importlib.util.find_spec(package) is None:
        findings.error(f"{why}: needs the Python package {package}. Fix: {_PACKAGES[package]}")


def _check_key(path: Path, findings: Findings) -> None:
    from auv_lse_comms.packet.key import KeyFileError, read_key

    try:
        read_key(str(path))
    except KeyFileError as error:
        findings.error(f"packet.key_file: {error}")
