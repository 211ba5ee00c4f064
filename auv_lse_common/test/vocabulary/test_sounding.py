"""Soundings: named columns, selection, order, and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auv_lse_common.vocabulary.sounding import Sounding, Soundings

ROWS = [(2.0, 10.0, 20.0, 15.0), (1.0, 11.0, 21.0, 16.0), (2.0, 12.0, 22.0, 17.0)]


def test_rows_become_named_columns_with_nan_for_unknown_values():
    soundings = Soundings.from_rows(ROWS)
    assert soundings.depth_m.tolist() == [15.0, 16.0, 17.0]
    assert soundings.points_m[1].tolist() == [11.0, 21.0, 16.0]
    assert soundings.rows.tolist() == [list(row) for row in ROWS]
    assert np.isnan(soundings.raw_positions_m).all()
    assert soundings.vehicle.tolist() == [0, 0, 0]


def test_single_soundings_survive_the_round_trip():
    given = [Sounding(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 2), Sounding(7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 1)]
    soundings = Soundings.from_rows(given)
    assert list(soundings) == given
    assert soundings.raw_positions_m.tolist() == [[5.0, 6.0], [11.0, 12.0]]


def test_soundings_are_sorted_stably_by_stamp():
    assert Soundings.from_rows(ROWS).in_order().depth_m.tolist() == [16.0, 15.0, 17.0]


def test_packets_are_separated_again():
    points = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    packets = [Soundings.of_packet(1.0, 2, points), Soundings.of_packet(1.0, 3, points[:1])]
    apart = Soundings.join(packets).packets()
    assert [(p.stamp_s[0], p.vehicle[0], p.points_m.tolist()) for p in apart] == [
        (1.0, 2, points.tolist()),
        (1.0, 3, points[:1].tolist()),
    ]
    assert Soundings.from_rows(()).packets() == []


def test_selection_and_joining():
    soundings = Soundings.from_rows(ROWS)
    assert len(soundings[:2]) == 2
    late = soundings[soundings.stamp_s > 1.5]
    joined = Soundings.join([late, Soundings.from_rows(()), soundings[1:2]])
    assert joined.locations_m.tolist() == [[10.0, 20.0], [12.0, 22.0], [11.0, 21.0]]
    assert len(Soundings.join([])) == 0


def test_a_number_applies_to_every_sounding():
    soundings = Soundings(stamp_s=3.0, north_m=[1.0, 2.0], east_m=[3.0, 4.0], depth_m=[5.0, 6.0], vehicle=2)
    assert soundings.stamp_s.tolist() == [3.0, 3.0]
    assert soundings.vehicle.tolist() == [2, 2]
    assert all(math.isnan(sounding.raw_north_m) for sounding in soundings)


def test_invalid_soundings_are_rejected():
    with pytest.raises(ValueError, match=r"north_m has shape \(1,\), not \(2,\)"):
        Soundings(stamp_s=0.0, north_m=[1.0], east_m=[1.0, 2.0], depth_m=[1.0, 2.0])
    with pytest.raises(ValueError, match=r"rows must have the shape \(n, 4\).*, not \(2, 5\)"):
        Soundings.from_rows(np.zeros((2, 5)))


def test_many_soundings_are_iterated_over_in_order():
    rows = np.arange(4.0 * 25_001).reshape(-1, 4)
    assert np.array_equal([sounding[:4] for sounding in Soundings.from_rows(rows)], rows)
