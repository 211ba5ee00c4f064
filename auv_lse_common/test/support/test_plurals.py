"""Counts with nouns: of one, the singular."""

import pytest

from auv_lse_common.support.plurals import counted_as


@pytest.mark.parametrize(
    ("plural", "singular"),
    [
        ("messages that are cut off", "message that is cut off"),
        ("positions where the log is damaged", "position where the log is damaged"),
        ("depths that repeat and have no time", "depth that repeats and has no time"),
        ("depths with a quality below 40 %", "depth with a quality below 40 %"),
    ],
)
def test_one_of_a_kind_is_in_the_singular(plural: str, singular: str) -> None:
    assert counted_as(1, plural) == f"1 {singular}"
    assert counted_as(2_000, plural) == f"2,000 {plural}"
