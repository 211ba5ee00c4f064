"""Fixtures that tests of several subpackages share."""

import pytest
from synthetic_run import make_run

from auv_lse_shore.campaign.cluster import cluster


@pytest.fixture(scope="module")
def client():
    """A cluster of two workers."""
    with cluster(None, 2) as found:
        yield found


@pytest.fixture(scope="session")
def synthetic_run():
    """`make_run`, for tests to vary."""
    return make_run
