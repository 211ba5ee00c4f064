"""Computations in parts."""

from __future__ import annotations

import pytest

from auv_lse_gp.inference.work import PART, Job, Work, finish, rows_per_part


def counted(parts: list[float], fails: bool = False) -> Work[str]:
    yield from parts
    if fails:
        raise ValueError("no result")
    return "done"


def test_a_job_stops_after_the_part_that_uses_up_its_operations() -> None:
    job = Job(counted([4.0, 4.0, 4.0, 4.0]))
    assert [job.advance(5.0), job.operations] == [False, 8.0]
    assert [job.advance(5.0), job.operations] == [False, 16.0]
    assert job.result is None
    assert job.advance(5.0)
    assert job.result == "done"


def test_all_parts_at_once_give_the_same_result() -> None:
    assert finish(counted([1.0, 2.0])) == "done"
    assert finish(counted([])) == "done"


def test_an_error_ends_the_job() -> None:
    job = Job(counted([1.0], fails=True))
    with pytest.raises(ValueError, match="no result"):
        job.advance(10.0)


def test_a_part_has_at_least_one_row() -> None:
    assert rows_per_part(0.0) == int(PART)
    assert rows_per_part(PART / 4.0) == 4
    assert rows_per_part(10.0 * PART) == 1
