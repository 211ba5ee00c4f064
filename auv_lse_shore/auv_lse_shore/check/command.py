"""auv_lse check: checks mission files before a mission."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import error_text
from auv_lse_gp.map.certainty import FOUND, MAX_STD_M
from auv_lse_gp.map.depth_map import BAND_SIGMAS
from auv_lse_run.shipped_files import shipped_file
from auv_lse_run.vehicle.run_vehicle import vehicle_number
from auv_lse_shore.areas.area_file import AreaFiles
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.geometry import check_geometry
from auv_lse_shore.check.machine import check_files, check_machine, check_recording, check_shared
from auv_lse_shore.check.mission_file import check_file
from auv_lse_shore.check.schema import schema_text, template_text
from auv_lse_shore.check.timing import check_timing
from auv_lse_shore.mission_options import (
    add_ground_options,
    add_set_option,
    check_ground_options,
    check_vehicles,
    ground_given,
    settings_given,
)

ERRORS = (ParameterError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse check."""
    p = argparse.ArgumentParser(
        prog="auv_lse check",
        description="Checks mission files: keys and ranges, area, starts, lanes, slots, depths. Estimates the "
        "mission's duration, coverage, packet content and recording. Draws the mission on a map. Starts nothing.",
        epilog="Exit codes: 0 no errors; 1 errors, or with --strict warnings; 2 unreadable file or wrong command line.",
    )
    p.add_argument("mission", nargs="*", type=Path, metavar="MISSION.yaml", help="mission files to check "
                   "(default: config/missions/default.yaml)")  # fmt: skip
    p.add_argument(
        "--area",
        type=Path,
        metavar="FILE",
        help="check with the area, no-go areas, starts and recovery positions of a file (GeoJSON, KML, GPX, "
        "GeoPackage, shapefile, QGroundControl, ...), as auv_lse mission --area",
    )
    add_ground_options(p)
    add_set_option(p)
    p.add_argument(
        "--map",
        type=_picture,
        nargs="?",
        const=Path(),
        metavar="OUT.png",
        help="draw area, no-go areas, margin, starts and recovery positions (default: MISSION-map.png in this folder)",
    )
    p.add_argument("--vehicle", metavar="NAME", help="also check that this computer can run a vehicle, such as auv2")
    p.add_argument("--strict", action="store_true", help="treat warnings as errors")
    p.add_argument("--quiet", action="store_true", help="print errors and warnings only")
    p.add_argument(
        "--schema", action="store_true", help="print the JSON schema of mission files, for editors, and exit"
    )
    p.add_argument(
        "--template", action="store_true", help="print a commented mission file with every parameter, and exit"
    )
    return p


def _picture(name: str) -> Path:
    path = Path(name)
    if path.suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(
            f"{name} does not end in .png. If it is the mission file, give it first: auv_lse check {name} --map"
        )
    return path


def check(
    path: Path,
    vehicle: str | None = None,
    *,
    area_file: Path | None = None,
    picture: Path | None = None,
    options: argparse.Namespace | None = None,
) -> Findings:
    """The findings about a mission file.

    Args:
        vehicle: Also check this computer as that of a vehicle ("auv2").
        area_file: Area file that replaces the mission file's area.
        picture: Where to draw the mission; None: nowhere.
        options: Has the options of the ground and --set; None: none are given.

    Raises:
        ParameterError: if the file or its area file cannot be read, or an option is impossible.
        OSError: if the picture cannot be written.
    """
    findings = Findings()
    areas = AreaFiles()
    given = {} if options is None else {**ground_given(options), **settings_given(options.set)}
    if "area.file" in given:
        area_file = Path(given.pop("area.file"))
    settings, patterns = check_file(path, findings, areas, area_file, given)
    check_vehicles([*given], settings.mission.vehicles)
    if options is not None:
        check_ground_options(options, settings)
    of_area = areas.notes(settings.mission.vehicles)
    for text in of_area:
        findings.note(text)
    number = None if vehicle is None else vehicle_number(vehicle)
    check_files(settings, number, findings)
    settings = check_geometry(settings, findings)
    if findings.usable("mission", "planner.method"):
        methods = sorted({own.planner.method for own in settings.vehicles})
        team, legs = counted(settings.mission.vehicles, "vehicle"), counted(settings.mission.steps, "leg")
        goal = f"goal {settings.mission.goal}"
        findings.note(f"mission: {goal}, {team}, {legs} each, method {', '.join(methods)}")
        _check_until(settings.mission.until, findings)
    check_timing(settings, findings)
    check_recording(settings, number, findings)
    if number is not None:
        check_machine(settings, number, "sim" in patterns.get("/**", {}), findings)
    if number is None or number <= settings.mission.vehicles:
        check_shared(settings, patterns, number, findings)
    if picture is not None:
        _draw(
            settings,
            findings,
            picture,
            f"{path.name}{'' if area_file is None else f' with {area_file.name}'}",
            of_area,
        )
    return findings


def _check_until(until: UntilConfig, findings: Findings) -> None:
    """Notes the quality that ends the mission, and warns of one that every map has."""
    if not until.is_asked:
        return
    findings.note(f"mission: ends earlier with {until.text}")
    always_m = BAND_SIGMAS * MAX_STD_M[FOUND]
    if until.deviation_m is not None and until.deviation_m >= always_m:
        findings.warning(
            f"mission.until.deviation_m: {until.deviation_m:g} m has no effect, because any line that is found "
            f"at all is within {always_m:.1f} m. Choose less"
        )


def _draw(settings: Settings, findings: Findings, picture: Path, title: str, notes: Sequence[str]) -> None:
    """Draws the mission, unless errors make that impossible."""
    if not findings.usable("area", "mission", "motion", "planner", "vehicle"):
        findings.note(f"map: {picture} is not drawn; correct the errors above first")
        return
    from auv_lse_shore.check.map_picture import mission_figure  # slow to import
    from auv_lse_shore.report.figures import save

    save(mission_figure(settings, title, notes), picture)
    findings.note(f"map: {picture}")


def run(options: argparse.Namespace) -> int:
    """Checks mission files. Returns 0, 1 or 2, see --help."""
    if options.schema or options.template:
        print(schema_text() if options.schema else template_text(), end="")
        return 0
    missions = options.mission or [shipped_file("missions/default.yaml")]
    if options.map is not None and options.map.name and len(missions) > 1:
        raise ParameterError(f"--map {options.map} is one picture of {len(missions)} mission files; leave out its name")
    code = 0
    for path in missions:
        picture = options.map
        if picture == Path():
            picture = Path(f"{(options.area or path).stem}-map.png")
        try:
            findings = check(path, options.vehicle, area_file=options.area, picture=picture, options=options)
        except (ParameterError, OSError) as error:
            print(f"error    {error_text(error)}", file=sys.stderr)
            code = 2
            continue
        print(path)
        for level, text in findings.rows:
            if level != "note" or not options.quiet:
                print(f"  {level:8} {text.removeprefix(f'{path}: ')}")
        errors, warnings = findings.count("error"), findings.count("warning")
        print(f"  {counted(errors, 'error')}, {counted(warnings, 'warning')}")
        if errors or (options.strict and warnings):
            code = max(code, 1)
    return code
