"""Fixtures of the tests of recordings."""

import pytest
from synthetic_run import make_run


@pytest.fixture(scope="session")
def synthetic_run():
    """`make_run`, for tests to vary."""
    return make_run
