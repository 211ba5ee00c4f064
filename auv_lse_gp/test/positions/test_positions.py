"""Positions known afterwards: the model of a vehicle's errors, and the smoother against truth and a batch solution."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from positions_helpers import STEADY, Ground, Sailed, messages, sail, smoother_of, surface, terrain_of
from scipy.optimize import least_squares

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.positions.error_model import TeamErrorModel
from auv_lse_gp.positions.measurements import within_gate
from auv_lse_gp.positions.smoother import PositionSmoother, SurfacingFixes
from auv_lse_gp.positions.terrain_matching import Terrain, TerrainLikelihood
from auv_lse_gp.positions.track import MateTrack, OwnTrack
from auv_lse_gp.positions.track_segments import segment_track

CONFIG = PositionsConfig(**STEADY)


def team_of(seed: int, config: PositionsConfig = CONFIG, legs: int = 60, vehicles: int = 3) -> list[Sailed]:
    rng = np.random.default_rng(seed)
    return [sail(rng, config, legs) for _ in range(vehicles)]


def track_of(sailed: Sailed) -> OwnTrack:
    track = OwnTrack()
    for t, (north, east), heading in zip(sailed.times, sailed.raw, sailed.headings, strict=True):
        track.add(t, north, east, heading)
    return track


def position_error_m(smoother: PositionSmoother, team: list[Sailed], number: int) -> float:
    """Root mean square of the position's error (m) of a vehicle (from 0) after smoothing."""
    correction, sailed = smoother.smooth(), team[number]
    error = correction.positions(number + 1, sailed.times, sailed.raw) - sailed.true
    return float(np.sqrt((error**2).sum(axis=1).mean()))


# ---------------------------------------------------------------- the model


def test_jacobian_agrees_with_finite_differences():
    model = TeamErrorModel(CONFIG, {1: track_of(team_of(0, vehicles=1)[0])}, references={1})
    rng = np.random.default_rng(1)
    theta = model.prior_std() * rng.standard_normal(model.size)
    vehicle = model.vehicles[1]
    sums = vehicle.positions(vehicle.track.at(np.array([0.0, 100.5, 700.0, 1433.0])))
    jacobian = sums.jacobian(theta)
    for i in range(vehicle.block.stop):
        step = np.zeros(model.size)
        step[i] = 1e-4 * model.prior_std()[i]
        difference = (sums.positions(theta + step) - sums.positions(theta - step)) / (2.0 * step[i])
        # the step's square is left: 1e-8 of a derivative of up to a kilometre
        assert np.allclose(jacobian[:, :, i], difference, atol=1e-4, rtol=1e-6)


def test_model_contains_the_simulated_errors():
    """With the true values of all unknowns, positions are true but for the harmonics' squares (1 degree: 0.3 mm/m)."""
    config = PositionsConfig(heading_walk_deg_rth=0.0, position_walk_m_rts=0.0)
    rng = np.random.default_rng(4)
    sailed = sail(rng, config, 60, walks=False)
    again = np.random.default_rng(4)
    sail(again, config, 60, walks=False)
    model = TeamErrorModel(config, {1: track_of(sailed)}, references={1})
    vehicle = model.vehicles[1]
    sums = vehicle.positions(vehicle.track.at(sailed.times, sailed.raw))

    def residuals(theta: np.ndarray) -> np.ndarray:
        return np.asarray((sums.positions(np.concatenate([theta, [0.0]])) - sailed.true).ravel())

    fit = least_squares(residuals, np.zeros(6), x_scale=vehicle.prior_std())
    assert np.sqrt((fit.fun**2).mean()) < 0.1
    assert np.all(np.abs(fit.x) < 4.5 * vehicle.prior_std())


