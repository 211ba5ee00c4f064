"""Checks the content of a mission file, and collects every error instead of stopping at the first."""

import copy
import dataclasses
import re
import typing
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.degrees import AreaReader, with_area_file
from auv_lse_common.mission_file.goals import finds_method, with_method
from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, from_mapping, nest, split_refused
from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig, check_planner
from auv_lse_common.mission_file.sections.table import (
    SECTIONS,
    TEAM_SECTIONS,
    VEHICLE_SECTIONS,
    VehicleSections,
    check_sections,
)
from auv_lse_common.mission_file.sections.vehicle import with_depth
from auv_lse_common.mission_file.settings import (
    Patterns,
    Settings,
    beyond_team,
    by_pattern,
    check_pattern,
    origin_of,
    overridden,
)
from auv_lse_shore.check.findings import Findings

_MOST_VEHICLES: int = {f.name: f for f in dataclasses.fields(MissionConfig)}["vehicles"].metadata["high"]

#: The names at the beginning of an error: "ping and synchronous", "north_m, east_m".
_SUBJECT = re.compile(r"[\w.]+(?:(?:,| and) [\w.]+)*")


def check_file(
    path: Path,
    findings: Findings,
    read_area: AreaReader,
    area_file: Path | None = None,
    overrides: Mapping[str, Any] | None = None,
) -> tuple[Settings, Patterns]:
    """Reads a mission file and adds its errors to `findings`.

    Args:
        area_file: Area file that replaces the mission file's area.
        overrides: Possible values that replace the file's, as in `Settings.load`.

    Returns:
        The settings, and what the files hold. Refused parameters have their defaults and are listed in
        `findings.refused`.

    Raises:
        ParameterError: if the file is missing, or not a ROS 2 parameter file, or its area file cannot be used.
    """
    origin = origin_of(overrides or {})
    patterns = read_parameter_file(path, read_area, origin_on_top=origin)
    if area_file is not None:
        patterns = with_area_file(patterns, str(area_file), read_area, origin)
    usable, owners = _usable_values(patterns, str(path), findings, overrides or {})
    on_top = by_pattern(overrides or {})
    settings = _settings(usable, owners, on_top, str(path), findings)
    if findings.count("error"):
        return settings, patterns
    try:
        return Settings.from_patterns(patterns, str(path), overrides), patterns
    except ParameterError as error:
        findings.refused.update((name, None) for name in SECTIONS)
        findings.error(str(error))
        return settings, patterns


def _usable_values(
    patterns: Patterns, where: str, findings: Findings, replaced: Container[str]
) -> tuple[Patterns, dict[str, int | None]]:
    """The values of each pattern without the refused ones, and the vehicle of each pattern (None: all).

    Values that the dotted names in `replaced` override cause no errors.
    """
    usable: Patterns = {}
    owners: dict[str, int | None] = {}
    for pattern, values in patterns.items():
        try:
            owners[pattern] = check_pattern(pattern, {}, where, _MOST_VEHICLES)
        except ParameterError as error:
            findings.error(str(error))
            continue
        usable[pattern] = {}
        for name in dict.fromkeys(full.split(".")[0] for full in values):
            given = {full: value for full, value in values.items() if full.split(".")[0] == name}
            content = _usable_section(pattern, name, given, where, owners[pattern], findings, replaced)
            if content is not None:
                usable[pattern][name] = content
    return usable, owners


def _usable_section(
    pattern: str,
    name: str,
    given: Mapping[str, Any],
    where: str,
    vehicle: int | None,
    findings: Findings,
    replaced: Container[str],
) -> dict[str, Any] | None:
    """The usable values of a section, `given` with dotted names as the file has them; None: no section."""
    position = f"{where}: {pattern}"
    try:
        check_sections({name: None}, position, ignore=("use_sim_time",))
        if name not in SECTIONS:
            return None
        check_pattern(pattern, {name: None}, where, _MOST_VEHICLES)
    except ParameterError as error:
        findings.error(str(error))
        return None
    try:
        content = nest(given)[name]
    except ParameterError as error:
        findings.refuse(name, f"{position}: {error}", vehicle)
        return None
    usable, refused = split_refused(SECTIONS[name], content, f"{position}: {name}")
    for key, text in refused:
        full = f"{name}.{key}".rstrip(".")
        if full not in replaced and f"auv{vehicle}.{full}" not in replaced:
            findings.refuse(full, text, vehicle)
    return usable


