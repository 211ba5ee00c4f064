"""A table that grows: what was appended stays."""

import numpy as np

from auv_lse_common.support.growing_rows import GrowingRows


def test_rows_survive_growing_and_dropping():
    rng = np.random.default_rng(1)
    table, expected = GrowingRows(3, capacity=2), np.zeros((0, 3))
    for count in (1, 4, 0, 9, 30):
        rows = rng.normal(size=(count, 3))
        table.append(rows)
        expected = np.concatenate([expected, rows])
        assert np.array_equal(table.rows, expected)
    table.append([1.0, 2.0, 3.0])
    assert table.rows[-1].tolist() == [1.0, 2.0, 3.0]
    table.resize(5)
    assert np.array_equal(table.rows, expected[:5])


def test_little_of_the_memory_is_spare():
    table = GrowingRows(3)
    for number in range(1, 1001):
        table.append(np.ones((1, 3)))
        assert len(table.buffer) <= max(64, 1.25 * number)