def test_one_leg_worked_by_hand():
    """100 m north, compass 0.01 rad too large: the vehicle has gone 1 m to the west; a scale of .01 takes 1 m off."""
    track = OwnTrack()
    for second in range(101):
        track.add(float(second), float(second), 0.0, 0.0)
    model = TeamErrorModel(
        PositionsConfig(heading_walk_deg_rth=0.0, position_walk_m_rts=0.0), {1: track}, references={1}
    )
    sums = model.vehicles[1].positions(track.at(np.array([100.0])))
    theta = np.zeros(model.size)
    theta[2] = 0.01
    assert sums.positions(theta)[0] == pytest.approx([100.0 * math.cos(0.01), -100.0 * math.sin(0.01)])
    theta[2], theta[4] = 0.0, 0.01  # the harmonic that goes with cos psi, which is 1 here
    assert sums.positions(theta)[0] == pytest.approx([100.0, -1.0])
    theta[4], theta[3] = 0.0, 0.01  # the one that goes with sin psi, which is 0
    assert sums.positions(theta)[0] == pytest.approx([100.0, 0.0])
    theta[3], theta[5], theta[0] = 0.0, 0.01, 2.0
    assert sums.positions(theta)[0] == pytest.approx([100.0 / 1.01 - 2.0, 0.0])


def test_samples_are_placed_on_a_mates_track_in_order_of_time():
    sailed = team_of(3, vehicles=1)[0]
    track = MateTrack()
    track.add(0.0, *sailed.raw[0])
    worst = []
    for at in range(30, 1400, 30):
        track.add(float(at), *sailed.raw[at])
        chosen = np.unique(np.linspace(0, at - 1, 14).astype(int))  # of any age: a backlog
        times = track.times_of(sailed.raw[chosen])
        assert np.all(np.diff(times) >= 0.0)
        track.refine(times, sailed.raw[chosen])
        worst.append(float(np.quantile(np.abs(times - chosen), 0.9)))
    # between two packets of 30 s a sample's time is off by some seconds where the vehicle turned
    assert np.median(worst) < 10.0
    there = track.at(sailed.times)
    exact = track_of(sailed).at(sailed.times)
    # times one degree: what is left of the harmonics' error is below half a metre
    assert math.radians(1.0) * np.abs(there.sin_m - exact.sin_m).max() < 0.6


# ---------------------------------------------------------------- against truth, a batch solution, and itself


def test_without_measurements_the_estimate_is_the_prior():
    team = team_of(5, vehicles=1)
    smoother = smoother_of(CONFIG, team, 0, [])
    correction = smoother.smooth()
    assert correction.positions(1, team[0].times, team[0].raw) == pytest.approx(team[0].raw)
    prior = TeamErrorModel(CONFIG, {1: track_of(team[0])}, references={1}).prior_std()
    assert np.sqrt(np.diag(correction.covariance)) == pytest.approx(prior)
    assert PositionSmoother(1, CONFIG).smooth().positions(1, np.zeros(1), np.ones((1, 2))) == pytest.approx(
        np.ones((1, 2))
    )