def _settings(
    patterns: Patterns,
    owners: Mapping[str, int | None],
    on_top: Sequence[tuple[str, Mapping[str, Any]]],
    where: str,
    findings: Findings,
) -> Settings:
    """The settings from usable values and those `on_top`, without those that contradict each other."""
    for_all = parameters_for({p: values for p, values in patterns.items() if owners[p] is None}, "/settings")
    given = [for_all := overridden(for_all, on_top, None)]
    for_all = with_method(for_all)
    reported: set[str] = set()
    team = _sections(TEAM_SECTIONS, for_all, where, None, reported, findings)
    common = VehicleSections(**_sections(VEHICLE_SECTIONS, for_all, where, None, reported, findings))
    mission: MissionConfig = team["mission"]
    named = {p: number for p, number in owners.items() if number is not None}
    if findings.usable("mission.vehicles"):
        for pattern in named:
            if beyond := beyond_team(pattern, mission.vehicles, where):
                findings.warning(beyond)
    else:  # the largest number in the file
        most = max((number for number in named.values() if number <= _MOST_VEHICLES), default=mission.vehicles)
        team["mission"] = mission = dataclasses.replace(mission, vehicles=most)
    findings.refused = {(name, owner) for name, owner in findings.refused if owner is None or owner <= mission.vehicles}
    vehicles = []
    for number in range(1, mission.vehicles + 1):
        given.append(overridden(parameters_for(patterns, f"/auv{number}/settings"), on_top, number))
        own = with_depth(with_method(given[-1], for_all), number)
        sections = _sections(VEHICLE_SECTIONS, own, where, number, reported, findings)
        if findings.usable("planner", vehicle=number):  # refused steps have their default, which is always possible
            try:
                check_planner(mission, sections["planner"], where)
            except ParameterError as error:
                sections["planner"] = PlannerConfig()
                findings.refused.add(("planner", number))
                if str(error) not in reported:
                    reported.add(str(error))
                    findings.error(str(error).replace(where, f"{where} (auv{number})", 1))
        vehicles.append(VehicleSections(**sections))
    team["finds_method"] = finds_method(mission.goal, given)
    return Settings(where=where, common=common, vehicles=tuple(vehicles), **team)


def _sections(
    kinds: Mapping[str, type],
    parameters: Mapping[str, Any],
    where: str,
    vehicle: int | None,
    reported: set[str],
    findings: Findings,
) -> dict[str, Any]:
    """Sections from usable values; adds an error for each contradiction that is not among the `reported` ones."""
    position = where if vehicle is None else f"{where} (auv{vehicle})"
    built: dict[str, Any] = {}
    for name, kind in kinds.items():
        values = copy.deepcopy(parameters.get(name, {}))
        for text in _contradictions(kind, values, name, vehicle, findings):
            if text not in reported:
                reported.add(text)
                findings.error(f"{position}: {text}")
        built[name] = from_mapping(kind, values, name)
    return built


def _contradictions(
    kind: type, values: dict[str, Any], name: str, vehicle: int | None, findings: Findings
) -> Iterator[str]:
    """Removes values that contradict each other, and yields the message of each contradiction.

    A message about a parameter that has been refused before is left out: it would judge the parameter's default.
    """
    hints = typing.get_type_hints(kind)
    for key, value in values.items():
        if dataclasses.is_dataclass(hints[key]):
            yield from _contradictions(typing.cast(type, hints[key]), value, f"{name}.{key}", vehicle, findings)
    stand_ins: set[str] = set()
    while True:
        try:
            from_mapping(kind, values, name)
            return
        except ParameterError as error:
            if not values:  # the defaults contradict each other
                raise
            text = str(error)
        named = [key for key in hints if _names(text, key)]
        refused = {key for key in named if findings.is_refused(f"{name}.{key}", vehicle)}
        if not refused - set(values):
            yield text
        subject = _subject(text).removeprefix(f"{name}.")
        if hints.get(subject) is str and not values.get(subject) and subject not in stand_ins:
            removed = [subject]
            stand_ins.add(subject)
            values[subject] = "/dev/missing"  # a stand-in, so that the conditions on other parameters are checked too
        else:
            removed = _remove(values, text, named)
        findings.refused.update((f"{name}.{key}", vehicle) for key in removed)


def _remove(values: dict[str, Any], text: str, named: Sequence[str]) -> list[str]:
    """Removes the values that an error is about, and returns their keys."""
    subject = _subject(text)
    keys = [key for key in named if key in values and _names(subject, key)]
    keys = keys or [key for key in named if key in values] or list(values)
    for key in keys:
        group = values[key]
        items = [item for item in group if f"{key}.{item}" in text] if isinstance(group, dict) else []
        for item in items:
            del group[item]
        if not items:
            del values[key]
    return keys


def _subject(text: str) -> str:
    """The names with which an error begins: "a_min, a_max" of "a_min, a_max must not both be 0"; "" without any."""
    found = _SUBJECT.match(text)
    return "" if found is None else found[0]


def _names(text: str, key: str) -> bool:
    return re.search(rf"(?<!\w){key}(?!\w)", text) is not None
