"""Freed memory goes back to the operating system."""

import platform
import re
import subprocess
import sys
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


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists a process's mappings")
def test_pages_of_code_are_returned_and_mapped_again():
    """In a process of its own: a debugger or a coverage tool may have written to this one's code."""
    script = """
import re
from pathlib import Path
import scipy.linalg, numpy as np
from auv_lse_common.support.free_memory import return_code_pages
def code_mb():
    blocks = re.split(r"(?m)^(?=[0-9a-f]+-[0-9a-f]+ )", Path("/proc/self/smaps").read_text())
    code = [block for block in blocks if re.match(r"\\S+ r-xp \\S+ \\S+ [1-9]", block)]
    return sum(int(re.search(r"Rss:\\s+(\\d+)", block)[1]) for block in code) / 1e3
matrix = np.eye(50) + 0.5
first = scipy.linalg.cholesky(matrix)
before = code_mb()
return_code_pages()
print(before, code_mb(), np.array_equal(first, scipy.linalg.cholesky(matrix)))
"""
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    before_mb, after_mb, is_same = found.stdout.split()
    assert float(after_mb) < 0.7 * float(before_mb)
    assert is_same == "True"