def test_unknown_vehicle_keeps_its_raw_positions():
    correction = smoother_of(CONFIG, team_of(5, vehicles=1), 0, []).smooth()
    assert correction.positions(7, np.zeros(2), np.ones((2, 2))).tolist() == np.ones((2, 2)).tolist()
    assert not correction.jacobian(7, np.zeros(2), np.ones((2, 2))).any()
    assert np.isnan(correction.position_std_m(7, np.zeros(2), np.ones((2, 2)))).all()
    assert not correction.position(7, 0.0, np.ones(2))[1].any()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_smoother_agrees_with_a_batch_solution_with_all_tracks(seed: int):
    """scipy.optimize.least_squares on the whole problem, each second turned by its own error, all tracks known."""
    config = PositionsConfig(heading_walk_deg_rth=0.0, position_walk_m_rts=0.0)
    rng = np.random.default_rng(seed)
    team = [sail(rng, config, 60, walks=False) for _ in range(3)]
    for k, sailed in enumerate(team):
        surface(rng, sailed, 700 + 60 * k)
    heard = messages(rng, team, 0)
    prior = TeamErrorModel(config, {k + 1: track_of(s) for k, s in enumerate(team)}, references={1}).prior_std()

    def positions(k: int, theta: np.ndarray) -> np.ndarray:
        dn, de, b0, b1, b2, s = theta[6 * k : 6 * k + 6]
        way = np.diff(team[k].raw, axis=0)
        psi = team[k].headings[1:]
        turn = -(b0 + b1 * np.sin(psi) + b2 * np.cos(psi))
        north = way[:, 0] * np.cos(turn) - way[:, 1] * np.sin(turn)
        east = way[:, 0] * np.sin(turn) + way[:, 1] * np.cos(turn)
        start = team[k].raw[0] - [dn, de]
        return np.asarray(start + np.concatenate([np.zeros((1, 2)), np.cumsum(np.column_stack([north, east]), axis=0)])
                          / (1.0 + s))  # fmt: skip

    def residuals(theta: np.ndarray) -> np.ndarray:
        all_positions = [positions(k, theta) for k in range(3)]
        rows = [theta / prior]
        for k, sailed in enumerate(team):
            for fix in sailed.fixes:
                rows.append((np.array([fix.north_m, fix.east_m]) - all_positions[k][int(fix.stamp_s)]) / fix.std_m)
        for mate, _ in heard:
            at = int(mate.sent_s)
            r = float(np.linalg.norm(all_positions[mate.source - 1][at] - all_positions[0][at]))
            clock = 18 + 2 * (mate.source - 2)
            expected = (1.0 + theta[-1]) * r - theta[clock] - theta[clock + 1] * at * 1e-3
            if mate.travel_s * 1500.0 >= 20.0:
                rows.append(np.array([(mate.travel_s * 1500.0 - expected) / config.range_std_m]))
        return np.concatenate(rows)

    batch = least_squares(residuals, np.zeros(len(prior)), x_scale=prior)
    smoother = smoother_of(config, team, 0, heard)
    correction = smoother.smooth()
    for k, sailed in enumerate(team):
        ours = correction.positions(k + 1, sailed.times, sailed.raw)
        std = correction.position_std_m(k + 1, sailed.times, sailed.raw)
        last = correction.position(k + 1, float(sailed.times[-1]), sailed.raw[-1])[1]
        assert np.sqrt(np.diag(last)) == pytest.approx(std[-1])
        apart = np.abs(ours - positions(k, batch.x))
        # What differs is a mate's way between its packets: a part of what the answer itself leaves uncertain.
        assert np.sqrt((apart**2).mean()) < 0.5 * np.sqrt((std**2).mean())
    own = np.abs(correction.positions(1, team[0].times, team[0].raw) - positions(0, batch.x))
    assert own.max() < 0.6


@pytest.mark.parametrize(("config", "left"), [(CONFIG, 0.1), (PositionsConfig(), 0.8)], ids=["steady", "default"])
def test_estimated_covariance_is_consistent(config: PositionsConfig, left: float) -> None:
    """Normalized estimation error squared of the position, over seeds and vehicles: 1 expected of each axis."""
    own, mates, before, after = [], [], [], []
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        team = [sail(rng, config, 60) for _ in range(3)]
        surface(rng, team[seed % 3], 700)
        smoother = smoother_of(config, team, 0, messages(rng, team, 0))
        correction = smoother.smooth()
        for k, sailed in enumerate(team):
            at = np.array([400, 800, 1200, 1400])
            error = correction.positions(k + 1, sailed.times[at], sailed.raw[at]) - sailed.true[at]
            jacobian = correction.jacobian(k + 1, sailed.times[at], sailed.raw[at])
            for e, rows in zip(error, jacobian, strict=True):
                (own if k == 0 else mates).append(e @ np.linalg.solve(rows @ correction.covariance @ rows.T, e) / 2.0)
            before.append(((sailed.raw - sailed.true) ** 2).sum(axis=1).mean())
            after.append((error**2).sum(axis=1).mean())
    # of ten teams, whose four positions each are nearly one: mean 1, standard deviation about 0.25
    assert 0.4 < np.mean(own) < 1.7
    assert 0.4 < np.mean(mates) < 1.7
    assert np.mean(after) < left * np.mean(before)


