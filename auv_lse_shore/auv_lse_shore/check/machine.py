"""Checks the computer of a vehicle: its devices, files and packages."""

import os
import stat
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.parameters import ParameterError, is_given
from auv_lse_common.mission_file.port_address import read_address
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import SHARED
from auv_lse_common.mission_file.settings import Patterns, Settings
from auv_lse_common.support.missing_packages import COMMANDS, is_installed
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import error_text
from auv_lse_comms.settings import check_send_duration
from auv_lse_gp.soundings import origin_problem, read_soundings
from auv_lse_gp.tables.table_error import TableError
from auv_lse_record.guard import free_mb
from auv_lse_record.size_estimate import lack_of_space, size_of
from auv_lse_shore.check.findings import Findings


def survey_problem(file: str, area: AreaConfig, is_prior: bool = True) -> str:
    """Why a survey cannot be the prior in an area; "" if it can.

    Args:
        is_prior: Whether `gp.mean` uses it; if not, it must only exist.
    """
    path = Path(file)
    if not path.is_file():
        return f"{file!r} does not exist on this machine"
    if not is_prior:
        return ""
    try:
        read_soundings(path)
        return origin_problem(path, area)
    except (OSError, TableError) as error:
        return error_text(error)


def check_priors(settings: Settings) -> None:
    """Raises ParameterError for a survey that cannot be a vehicle's prior."""
    for file in {own.gp.survey_file for own in settings.vehicles if own.gp.mean == "survey"}:
        if problem := survey_problem(file, settings.area):
            raise ParameterError(f"gp.survey_file: {problem}")


def check_files(settings: Settings, number: int | None, findings: Findings) -> None:
    """Checks that the files with depths exist on this machine.

    Args:
        number: The vehicle of this machine; None: every vehicle's files are checked.
    """
    wrong, problems = dict[int, str](), dict[tuple[str, bool], str]()  # of a vehicle; of a file, which many may share
    for k, own in enumerate(settings.vehicles, 1):
        file = own.gp.survey_file
        if number not in (None, k) or findings.is_refused("gp.survey_file", k):
            continue
        use = file, own.gp.mean == "survey"
        if file and use not in problems:
            problems[use] = survey_problem(file, settings.area, is_prior=use[1])
        if problem := problems.get(use):
            wrong[k] = problem
    if len(wrong) == len(settings.vehicles) and len(set(wrong.values())) == 1:
        findings.error(f"gp.survey_file: {wrong[1]}")
    else:
        for k, problem in wrong.items():
            findings.error(f"auv{k}: gp.survey_file: {problem}")
    file = settings.sim.bathymetry.file
    if file and not Path(file).is_file():
        findings.refuse("sim.bathymetry", f"sim.bathymetry.file: {file!r} does not exist on this machine")


def check_shared(settings: Settings, patterns: Patterns, number: int | None, findings: Findings) -> None:
    """Finds numbers that a vehicle requires of its file: an error for vehicle `number`, else (None) a note.

    Args:
        patterns: The content of the file.
    """
    try:
        given = parameters_for(patterns, f"/auv{number or 1}/settings")
    except ParameterError:  # found before
        return
    for key, meaning in SHARED.items():
        if not is_given(given, f"mission.{key}"):
            value = getattr(settings.mission, key)
            add = findings.note if number is None else findings.error
            add(f"mission.{key} is missing: a simulation takes {value}, but auv_lse vehicle needs {meaning} there")


def check_machine(settings: Settings, number: int, simulated: bool, findings: Findings) -> None:
    """Checks what vehicle `number` needs on this machine.

    Args:
        simulated: Whether the file has a section sim; nodes then wait for a simulator.
    """
    if not 1 <= number <= settings.mission.vehicles:
        team = counted(settings.mission.vehicles, "vehicle")
        findings.error(f"auv{number} is not in the mission, which has {team}")
        return
    if simulated:
        findings.warning(
            f"{settings.where} has a section sim, so the nodes wait for a simulator; on a vehicle use a file "
            "from auv_lse mission --for-vehicles"
        )
    _check_modem(settings, number, findings)
    _check_link(settings, number, findings)
    if settings.packet.tag and findings.usable("packet.key_file"):
        _check_key("packet.key_file", settings.packet.key_file, findings)
    if settings.record.folder and not is_installed("rosbags"):
        findings.error("record.folder: recording needs the Python package rosbags. Fix: pip install rosbags")
    if not settings.record.folder and findings.usable("record.folder"):
        findings.warning("record.folder is empty, so the dive is not recorded; set a folder")


