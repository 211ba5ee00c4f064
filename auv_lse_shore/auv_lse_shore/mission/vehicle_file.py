"""The mission file for vehicles, made from that of a simulated mission."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.parameter_file import parse_parameters
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_comms.settings import least_send_duration_s
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.geometry import check_geometry
from auv_lse_shore.check.timing import check_timing

#: Recording folder of a vehicle, relative to its working directory.
RECORDING = "bag"

#: Values for vehicles where a simulated mission has others, unless the user has set them.
_OF_VEHICLES = {"modem.kind": "micromodem", "link.kind": "mavlink", "vehicle.start": "on_call"}

_HEAD = """\
# The mission file for the vehicles, every default filled in; made by auv_lse mission --for-vehicles from
# {source}. No section sim: nodes without a simulator run on their own clock. docs/guide/bench-to-water.md
"""


def vehicle_file(settings: Settings, chosen: Collection[str] = ()) -> str:
    """The mission file for every vehicle of the mission.

    It has no section `sim`, drives a Micromodem and a MAVLink autopilot at the addresses of `settings`, records into
    `RECORDING`, and waits for GO (`vehicle.start`). `tdma.send_duration_s` allows for the slowest modem.

    Args:
        settings: The simulated mission.
        chosen: Parameters that the user has set, by dotted name; their values are kept.

    Raises:
        ParameterError: if an address is that of a simulated run's hardware, or a modem has none.
    """
    wanted: dict[str, Any] = {"record.folder": RECORDING, "tdma.send_duration_s": least_send_duration_s(settings)}
    # for all vehicles, so that one added by hand waits for GO, too
    wanted |= {name: value for name, value in _OF_VEHICLES.items() if name not in chosen}
    of_a_run = Path(settings.record.folder).is_absolute()
    for k, own in enumerate(settings.vehicles, 1):
        if of_a_run and (own.modem.kind != "direct" or own.link.kind != "direct"):
            raise ParameterError(
                f"{settings.where}: auv{k}: modem.kind {own.modem.kind!r} and link.kind {own.link.kind!r} have "
                "addresses of a run's emulated hardware. Use a file written by hand, or by a run without "
                "--modem emulated and --vehicle-link mavlink"
            )
        for section, key in (name.split(".") for name in _OF_VEHICLES):
            if f"auv{k}.{section}.{key}" in chosen:
                wanted[f"auv{k}.{section}.{key}"] = getattr(getattr(own, section), key)
        is_chosen = {"modem.kind", f"auv{k}.modem.kind"} & set(chosen)
        if (own.modem.kind == "micromodem" or not is_chosen) and not own.modem.port:
            raise ParameterError(
                f"{settings.where}: auv{k}: modem.port is missing. Give a serial device or 'tcp://HOST:PORT': "
                f"--set modem.port=/dev/ttyUSB0 (one vehicle's: --set auv{k}.modem.port=...). Without a "
                "Micromodem: --set modem.kind=direct"
            )
    text = settings.with_overrides(wanted).to_parameter_file()
    body = yaml.safe_load(text)
    del body["/**"]["ros__parameters"]["sim"]
    # leaves in one line; PyYAML writes floats with the point that YAML 1.1 wants
    dumped: str = yaml.safe_dump(body, sort_keys=False, default_flow_style=None, width=110)
    return _HEAD.format(source=settings.where) + dumped


def write_vehicle_file(settings: Settings, path: Path, chosen: Collection[str] = ()) -> None:
    """Writes the mission file for the vehicles; `chosen` as for `vehicle_file`.

    Raises:
        ParameterError: if the mission does not suit vehicles or has errors, or the file exists or cannot be written.
    """
    text = vehicle_file(settings, chosen)
    try:
        if path.exists():
            raise ParameterError(f"--for-vehicles {path} exists already, and was left as it is. Choose a new file")
        if errors := _errors(text, str(path)):
            raise ParameterError(f"--for-vehicles {path} is not written, because {'; '.join(errors)}")
        write_whole(path, text)
    except OSError as error:
        raise ParameterError(f"--for-vehicles {path}: cannot be written: {error.strerror or error}") from error


def _errors(text: str, where: str) -> list[str]:
    """The errors that `auv_lse check` reports about a mission file with this text."""
    findings = Findings()
    check_timing(check_geometry(Settings.from_patterns(parse_parameters(text, where), where), findings), findings)
    return [text.removeprefix(f"{where}: ") for level, text in findings.rows if level == "error"]