def test_fix_of_a_mate_corrects_the_vehicle_too():
    rng = np.random.default_rng(11)
    team = [sail(rng, CONFIG, 60) for _ in range(3)]
    without = position_error_m(smoother_of(CONFIG, team, 0, messages(np.random.default_rng(1), team, 0)), team, 0)
    surface(rng, team[2], 700)
    with_fix = position_error_m(smoother_of(CONFIG, team, 0, messages(np.random.default_rng(1), team, 0)), team, 0)
    raw = math.sqrt(((team[0].raw - team[0].true) ** 2).sum(axis=1).mean())
    assert with_fix < 0.6 * raw
    assert with_fix < without


def test_wrong_ranges_are_rejected():
    clean, dirty, refused = [], [], 0
    for seed in range(4):
        rng = np.random.default_rng(40 + seed)
        team = [sail(rng, CONFIG, 60) for _ in range(3)]
        surface(rng, team[0], 700)
        clean.append(
            position_error_m(smoother_of(CONFIG, team, 0, messages(np.random.default_rng(1), team, 0)), team, 1)
        )
        heard = messages(np.random.default_rng(1), team, 0, outliers=0.05)
        smoother = smoother_of(CONFIG, team, 0, heard)
        dirty.append(position_error_m(smoother, team, 1))
        refused += smoother.smooth().refused
    assert refused >= 5
    assert np.mean(dirty) < 1.5 * np.mean(clean) + 0.5


def test_pings_give_ranges_without_accurate_clocks():
    """A clock that is 10 s off spoils one-way travel times, but no ping."""
    rng = np.random.default_rng(11)
    team = [sail(rng, CONFIG, 60) for _ in range(3)]
    surface(rng, team[2], 700)
    heard = [
        (dataclasses.replace(mate, travel_s=math.nan), samples)
        for mate, samples in messages(np.random.default_rng(1), team, 0)
    ]
    without = position_error_m(smoother_of(CONFIG, team, 0, heard), team, 0)
    smoother = smoother_of(CONFIG, team, 0, heard)
    for n, at in enumerate(range(45, len(team[0].times) - 60, 30)):
        mate = 1 + n % 2
        travel_s = math.dist(team[0].true[at], team[mate].true[at]) / 1500.0
        smoother.add_navigation(
            MateNavigation(
                stamp_s=float(team[0].times[at]), source=mate + 1, sent_s=math.nan, raw_north_m=math.nan,
                raw_east_m=math.nan, travel_s=travel_s,
            )
        )  # fmt: skip
    assert all(row.by_ping for row in smoother.ranges)
    assert position_error_m(smoother, team, 0) < 0.6 * without


def test_ping_range_waits_for_the_mates_next_position():
    team = team_of(3, vehicles=2)
    heard = messages(np.random.default_rng(1), team, 0)
    smoother = smoother_of(CONFIG, team, 0, heard[:5])
    last_s = heard[4][0].sent_s
    ping = MateNavigation(
        stamp_s=last_s + 5.0, source=2, sent_s=math.nan, raw_north_m=math.nan, raw_east_m=math.nan, travel_s=0.1
    )
    before = len(smoother.ranges)
    smoother.add_navigation(ping)
    assert len(smoother.ranges) == before
    smoother.add_navigation(dataclasses.replace(heard[5][0], travel_s=math.nan))
    assert len(smoother.ranges) == before + 1
    assert smoother.ranges[-1].by_ping


@pytest.mark.parametrize("heard_of", [1, 2])
def test_single_echo_is_ignored(heard_of: int):
    """Too few ranges for a median: 600 m too long is more than dead reckoning can be wrong by."""
    team = team_of(3, vehicles=2)
    heard = [
        (dataclasses.replace(mate, travel_s=mate.travel_s + 0.4), samples)
        for mate, samples in messages(np.random.default_rng(1), team, 0)[:heard_of]
    ]
    correction = smoother_of(CONFIG, team, 0, heard).smooth()
    assert correction.refused == heard_of
    assert correction.positions(1, team[0].times, team[0].raw) == pytest.approx(team[0].raw, abs=0.1)


