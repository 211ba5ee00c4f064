"""A table of numbers that grows at its end; its memory grows by a quarter when it is full."""

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array


class GrowingRows:
    """Rows of numbers.

    Attributes:
        buffer: The rows, then spare rows, (capacity, width); replaced when it is full.
    """

    def __init__(self, width: int, capacity: int = 64) -> None:
        """Makes an empty table of `width` columns with room for `capacity` rows."""
        self.buffer: Array = np.zeros((capacity, width))
        self._size = 0

    def __len__(self) -> int:
        """Number of rows."""
        return self._size

    @property
    def rows(self) -> Array:
        """The rows (n, width): a writable view, valid until the table grows."""
        return self.buffer[: self._size]

    def reserve(self, size: int) -> None:
        """Makes room for a total of `size` rows."""
        if size > len(self.buffer):
            grown = np.zeros((max(size, len(self.buffer) * 5 // 4), self.buffer.shape[1]))
            grown[: self._size] = self.rows
            self.buffer = grown

    def resize(self, size: int) -> None:
        """Sets the number of rows: drops rows from the end, or adds rows whose values the caller writes."""
        self.reserve(size)
        self._size = size

    def append(self, rows: ArrayLike) -> None:
        """Adds rows (m, width), or one row (width,)."""
        new = np.atleast_2d(np.asarray(rows, dtype=float))
        begin = self._size
        self.resize(begin + len(new))
        self.buffer[begin : self._size] = new
