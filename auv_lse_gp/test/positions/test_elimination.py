"""Steps of a large team, whose mates are eliminated on their own, against solving for all unknowns at once."""

from __future__ import annotations

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_gp.positions import depth_sensitivity, gauss_newton
from auv_lse_gp.positions.elimination import Elimination
from auv_lse_gp.positions.error_model import TeamErrorModel
from auv_lse_gp.positions.measurements import Fixes, FixMeasurement, RangeMeasurement, Ranges
from auv_lse_gp.positions.track import OwnTrack, Track

#: Seconds travelled by each vehicle: they have different numbers of knots.
LASTED_S = {1: 900, 2: 400, 3: 700, 4: 900, 5: 130}


def team() -> TeamErrorModel:
    rng, tracks = np.random.default_rng(3), dict[int, Track]()
    for number, lasted_s in LASTED_S.items():
        track, at = OwnTrack(), rng.normal(0.0, 20.0, 2)
        for t in range(lasted_s):
            at += np.array([np.cos(0.01 * t), np.sin(0.01 * t)])
            track.add(float(t), *at.tolist())
        tracks[number] = track
    return TeamErrorModel(PositionsConfig(), tracks, {1})


def range_of(sender: int, receiver: int, sent_s: float, by_ping: bool = False) -> RangeMeasurement:
    return RangeMeasurement(
        sender=sender, receiver=receiver, sent_s=sent_s, arrived_s=sent_s + 0.2, range_m=300.0, by_ping=by_ping
    )


def fix_of(vehicle: int, stamp_s: float) -> FixMeasurement:
    return FixMeasurement(vehicle=vehicle, stamp_s=stamp_s, position_m=(9.0, 1.0), raw_m=(8.0, 3.0), std_m=1.5)


TO_ONE = [range_of(sender, 1, 20.0 * i, i % 3 == 0) for i in range(6) for sender in (2, 3, 4, 5)]
BETWEEN_MATES = [*TO_ONE, range_of(2, 3, 50.0), range_of(5, 3, 60.0), range_of(1, 3, 70.0)]
EVERYONE = [range_of(sender, sender % 5 + 1, 30.0) for sender in LASTED_S]
FIXES = [fix_of(1, 300.0), fix_of(3, 200.0), fix_of(3, 500.0)]


@pytest.mark.parametrize(
    ("ranges", "fixes"),
    [(TO_ONE, FIXES), (TO_ONE, []), (TO_ONE[:2], FIXES[:1]), (BETWEEN_MATES, FIXES), ([], FIXES), ([], [])],
)
def test_a_step_that_eliminates_mates_is_that_of_all_unknowns_at_once(
    ranges: list[RangeMeasurement], fixes: list[FixMeasurement]
) -> None:
    """Tolerance: rounding of a system whose condition is some 1e4."""
    model = team()
    measured = Fixes(model, fixes), Ranges(model, ranges)
    elimination, precision = Elimination.of(model, *measured), model.prior_std() ** -2.0
    assert elimination is not None
    rng = np.random.default_rng(1)
    theta = 0.3 * model.prior_std() * rng.normal(size=model.size)
    rows = np.concatenate([each.derivatives(theta) for each in measured])
    information = rows.T @ rows + np.diag(precision)
    found = elimination.information(rows)
    assert np.abs(found - information).max() <= 1e-12 * np.abs(information).max()
    gradient = np.sqrt(precision) * rng.normal(size=model.size)
    scale = np.sqrt(precision)
    step, expected = elimination.step(rows, gradient), np.linalg.solve(information, gradient)
    assert np.abs(scale * (step - expected)).max() <= 1e-9 * np.abs(scale * expected).max()


def test_a_team_in_which_all_receive_has_nobody_to_eliminate() -> None:
    model = team()
    assert Elimination.of(model, Fixes(model, FIXES), Ranges(model, EVERYONE)) is None


@pytest.mark.parametrize("ranges", [TO_ONE, BETWEEN_MATES, EVERYONE, []])
def test_estimate_of_a_large_team_is_that_of_a_small_one(
    monkeypatch: pytest.MonkeyPatch, ranges: list[RangeMeasurement]
) -> None:
    """Tolerance: rounding, in prior standard deviations."""
    model, found = team(), []
    for limit in (model.size, model.size - 1):
        monkeypatch.setattr(gauss_newton, "MANY_UNKNOWNS", limit)
        fixes = Fixes(model, [*FIXES, fix_of(1, 700.0)])
        found.append(gauss_newton.solve(model, fixes, Ranges(model, ranges), None, np.zeros(model.size)))
    small, large = found
    scale = model.prior_std()
    assert large.refused == small.refused
    assert np.abs((large.theta - small.theta) / scale).max() <= 1e-7
    assert np.abs((large.covariance - small.covariance) / np.outer(scale, scale)).max() <= 1e-7


@pytest.mark.parametrize("centers", [400, 5, 0])
def test_strongest_modes_of_many_unknowns_are_those_of_all_modes(centers: int) -> None:
    """Of fewer centers than modes, and of none at all, the remaining modes have no effect."""
    rng, size = np.random.default_rng(4), 60
    root = np.linalg.cholesky(np.cov(rng.normal(size=(size, 200))))
    rows, fix = rng.normal(size=(centers, size)), rng.normal(size=(2, size)) @ root
    fixed = np.linalg.solve(np.linalg.cholesky(fix @ fix.T + np.eye(2)), fix)
    found = rows @ depth_sensitivity._strongest_of_many(root, rows.T @ rows, fixed)
    left = root @ np.linalg.cholesky(np.eye(size) - fixed.T @ fixed)
    every = rows @ left @ np.linalg.eigh(left.T @ rows.T @ rows @ left)[1][:, ::-1][:, : depth_sensitivity.MODES]
    assert found.shape == (centers, depth_sensitivity.MODES)
    assert np.abs(found @ found.T - every @ every.T).max(initial=0.0) <= 1e-9 * np.abs(every @ every.T).max(initial=1.0)