def test_fix_of_a_broken_receiver_is_ignored():
    team = team_of(3, vehicles=1)
    raw_north, raw_east = (float(value) for value in team[0].raw[500])
    fix = Fix(
        stamp_s=500.0, north_m=raw_north + 2000.0, east_m=raw_east, raw_north_m=raw_north, raw_east_m=raw_east,
        std_m=1.0,
    )  # fmt: skip
    smoother = smoother_of(CONFIG, team, 0, [])
    smoother.add_fix(fix)
    correction = smoother.smooth()
    assert correction.refused == 1
    assert correction.positions(1, team[0].times, team[0].raw) == pytest.approx(team[0].raw, abs=0.1)
    believed = smoother_of(CONFIG, team, 0, [])
    believed.add_fix(dataclasses.replace(fix, north_m=raw_north + 40.0))
    assert believed.smooth().refused == 0


@pytest.mark.parametrize("surfaced", [1, 3])
def test_contradicted_fix_is_rejected(surfaced: int):
    """30 m off: dead reckoning alone could be wrong by as much, but not with the ranges to two mates."""
    rng = np.random.default_rng(100)
    team = [sail(rng, CONFIG, 60) for _ in range(3)]
    for number in range(surfaced):
        surface(rng, team[number], 600 + 60 * number)
    right = team[0].fixes.pop()
    without = smoother_of(CONFIG, team, 0, messages(np.random.default_rng(1), team, 0))
    team[0].fixes.append(dataclasses.replace(right, north_m=right.north_m + 30.0))
    wrong = smoother_of(CONFIG, team, 0, messages(np.random.default_rng(1), team, 0))
    assert wrong.smooth().refused == without.smooth().refused + 1
    assert position_error_m(wrong, team, 0) == pytest.approx(position_error_m(without, team, 0), abs=0.1)


def test_fixes_are_kept_if_all_instruments_are_worse_than_assumed():
    """Ten times worse: a gate that took the section for granted would refuse right fixes."""
    worse = dataclasses.replace(CONFIG, heading_std_deg=7.1, harmonic_std_deg=10.0, scale_std=0.03)
    rng = np.random.default_rng(103)
    team = [sail(rng, worse, 60)]
    surface(rng, team[0], 600)
    surface(rng, team[0], 1100)
    assert smoother_of(CONFIG, team, 0, []).smooth().refused == 0


def test_estimate_does_not_depend_on_the_time_origin():
    """A vehicle's stamps are UTC, those of a simulation begin at 0: clocks part at the start, not in 1970."""
    team = team_of(3, vehicles=2)
    surface(np.random.default_rng(2), team[1], 600)
    heard = messages(np.random.default_rng(1), team, 0)
    utc = 1.7e9
    later = [
        dataclasses.replace(
            sailed,
            times=sailed.times + utc,
            fixes=[dataclasses.replace(fix, stamp_s=fix.stamp_s + utc) for fix in sailed.fixes],
        )
        for sailed in team
    ]
    then = [(dataclasses.replace(m, stamp_s=m.stamp_s + utc, sent_s=m.sent_s + utc), s) for m, s in heard]
    correction, shifted = smoother_of(CONFIG, team, 0, heard).smooth(), smoother_of(CONFIG, later, 0, then).smooth()
    at, raw = team[0].times[::50], team[0].raw[::50]
    assert shifted.positions(1, at + utc, raw) == pytest.approx(correction.positions(1, at, raw), abs=1e-3)
    assert shifted.position_std_m(1, at + utc, raw) == pytest.approx(correction.position_std_m(1, at, raw), rel=1e-3)