def check_recording(settings: Settings, number: int | None, findings: Findings) -> None:
    """Estimates the size of the recording, and checks the disk of this machine if it is that of a vehicle.

    Args:
        number: The vehicle of this machine; None: the disk is not checked.
    """
    if not findings.usable("mission", "motion", "area", "gp", "record", "vehicle.speed_mps"):
        return
    size = size_of(settings)
    findings.note(
        f"recording: about {max(size.vehicle_mb, 1.0):.0f} MB on each vehicle, "
        f"{max(size.mission_mb, 1.0):.0f} MB of a simulated mission"
    )
    if number is not None and settings.record.folder:
        folder = Path(settings.record.folder).absolute()
        there = next(path for path in (folder, *folder.parents) if path.exists())
        if lack := lack_of_space(size.vehicle_mb, free_mb(there), settings.record.least_free_mb):
            findings.error(lack)


def _check_modem(settings: Settings, number: int, findings: Findings) -> None:
    modem = settings.vehicle(number).modem
    if not findings.usable("modem.kind", vehicle=number):
        return
    if modem.kind != "micromodem":
        if settings.mission.vehicles > 1:
            findings.warning(f"auv{number}: modem.kind: {modem.kind!r} drives no modem; use 'micromodem'")
        return
    if findings.usable("tdma", "modem", vehicle=number):
        try:
            check_send_duration(settings.tdma, modem, settings.where)
        except ParameterError as error:
            findings.error(str(error))
    if findings.usable("modem.port", vehicle=number):
        _check_device("modem.port", modem.port, findings)
        if read_address(modem.port).kind == "serial":
            _check_package("serial", f"modem.port = {modem.port}", findings)


def _check_link(settings: Settings, number: int, findings: Findings) -> None:
    link = settings.vehicle(number).link
    if not findings.usable("link.kind", vehicle=number):
        return
    if link.kind != "mavlink":
        findings.warning(f"auv{number}: link.kind: {link.kind!r} drives no autopilot; use 'mavlink'")
        return
    for package in ("auv_lse_mavlink", "pymavlink"):
        _check_package(package, "link.kind = mavlink", findings)
    if link.key_file and findings.usable("link.key_file", vehicle=number):
        _check_key("link.key_file", link.key_file, findings)
    if findings.usable("link.endpoint", vehicle=number) and read_address(link.endpoint).kind == "serial":
        _check_device("link.endpoint", link.endpoint, findings)


def _check_device(name: str, text: str, findings: Findings) -> None:
    address = read_address(text)
    port = address.position
    if address.kind != "serial":
        findings.note(f"{name} = {text}: not checked; it must be reachable when the node starts")
    elif not Path(port).exists():
        findings.error(f"{name}: {port} does not exist on this machine")
    elif not stat.S_ISCHR(os.stat(port).st_mode):
        findings.error(f"{name}: {port} is not a serial device")
    elif not os.access(port, os.R_OK | os.W_OK):
        findings.error(f"{name}: no access to {port}. Fix: sudo usermod -aG dialout $USER, then log in again")
    else:
        findings.note(f"{name} = {port}: found")


def _check_package(package: str, why: str, findings: Findings) -> None:
    if not is_installed(package):
        findings.error(f"{why}: needs the Python package {package}. Fix: {COMMANDS[package]}")


def _check_key(name: str, path: str, findings: Findings) -> None:
    from auv_lse_comms.packet.key import KeyFileError, read_key

    try:
        read_key(path)
    except KeyFileError as error:
        findings.error(f"{name}: {error}")
