"""A disk that takes no more, for tests."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
from collections.abc import Iterator
from unittest.mock import patch


@contextlib.contextmanager
def full_disk(size: int) -> Iterator[None]:
    """No file of this process and its children can be longer than `size` bytes: also for root.

    They write no bytecode meanwhile: Python would replace a module's cache by the part that fits.
    """
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with patch.object(sys, "dont_write_bytecode", True), patch.dict(os.environ, PYTHONDONTWRITEBYTECODE="1"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, unlimited[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
            signal.signal(signal.SIGXFSZ, ignored)