def test_clock_set_back_does_not_stop_the_track():
    """By 30 s, as when a vehicle takes the time of GPS: the track, and the fix after it, go on."""
    team = team_of(3, vehicles=1)
    sailed, at = team[0], 700
    smoother = PositionSmoother(1, CONFIG)
    for t, (north, east), heading in zip(sailed.times, sailed.raw, sailed.headings, strict=True):
        stamp = t if t <= at else t - 30.0
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp, heading_rad=heading, north_m=north, east_m=east, depth_m=3.0)
        )
    assert smoother.refused == 1, "the first place after the step might have come late"
    assert smoother.clock.set_back_s == pytest.approx(30.0, abs=2.0)
    own = smoother.tracks[1]
    assert own.end_s == pytest.approx(sailed.times[-1], abs=2.0)
    assert own.nodes[-1, 1:3] == pytest.approx(sailed.raw[-1])
    raw_north, raw_east = (float(value) for value in sailed.raw[at + 500])
    smoother.add_fix(
        Fix(
            stamp_s=float(sailed.times[at + 500]) - 30.0, north_m=raw_north + 3.0, east_m=raw_east,
            raw_north_m=raw_north, raw_east_m=raw_east, std_m=1.0,
        )
    )  # fmt: skip
    assert smoother.fixes(1)[0].stamp_s == pytest.approx(sailed.times[at + 500], abs=2.0)


def test_single_late_raw_position_is_not_a_clock_set_back():
    smoother = PositionSmoother(1, CONFIG)
    for stamp in (0.0, 1.0, 2.0, 3.0, 4.0, 0.5, 5.0, 6.0, 1.5, 7.0):
        position = DeadReckoning(stamp_s=stamp, heading_rad=0.0, north_m=stamp, east_m=0.0, depth_m=3.0)
        smoother.add_dead_reckoning(position)
    assert smoother.clock.set_back_s == 0.0
    assert smoother.refused == 2
    assert smoother.tracks[1].end_s == 7.0


def test_lost_packets_and_wrong_clocks_are_tolerated():
    rng = np.random.default_rng(8)
    team = [sail(rng, CONFIG, 60) for _ in range(3)]
    surface(rng, team[0], 700)
    team[1].clock_s += 0.003
    heard = messages(rng, team, 0, lost=0.3, sound=0.005)
    correction = smoother_of(CONFIG, team, 0, heard).smooth()
    error = correction.positions(2, team[1].times, team[1].raw) - team[1].true
    std = correction.position_std_m(2, team[1].times, team[1].raw)
    assert np.sqrt((error**2).mean()) < 2.5 * np.sqrt((std**2).mean())


# ---------------------------------------------------------------- terrain


def test_terrain_aligns_tracks_without_information_on_common_modes():
    rng = np.random.default_rng(21)
    gp = GpConfig()
    team = [sail(rng, CONFIG, 60) for _ in range(2)]
    terrain = terrain_of(rng, team, 0, Ground(rng, gp), gp)
    model = TeamErrorModel(CONFIG, {k + 1: track_of(s) for k, s in enumerate(team)}, references={1})
    theta = np.zeros(model.size)
    precision = model.prior_std() ** -2.0
    slope, information = TerrainLikelihood(model, terrain).gradient(theta, precision)
    common = model.common_modes(theta)
    size = np.abs(information).max() * np.abs(common).max() ** 2
    assert np.abs(common.T @ information @ common).max() < 1e-9 * size
    assert np.abs(common.T @ slope).max() < 1e-9 * np.abs(slope).max() * np.abs(common).max() * 1e3


def test_terrain_alone_improves_positions():
    gains = []
    for seed in range(4):
        rng = np.random.default_rng(60 + seed)
        gp = GpConfig()
        team = [sail(rng, CONFIG, 60)]
        smoother = smoother_of(CONFIG, team, 0, [])
        correction = smoother.smooth(terrain_of(rng, team, 0, Ground(rng, gp), gp))
        error = correction.positions(1, team[0].times, team[0].raw) - team[0].true
        gains.append(np.sqrt((error**2).mean()) / np.sqrt(((team[0].raw - team[0].true) ** 2).mean()))
    assert np.mean(gains) < 0.8


