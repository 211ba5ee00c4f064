"""Returns memory that Python has freed to the operating system."""

from __future__ import annotations

import ctypes


def return_free_memory() -> None:
    """Returns freed memory, which glibc keeps for later use: after large arrays, 50 to 100 MB.

    With other C libraries it does nothing. It takes some milliseconds; memory that is needed again must be requested
    again.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
