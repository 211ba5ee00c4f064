"""Lets the tests import `textbook`, which pytest's importlib mode does not find by itself; a fixture of several."""

import sys
from pathlib import Path

import pytest

from auv_lse_common.support import compiled

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(params=[True, False], ids=["numba", "numpy"])
def numba_or_numpy(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs a test with compiled code, and again with its NumPy twin."""
    if request.param and not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    monkeypatch.setattr(compiled, "USE_NUMBA", request.param)