def test_common_modes_move_all_positions_alike():
    team = team_of(2, vehicles=2)
    model = TeamErrorModel(
        PositionsConfig(heading_walk_deg_rth=0.0, position_walk_m_rts=0.0),
        {k + 1: track_of(s) for k, s in enumerate(team)},
        references={1},
    )
    theta = 0.3 * model.prior_std()
    stamps = np.array([100.0, 900.0])
    sums = {k: v.positions(v.track.at(stamps)) for k, v in model.vehicles.items()}
    positions = np.concatenate([s.positions(theta) for s in sums.values()])
    expected = (
        np.tile([1.0, 0.0], (4, 1)),
        np.tile([0.0, 1.0], (4, 1)),
        positions @ np.array([[0.0, 1.0], [-1.0, 0.0]]),  # J p
        positions,
    )
    common = model.common_modes(theta)
    for column, way in enumerate(expected):
        moved = np.concatenate(
            [sums[k].jacobian(theta) @ common[v.block, column] for k, v in model.vehicles.items()]
        )  # fmt: skip
        assert moved == pytest.approx(way, abs=1e-6)


def test_terrain_with_a_singular_covariance_is_ignored():
    team = team_of(2, vehicles=1)
    smoother = smoother_of(CONFIG, team, 0, [])
    raw = np.zeros((50, 2))
    pieces = segment_track(np.ones(50, dtype=np.int64), np.arange(50.0), raw, np.full(50, math.inf))
    assert len(pieces) == 0
    gp = GpConfig()
    broken = Terrain(
        segment_track(np.ones(3, dtype=np.int64), 30.0 * np.arange(3.0), 30.0 * np.ones((3, 2)), np.full(3, 9.0)),
        Kernel(gp),
        prior_mean(gp),
        0.0,
    )
    assert np.isfinite(smoother.smooth(broken).theta).all()
    assert np.isfinite(smoother.smooth(Terrain(pieces, Kernel(gp), prior_mean(gp), 0.3)).theta).all()


def test_segments_average_ten_metres_of_one_track():
    stamps = np.arange(40.0)
    raw = np.column_stack([np.arange(40.0), np.zeros(40)])
    vehicles = np.repeat([1, 2], 20)
    pieces = segment_track(vehicles, stamps, raw, np.arange(40.0))
    assert pieces.vehicles.tolist() == [1, 1, 2, 2]
    assert pieces.depths_m[0] == pytest.approx(4.5)
    assert pieces.raw_m[0] == pytest.approx([4.5, 0.0])
    far = segment_track(vehicles[:3], stamps[:3], np.array([[0.0, 0.0], [300.0, 0.0], [301.0, 0.0]]), stamps[:3])
    assert len(far) == 2


# ---------------------------------------------------------------- what may come in


def test_implausible_numbers_are_rejected_and_counted():
    team = team_of(9, vehicles=2)
    smoother = smoother_of(CONFIG, team, 0, messages(np.random.default_rng(2), team, 0))
    before = smoother.smooth().theta
    nan, inf = math.nan, math.inf
    taken = smoother.refused
    for stamp, north in ((nan, 0.0), (1e9, nan), (1e9, inf), (3.0, 0.0)):
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=stamp, heading_rad=0.0, north_m=north, east_m=0.0, depth_m=3.0)
        )
    for value in (nan, inf):
        smoother.add_fix(Fix(stamp_s=1.0, north_m=value, east_m=0.0, raw_north_m=0.0, raw_east_m=0.0, std_m=1.0))
    for source, sent, north in ((1, 2000.0, 0.0), (2, nan, nan), (2, 5.0, 0.0), (2, 2000.0, 1e7), (2, 2000.0, nan)):
        smoother.add_navigation(
            MateNavigation(stamp_s=sent + 1.0, source=source, sent_s=sent, raw_north_m=north, raw_east_m=0.0)
        )
    assert np.isnan(smoother.add_sample_positions(3, np.ones((2, 2)))).all()
    assert np.isnan(smoother.add_sample_positions(2, np.full((2, 2), nan))).all()
    assert smoother.refused == taken + 4 + 2 + 5
    assert smoother.smooth().theta == pytest.approx(before, abs=1e-3)


def test_first_packet_from_an_impossible_position_is_rejected():
    smoother = PositionSmoother(1, CONFIG)
    for t in range(60):
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=float(t), heading_rad=0.0, north_m=float(t), east_m=0.0, depth_m=3.0)
        )
    far = MateNavigation(stamp_s=60.0, source=2, sent_s=59.0, raw_north_m=1400.0, raw_east_m=0.0)
    smoother.add_navigation(far)
    assert (smoother.refused, list(smoother.tracks)) == (1, [1])
    smoother.add_navigation(dataclasses.replace(far, raw_north_m=1200.0))
    assert list(smoother.tracks) == [1, 2]


