"""scripts/check: checks mission files before a mission."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_lse_common.commands.vehicle import vehicle_number
from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.geometry import check_geometry
from auv_lse_shore.check.machine import check_files, check_machine
from auv_lse_shore.check.mission_file import check_file
from auv_lse_shore.check.schema import schema_text, template_text
from auv_lse_shore.check.timing import check_timing


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/check."""
    p = argparse.ArgumentParser(
        prog="scripts/check",
        description="Checks mission files: keys and ranges, area, starts, lanes, slots, depths. Estimates the "
        "mission's duration, coverage and packet content. Starts nothing.",
        epilog="Exit codes: 0 no errors; 1 errors, or with --strict warnings; 2 unreadable file or wrong command line.",
    )
    p.add_argument("mission", nargs="*", type=Path, metavar="MISSION.yaml", help="mission files to check")
    p.add_argument("--vehicle", metavar="NAME", help="also check this computer as that of a vehicle, such as auv2")
    p.add_argument("--strict", action="store_true", help="treat warnings as errors")
    p.add_argument("--quiet", action="store_true", help="print errors and warnings only")
    p.add_argument(
        "--schema", action="store_true", help="print the JSON schema of mission files, for editors, and exit"
    )
    p.add_argument(
        "--template", action="store_true", help="print a commented mission file with every parameter, and exit"
    )
    return p


def check(path: Path, vehicle: str | None = None) -> Findings:
    """The findings about a mission file.

    Raises:
        ParameterError: if it cannot be read.
    """
    findings = Findings()
    settings = check_file(path, findings)
    if findings.usable("mission", "planner.method"):
        methods = sorted({own.planner.method for own in settings.vehicles})
        team = f"{settings.mission.vehicles} vehicle{'s' if settings.mission.vehicles > 1 else ''}"
        findings.note(f"mission: {team}, {settings.mission.steps} legs each, method {', '.join(methods)}")
    number = None if vehicle is None else vehicle_number(vehicle)
    check_files(settings, number, findings)
    check_geometry(settings, findings)
    check_timing(settings, findings)
    if number is not None:
        simulated = "sim" in read_parameter_file(path).get("/**", {})
        check_machine(settings, number, simulated, findings)
    return findings


def main(arguments: Sequence[str] | None = None) -> int:
    """Checks mission files. Returns 0, 1 or 2, as the help says."""
    p = parser()
    options = p.parse_args(arguments)
    if options.schema or options.template:
        print(schema_text() if options.schema else template_text(), end="")
        return 0
    if not options.mission:
        p.error("expected a mission file: scripts/check config/missions/default.yaml")
    code = 0
    for path in options.mission:
        try:
            findings = check(path, options.vehicle)
        except ParameterError as error:
            print(f"error    {error}", file=sys.stderr)
            code = 2
            continue
        print(path)
        for level, text in findings.rows:
            if level != "note" or not options.quiet:
                print(f"  {level:8} {text.removeprefix(f'{path}: ')}")
        errors, warnings = findings.count("error"), findings.count("warning")
        print(f"  {errors} error{'' if errors == 1 else 's'}, {warnings} warning{'' if warnings == 1 else 's'}")
        if errors or (options.strict and warnings):
            code = max(code, 1)
    return code


if __name__ == "__main__":
    sys.exit(main())
