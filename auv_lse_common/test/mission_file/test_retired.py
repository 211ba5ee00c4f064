"""Recordings remain readable: no parameter or value disappears without becoming a retired one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

import pytest

from auv_lse_common.mission_file.parameters import ParameterError, describe, from_mapping
from auv_lse_common.mission_file.retired import RENAMED, RETIRED, RETIRED_VALUES, notes_on_retired, without_retired
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections

#: Every parameter that a mission file could ever set, one dotted name a line. Names are added and never removed.
SO_FAR = Path(__file__).with_name("parameters_so_far.txt").read_text().split()

PRESENT = [row[0] for name, cls in SECTIONS.items() for row in describe(cls, f"{name}.")]

#: Every value that a parameter with a choice could ever have, one a line: dotted name, value.
VALUES_SO_FAR = [tuple(line.split()) for line in Path(__file__).with_name("values_so_far.txt").read_text().splitlines()]


def choices(cls: type, prefix: str) -> Iterator[tuple[str, str]]:
    """Dotted name and value of every choice of a section, nested ones included."""
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(hints[field.name]):
            yield from choices(hints[field.name], f"{prefix}{field.name}.")
        for value in field.metadata.get("choices") or ():
            yield f"{prefix}{field.name}", value


PRESENT_VALUES = [entry for name, cls in SECTIONS.items() for entry in choices(cls, f"{name}.")]
GONE_VALUES = [(name, value) for name, values in RETIRED_VALUES.items() for value in values]


def test_a_new_parameter_is_listed() -> None:
    missing = sorted(set(PRESENT) - set(SO_FAR))
    assert not missing, f"add to parameters_so_far.txt, in alphabetical order: {missing}"


def test_a_removed_parameter_is_retired() -> None:
    gone = sorted(set(SO_FAR) - set(PRESENT) - set(RETIRED) - set(RENAMED))
    assert not gone, f"add to RETIRED in retired.py, so that older recordings remain readable: {gone}"


def test_only_removed_parameters_are_retired() -> None:
    """A retired parameter is ignored, so a present one must not be; a misspelled one would retire nothing."""
    assert not set(RETIRED) & set(PRESENT)
    assert set(RETIRED) <= set(SO_FAR)


def test_a_meaning_has_no_full_stop_since_unit_and_range_follow_it() -> None:
    rows = [row for name, cls in SECTIONS.items() for row in describe(cls, f"{name}.")]
    assert [row[0] for row in rows if row[-1].endswith(".") and not row[-1].endswith("...")] == []


def test_the_lists_are_sorted_and_without_repetition() -> None:
    assert sorted(set(SO_FAR)) == SO_FAR
    assert sorted(set(RETIRED)) == list(RETIRED)


def test_retired_parameters_are_left_out_however_they_are_nested() -> None:
    flat = dict.fromkeys(RETIRED, 1)
    nested: dict[str, dict[str, int]] = {}
    for name in RETIRED:
        section, key = name.split(".")
        nested.setdefault(section, {"kept": 2})[key] = 1
    cleaned = without_retired({"/**": {**flat, "mission.seed": 3}, "/auv2/**": nested})
    assert cleaned == {"/**": {"mission.seed": 3}, "/auv2/**": {section: {"kept": 2} for section in nested}}


def test_a_new_value_is_listed_and_a_removed_one_is_retired() -> None:
    missing = sorted(set(PRESENT_VALUES) - set(VALUES_SO_FAR))
    assert not missing, f"add to values_so_far.txt, in alphabetical order: {missing}"
    still_read = [entry for entry in VALUES_SO_FAR if entry[0] in PRESENT]
    gone = sorted(set(still_read) - set(PRESENT_VALUES) - set(GONE_VALUES))
    assert not gone, f"add to RETIRED_VALUES in retired.py, so that older recordings remain readable: {gone}"
    assert sorted(set(VALUES_SO_FAR)) == VALUES_SO_FAR


@pytest.mark.parametrize(("name", "value"), GONE_VALUES)
def test_a_retired_value_is_replaced_in_recordings_and_refused_in_mission_files(name: str, value: str) -> None:
    assert (name, value) in VALUES_SO_FAR
    assert (name, value) not in PRESENT_VALUES
    new = RETIRED_VALUES[name][value]
    assert (name, new) in PRESENT_VALUES
    section, key = name.split(".")
    for given in ({name: value}, {section: {key: value}}):
        assert without_retired({"/**": given}) == {"/**": {k: new if k == name else {key: new} for k in given}}
        assert notes_on_retired({"/**": given}) == [
            f"Recorded by an earlier version with {name} {value!r}; this version reads it as {new!r}."
        ]
    with pytest.raises(ParameterError, match=f"must be one of .*, not {value!r}. {value!r} was replaced by {new!r}"):
        from_mapping(SECTIONS[section], {key: value}, f"my.yaml (auv2): {section}")


def test_numbers_beyond_the_limits_of_this_version_are_limited_in_recordings() -> None:
    recorded = {"/**": {"planner": {"deadline_s": 1e5}, "sim": {"channel": {"rate": 2}}, "vehicle.speed_mps": 0.04}}
    limited = {"planner": {"deadline_s": 3600.0}, "sim": {"channel": {"rate": 3}}, "vehicle.speed_mps": 0.05}
    assert without_retired(recorded) == {"/**": limited}
    assert notes_on_retired(recorded)[0] == (
        "Recorded by an earlier version with planner.deadline_s 100000.0; this version reads it as its limit, 3600.0."
    )
    assert notes_on_retired({"/**": limited}) == []
    with pytest.raises(ParameterError, match=r"from 0 to 3600 s, not 100000"):
        from_mapping(SECTIONS["planner"], {"deadline_s": 1e5}, "planner")


def test_a_file_of_this_version_stays_as_it_is() -> None:
    patterns = {"/**": {"planner": {"method": "plain"}, "mission.seed": 3}, "/auv2/**": {"vehicle.depth_m": 2.0}}
    assert without_retired(patterns) == patterns
    assert notes_on_retired(patterns) == []


def test_a_retired_parameter_is_named_as_removed_in_a_mission_file() -> None:
    with pytest.raises(ParameterError, match=r"planner\.floor: unknown parameter .*; it was removed\. Delete it"):
        from_mapping(SECTIONS["planner"], {"floor": "lanes"}, "my.yaml: planner")


def test_a_renamed_parameter_is_translated_in_recordings_and_refused_in_mission_files() -> None:
    assert set(RENAMED) <= set(SO_FAR)
    assert not set(RENAMED) & set(PRESENT)
    assert set(RENAMED.values()) <= set(PRESENT)
    nested = {"places": {"correct": False, "place_walk_m_rts": 0.1}, "planner": {"method": "plain"}}
    assert without_retired({"/**": nested}) == {
        "/**": {"positions": {"correct": False, "position_walk_m_rts": 0.1}, "planner": {"method": "plain"}}
    }
    assert without_retired({"/**": {"places.correct": True}}) == {"/**": {"positions.correct": True}}
    assert notes_on_retired({"/**": {"places.correct": True}}) == [
        "Recorded by an earlier version with parameters that have new names: places.correct (now positions.correct)."
    ]
    with pytest.raises(ParameterError, match="the section places is now called positions; rename it"):
        check_sections({"places": {"correct": True}}, "my.yaml")
