"""Long computations in parts, so that a node can do other things in between.

A computation in parts is a generator: it yields the number of *operations* since the last part, and returns its
result. An operation is about one multiplication of a matrix product. Operations are counted from the sizes of arrays,
not measured. So a simulated mission repeats, whatever the speed of the machine.
"""

from collections.abc import Generator
from typing import Generic, TypeVar

T = TypeVar("T")

#: A computation in parts.
Work = Generator[float, None, T]

#: Operations of one covariance, or of another exponential, sine or cosine.
FUNCTION = 250.0
#: Approximate limit of a part's operations: 15 ms on a core of 2024. Longer steps are split.
PART = 3e8


def finish(work: Work[T]) -> T:
    """Does all parts at once; returns the result."""
    while True:
        try:
            next(work)
        except StopIteration as stop:
            return stop.value  # type: ignore[no-any-return]


class Job(Generic[T]):
    """A computation that is done a few parts at a time.

    Attributes:
        operations: Number of operations so far.
        result: Its result; None until it is done.
    """

    def __init__(self, work: Work[T]) -> None:
        self.operations = 0.0
        self.result: T | None = None
        self._work = work

    def advance(self, operations: float) -> bool:
        """Does parts until they take this many operations; returns whether the computation is done.

        Raises:
            Exception: any error of the computation, which then is over.
        """
        end = self.operations + operations
        while self.operations < end:
            try:
                self.operations += next(self._work)
            except StopIteration as stop:
                self.result = stop.value
                return True
        return False


def rows_per_part(operations: float) -> int:
    """Number of rows of a part if each row takes this many operations; at least 1."""
    return max(1, int(PART / max(operations, 1.0)))
