"""Freed memory goes back to the operating system."""

import platform
import re
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.support.free_memory import return_free_memory


def _own_mb():
    text = Path("/proc/self/smaps_rollup").read_text(encoding="utf-8")
    return sum(int(n) for n in re.findall(r"^Private_\w+:\s+(\d+) kB", text, re.MULTILINE)) / 1e3


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc keeps freed memory")
def test_freed_memory_is_returned():
    arrays = [np.ones(10_000) for _ in range(800)]  # 64 MB in pieces too small for a mapping of their own
    last = arrays[-1]
    del arrays
    before = _own_mb()
    return_free_memory()
    assert before - _own_mb() > 30.0
    assert last.sum() == 10_000.0