def test_wrong_first_packet_does_not_block_later_ones():
    """700 m off: the packets after it were refused until the mate could have gone there, two minutes later."""
    team = team_of(3, vehicles=2)
    heard = messages(np.random.default_rng(1), team, 0)[:8]
    first, samples = heard[0]
    wrong = dataclasses.replace(
        first, raw_north_m=first.raw_north_m + 700.0, fix_north_m=0.0, fix_east_m=0.0, fix_raw_north_m=700.0,
        fix_raw_east_m=0.0,
    )  # fmt: skip
    smoother = smoother_of(CONFIG, team, 0, [(wrong, samples + np.array([700.0, 0.0])), *heard[1:]])
    without = smoother_of(CONFIG, team, 0, heard[1:])
    assert smoother.refused == 1, "one of the first two was wrong"
    assert smoother.fixes(2) == []
    assert len(smoother.ranges) == len(without.ranges)
    assert smoother.tracks[2].nodes[-1, 1:3] == pytest.approx(without.tracks[2].nodes[-1, 1:3])
    # once confirmed, one wrong packet changes nothing
    last = heard[-1][0]
    smoother.add_navigation(dataclasses.replace(last, sent_s=last.sent_s + 1.0, raw_north_m=last.raw_north_m + 700.0))
    assert smoother.refused == 2
    assert smoother.tracks[2].nodes[-1, 1:3] == pytest.approx(without.tracks[2].nodes[-1, 1:3])


def test_extreme_ranges_and_fixes_leave_finite_positions():
    team = team_of(9, vehicles=2)
    smoother = smoother_of(CONFIG, team, 0, [])
    for i, travel in enumerate((math.nan, math.inf, -1.0, 0.0, 1e9, 1e-3, 0.5)):
        smoother.add_navigation(
            MateNavigation(
                stamp_s=30.0 * i + 30.2, source=2, sent_s=30.0 * i + 30.0, raw_north_m=0.0, raw_east_m=0.0,
                travel_s=travel, fix_north_m=1e12, fix_east_m=0.0, fix_raw_north_m=math.nan, fix_raw_east_m=0.0,
            )
        )  # fmt: skip
    correction = smoother.smooth()
    assert len(smoother.ranges) == 1
    assert np.isfinite(correction.positions(1, team[0].times, team[0].raw)).all()
    assert np.isfinite(correction.positions(2, np.array([10.0]), np.array([[3.0, 4.0]]))).all()


def test_fixes_of_one_surfacing_count_as_one():
    surfacings = SurfacingFixes(1)
    for second in range(30):
        surfacings.add(
            Fix(stamp_s=600.0 + second, north_m=second, east_m=0.0, raw_north_m=second, raw_east_m=1.0, std_m=1.0)
        )
    surfacings.add(Fix(stamp_s=1200.0, north_m=0.0, east_m=0.0, raw_north_m=0.0, raw_east_m=1.0, std_m=1.0))
    rows = surfacings.rows(0.5)
    assert [row.stamp_s for row in rows] == [614.5, 1200.0]
    assert rows[0].std_m == 1.0
    assert rows[0].position_m == pytest.approx((14.5, 0.0))


def test_gate_is_four_median_deviations_with_a_minimum():
    residuals = np.concatenate([np.linspace(-1.0, 1.0, 41), [9.0, -30.0]])
    assert within_gate(residuals).tolist() == [True] * 41 + [False] * 2
    assert within_gate(np.array([0.0, 0.0, 1e-9, 1.5])).all()
    assert within_gate(np.zeros(0)).tolist() == []


def test_same_messages_give_identical_positions():
    team = team_of(13)
    heard = messages(np.random.default_rng(3), team, 0)
    once, again = (smoother_of(CONFIG, team, 0, heard).smooth().theta for _ in range(2))
    assert np.array_equal(once, again)
