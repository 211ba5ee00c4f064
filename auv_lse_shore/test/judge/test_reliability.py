"""How often it is so where a map says how probable it is."""

import numpy as np
import pytest

from auv_lse_shore.campaign.reliability_figure import reliability_figure, reliability_of
from auv_lse_shore.judge.reliability import CLASSES, EDGES, Reliability


def test_locations_fall_into_their_classes():
    p = [0.0, 0.005, 0.01, 0.55, 0.56, 0.99, 1.0]
    safe = [False, True, False, True, False, True, True]
    r = Reliability.of(p, safe)
    assert len(r.cells) == CLASSES == 14
    assert r.cells == (2, 1, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 2)
    assert r.safe == (1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 2)
    assert r.expected == pytest.approx((0.005, 0.01, 0, 0, 0, 0, 0, 1.11, 0, 0, 0, 0, 0, 1.99))
    assert r.shares[7] == 0.5
    assert r.probabilities[7] == pytest.approx(0.555)
    assert np.isnan(r.shares[2])
    # |1 - .005| + |0 - .01| + |1 - 1.11| + |2 - 1.99| of 7 locations
    assert r.error == pytest.approx((0.995 + 0.01 + 0.11 + 0.01) / 7)


def test_a_calibrated_map_has_no_reliability_error_and_an_overconfident_one_has():
    rng = np.random.default_rng(1)
    p = rng.beta(0.3, 0.3, 200_000)
    honest = Reliability.of(p, rng.random(p.size) < p)
    # a class of n locations is off by about sqrt(p (1 - p) / n): less than 0.005 here
    assert honest.error < 0.005
    bold = Reliability.of(np.round(p), rng.random(p.size) < p)
    assert bold.error > 0.1


def test_maps_together_are_one_map():
    rng = np.random.default_rng(2)
    p, safe = rng.random(300), rng.random(300) < 0.5
    parts = [Reliability.of(p[i::3], safe[i::3]) for i in range(3)]
    together = Reliability.together(parts)
    assert together.cells == Reliability.of(p, safe).cells
    assert together.expected == pytest.approx(Reliability.of(p, safe).expected)
    assert np.isnan(Reliability.together([]).error)


def test_what_is_no_probability_is_refused():
    with pytest.raises(ValueError, match=r"from 0\.5 to 1\.5, but probabilities are"):
        Reliability.of([0.5, 1.5], [True, True])
    with pytest.raises(ValueError, match="p_safe has 2 values, but safe has 1"):
        Reliability.of([0.5, 0.5], [True])


def test_rows_of_a_campaign_are_drawn():
    rng = np.random.default_rng(3)

    def row(bias):
        p = rng.random(400)
        r = Reliability.of(p, rng.random(400) < p**bias)
        return {"reliability_cells": r.cells, "reliability_expected": r.expected, "reliability_safe": r.safe}

    groups = {"honest": [row(1.0) for _ in range(4)], "bold": [row(2.0) for _ in range(4)], "old": [{"f1": 0.9}]}
    assert sum(Reliability.together(reliability_of(groups["honest"])).cells) == 1600
    assert reliability_of(groups["old"]) == []
    figure = reliability_figure(groups)
    assert figure is not None
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["honest", "bold"]
    assert reliability_figure({"old": groups["old"]}) is None
    assert EDGES[0] == 0.0
