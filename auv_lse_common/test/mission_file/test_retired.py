"""Recordings remain readable: no parameter disappears without becoming a retired one."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.parameter_file import RETIRED, without_retired
from auv_lse_common.mission_file.parameters import describe
from auv_lse_common.mission_file.sections.table import SECTIONS

#: Every parameter that a mission file could ever set, one dotted name a line. Names are added and never removed.
SO_FAR = Path(__file__).with_name("parameters_so_far.txt").read_text().split()

PRESENT = [row[0] for name, cls in SECTIONS.items() for row in describe(cls, f"{name}.")]


def test_a_new_parameter_is_listed() -> None:
    missing = sorted(set(PRESENT) - set(SO_FAR))
    assert not missing, f"add to parameters_so_far.txt, in alphabetical order: {missing}"


def test_a_removed_parameter_is_retired() -> None:
    gone = sorted(set(SO_FAR) - set(PRESENT) - set(RETIRED))
    assert not gone, f"add to RETIRED in parameter_file.py, so that older recordings remain readable: {gone}"


def test_only_removed_parameters_are_retired() -> None:
    """A retired parameter is ignored, so a present one must not be; a misspelled one would retire nothing."""
    assert not set(RETIRED) & set(PRESENT)
    assert set(RETIRED) <= set(SO_FAR)


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
