"""A simulated vehicle: on its legs, against currents, waiting, pinging."""

import math
from dataclasses import replace

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import from_mapping
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.mission_file.sections.world import CurrentConfig
from auv_lse_common.support.compiled import plain
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.vehicle import motion_model as mm
from auv_lse_sim.vehicle.records import RESULT
from auv_lse_sim.vehicle.vehicle import SimVehicle
from auv_lse_sim.water.current import Current

TABLE = MotionTable(MotionConfig())
IDEAL = {"ideal": True}
STRAIGHT, RIGHT, LEFT = 5, 10, 0
HOLD = Stop(action=Action.HOLD)


def sim_config(**sections) -> SimConfig:
    return from_mapping(SimConfig, sections, "test: sim")


class Dive:
    """Drives one vehicle tick by tick over flat ground, giving it legs as a planner would."""

    def __init__(self, sim: SimConfig, seed=1, water_m=20.0, **vehicle):
        self.vehicle = SimVehicle(1, VehicleConfig(**vehicle), sim, stream(seed, "sensors", 1))
        self.current = Current(sim.current, stream(seed, "current"), sim.ideal)
        self.water_m = water_m
        self.now_s = 0.0
        self.state = np.array(
            [self.vehicle.config.start_heading_rad, self.vehicle.config.start_north_m, self.vehicle.config.start_east_m]
        )
        self.step = 0
        self.soundings, self.rows, self.off = [], [], []

    def command(self, action: int) -> Leg:
        leg = TABLE.leg(self.step, self.state, action)
        self.state, self.step = TABLE.end_state(self.state, action), self.step + 1
        self.vehicle.command(leg)
        return leg

    def tick(self) -> None:
        start, self.now_s = self.now_s, self.now_s + 1.0
        stamps = start + np.arange(1, 11) / 10.0
        north, _ = self.vehicle.move(stamps, self.current.advance(start, stamps))
        self.rows.append(self.vehicle._results)
        self.soundings.append(self.vehicle.sense(np.full(len(north), self.water_m)))

    def fly(self, actions) -> None:
        """Travels the legs, each commanded while the one before it is travelled."""
        legs = []
        for action in actions:
            while legs and self.vehicle.step < legs[-1].step:
                self.tick()
                assert self.now_s < 5000.0
            legs.append(self.command(action))
        while not self.vehicle.truth(0.0).loitering:
            self.tick()
            assert self.now_s < 5000.0


def results(dive: Dive):
    """What the motion model left of every sub-step, as records."""
    return np.rec.fromarrays([np.concatenate(column) for column in zip(*dive.rows, strict=True)], dtype=RESULT)


def numbers(dive: Dive):
    """The same as rows of numbers."""
    return np.concatenate([[row.tolist() for row in rows] for rows in dive.rows])


def positions(rows, kind=""):
    """North and east (n, 2) of records: true, "est_" or "raw_"."""
    return np.column_stack([rows[kind + "north"], rows[kind + "east"]])


def path_error(dive: Dive, start, actions) -> float:
    """Largest distance of the true track from the legs' positions, after the first leg."""
    state, legs = np.array(start, float), []
    for action in actions:
        leg = TABLE.leg(0, state, action)
        legs.append([leg.state_at(along)[1:] for along in np.arange(0.0, leg.length_m, 0.05)])
        state = TABLE.end_state(state, action)
    on_legs = np.concatenate(legs)
    rows = results(dive)
    track = positions(rows[(rows.travelled > 30.0) & (rows.travelled < 23.5 * len(actions))])
    return max(float(np.hypot(*(on_legs - p).T).min()) for p in track[::5])


ACTIONS = [5, RIGHT, 8, 2, LEFT, 5, LEFT, 9, 1, RIGHT, RIGHT, 5]


def test_ideal_vehicle_is_exactly_on_its_legs():
    dive = Dive(sim_config(**IDEAL), start_heading_rad=0.4)
    dive.fly(ACTIONS)
    assert path_error(dive, [0.4, 0.0, 0.0], ACTIONS) < 0.03  # half the spacing the legs are sampled at
    # 12 legs of r * theta_max at 1.5 m/s, to the tick.
    expected = len(ACTIONS) * 15.0 * math.pi / 2.0 / 1.5
    assert expected <= dive.now_s < expected + 1.0
    o = dive.vehicle.odometry(dive.now_s)
    t = dive.vehicle.truth(dive.now_s)
    assert (o.north_m, o.east_m, o.heading_rad) == (t.north_m, t.east_m, t.heading_rad)
    assert o.speed_mps == pytest.approx(1.5)
    assert not o.covariance.any()


def test_positions_between_ticks_are_those_of_the_leg():
    dive = Dive(sim_config(**IDEAL))
    leg = dive.command(RIGHT)
    for _ in range(5):
        dive.tick()
    heading, north, east = leg.state_at(5.0 * 1.5)
    t = dive.vehicle.truth(5.0)
    assert (t.heading_rad, t.north_m, t.east_m) == pytest.approx((heading, north, east), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_steered_vehicle_stays_near_its_legs(seed):
    sim = sim_config(navigation=IDEAL, current=IDEAL)
    dive = Dive(sim, seed)
    dive.fly(ACTIONS)
    assert path_error(dive, [0.0, 0.0, 0.0], ACTIONS) < 1.0
    assert path_error(dive, [0.0, 0.0, 0.0], ACTIONS) > 0.05  # it is not on rails


@pytest.mark.parametrize("heading", [0.0, 1.5, 3.0, -1.5])
def test_current_across_is_compensated(heading):
    sim = sim_config(navigation=IDEAL, current={"north_mps": 0.3, "east_mps": -0.2, "random_mps": 0.0})
    dive = Dive(sim, start_heading_rad=heading)
    dive.fly([STRAIGHT] * 8)
    assert path_error(dive, [heading, 0.0, 0.0], [STRAIGHT] * 8) < 0.6


def test_current_changes_the_time_a_leg_takes():
    def duration(north_mps: float, sim_sections) -> float:
        dive = Dive(sim_config(current={"north_mps": north_mps, "random_mps": 0.0}, **sim_sections))
        dive.fly([STRAIGHT] * 6)
        return dive.now_s

    for sections in ({"navigation": IDEAL, "dynamics": IDEAL}, {"navigation": IDEAL}):
        length = 6 * 15.0 * math.pi / 2.0
        assert duration(0.3, sections) == pytest.approx(length / 1.8, rel=0.07)  # 3 s to get up to speed, 2 % of spread
        assert duration(-0.3, sections) == pytest.approx(length / 1.2, rel=0.07)


def test_rails_crab_against_a_cross_current():
    sim = sim_config(navigation=IDEAL, dynamics=IDEAL, current={"east_mps": 0.9, "random_mps": 0.0})
    dive = Dive(sim)
    dive.fly([STRAIGHT] * 4)
    # 1.5 m/s through the water, 0.9 of it against the current: 1.2 remain ahead.
    assert dive.now_s == pytest.approx(4 * 15.0 * math.pi / 2.0 / 1.2, abs=1.0)
    assert abs(dive.vehicle.truth(0.0).east_m) < 25.0  # it then circles at the leg's end


def test_start_delay_and_waiting_at_the_surface():
    dive = Dive(sim_config(), start_delay_s=12.5)
    dive.command(STRAIGHT)
    for _ in range(12):
        dive.tick()
        assert dive.vehicle.position == (0.0, 0.0, 0.0)
    for _ in range(30):
        dive.tick()
    north, _, depth = dive.vehicle.position
    assert north > 20.0
    assert depth == pytest.approx(3.0, abs=0.3)
    rows = results(dive)
    moving = np.flatnonzero(rows.travelled > 0.0)[0]
    assert moving == 125  # sub-steps of 0.1 s


def test_speed_differs_between_vehicles():
    fast, slow = (Dive(sim_config(**IDEAL), speed_mps=v) for v in (2.0, 1.0))
    for dive in (fast, slow):
        dive.fly([STRAIGHT] * 3)
    assert slow.now_s == pytest.approx(2 * fast.now_s, abs=1.5)
    spread = [SimVehicle(1, VehicleConfig(), sim_config(), stream(s, "sensors", 1))._params.speed for s in range(300)]
    assert np.std(spread) == pytest.approx(0.02 * 1.5, rel=0.15)
    assert np.mean(spread) == pytest.approx(1.5, abs=0.006)


@pytest.mark.parametrize("ideal", [True, False])
def test_without_a_next_leg_it_circles_and_then_goes_on(ideal):
    dive = Dive(sim_config(**IDEAL) if ideal else sim_config(navigation=IDEAL, current=IDEAL))
    dive.command(STRAIGHT)
    for _ in range(40):
        dive.tick()
    truth = dive.vehicle.truth(dive.now_s)
    assert truth.loitering
    end = dive.state
    center = np.array([end[1], end[2] + 15.0])
    rows = results(dive)
    circling = positions(rows[rows.travelled > 40.0])
    assert np.abs(np.hypot(*(circling - center).T) - 15.0).max() < (1e-6 if ideal else 1.0)
    dive.command(STRAIGHT)  # from where the first leg ended: on rails it is taken when the circle closes
    while dive.vehicle.step == 0:
        dive.tick()
        assert dive.now_s < 200.0
    if not ideal:
        return  # the next test says where it goes then
    for _ in range(10):
        dive.tick()
    t = dive.vehicle.truth(dive.now_s)
    assert not t.loitering
    assert abs(t.east_m) < 1e-6
    assert t.north_m > end[1]


@pytest.mark.parametrize("late_s", [3, 12, 30])
@pytest.mark.parametrize("action", [LEFT, STRAIGHT, RIGHT])
def test_a_leg_that_comes_late_is_steered_to_at_once(late_s, action):
    """It began where the vehicle circles: with the circle's rest it would cost up to 63 s more."""
    dive = Dive(sim_config(navigation=IDEAL, current=IDEAL))
    dive.command(STRAIGHT)
    while not dive.vehicle.truth(0.0).loitering:
        dive.tick()
    for _ in range(late_s):
        dive.tick()
    came_s, leg = dive.now_s, dive.command(action)
    while not dive.vehicle.truth(0.0).loitering:
        dive.tick()
        assert dive.now_s < came_s + 63.0 + 16.0  # a turn that leads back may take longer than the leg alone
    north, east = dive.vehicle.position[:2]
    assert dive.vehicle.step == 1
    assert math.dist((north, east), leg.end_state[1:]) < 5.0  # it may pass at 4 m


def test_circles_to_the_freer_side():
    vehicle = SimVehicle(1, VehicleConfig(), sim_config(**IDEAL), stream(1, "sensors", 1), lambda n, e: -e)
    dive = Dive(sim_config(**IDEAL))
    dive.vehicle = vehicle
    dive.command(STRAIGHT)
    for _ in range(40):
        dive.tick()
    assert vehicle.truth(0.0).east_m < -1.0


@pytest.mark.parametrize("turn_rad", [0.0, 4e-4, -4e-4])  # a straight, and one rounded on its way by MAVLink
def test_after_a_straight_leg_it_circles_to_starboard(turn_rad):
    vehicle = SimVehicle(1, VehicleConfig(), sim_config(**IDEAL), stream(1, "sensors", 1))
    dive = Dive(sim_config(**IDEAL))
    dive.vehicle = vehicle
    vehicle.command(
        Leg(step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, action_rad=turn_rad, radius_m=15.0, straight_m=23.5)
    )
    for _ in range(40):
        dive.tick()
    assert vehicle.truth(0.0).loitering
    assert vehicle.truth(0.0).east_m > 1.0


@pytest.mark.parametrize("ideal", [True, False])
def test_a_leg_from_elsewhere_is_taken_at_once(ideal):
    dive = Dive(sim_config(**IDEAL) if ideal else sim_config(navigation=IDEAL))
    dive.command(STRAIGHT)
    for _ in range(6):
        dive.tick()
    leg = Leg(step=7, heading_rad=0.3, north_m=12.0, east_m=4.0, action_rad=0.0, radius_m=15.0, straight_m=60.0)
    dive.vehicle.command(leg)
    dive.tick()
    assert dive.vehicle.step == 7
    for _ in range(30):
        dive.tick()
    t = dive.vehicle.truth(dive.now_s)
    assert leg.distance_off_m(t.north_m, t.east_m) < 0.5


def test_soundings_have_the_noise_asked_for():
    sim = sim_config(
        navigation=IDEAL, dynamics=IDEAL, pressure=IDEAL, dvl=IDEAL,
        altimeter={"sounding_every_s": 0.0, "outlier_share": 0.0},
    )  # fmt: skip
    dive = Dive(sim)
    dive.fly([STRAIGHT] * 20)
    soundings = np.concatenate(dive.soundings)
    assert len(soundings) == round(dive.now_s * 10)  # every ping
    assert soundings[:, 3].std() == pytest.approx(0.012, rel=0.06)
    assert soundings[:, 3].mean() == pytest.approx(20.0, abs=0.002)
    assert (np.diff(soundings[:, 0]) > 0).all()


def test_median_keeps_outliers_out():
    def errors(every_s: float) -> np.ndarray:
        sim = sim_config(
            navigation=IDEAL, pressure=IDEAL, altimeter={"sounding_every_s": every_s, "outlier_share": 0.02}
        )
        dive = Dive(sim)
        dive.fly([STRAIGHT] * 30)
        return np.abs(np.concatenate(dive.soundings)[:, 3] - 20.0)

    raw, median = errors(0.0), errors(1.0)
    assert (raw > 0.5).mean() == pytest.approx(0.02, rel=0.4)
    assert (median > 0.5).sum() == 0


def test_gaps_last_as_long_as_asked_for():
    sim = sim_config(navigation=IDEAL, dvl={"dropouts_per_h": 200.0, "lock_losses_per_h": 0.0})
    dive = Dive(sim)
    dive.fly([STRAIGHT] * 120)
    ping = results(dive).ping
    edges = np.flatnonzero(np.diff(np.concatenate([[1], ping, [1]])))
    lengths = np.diff(edges)[::2] / 10.0
    assert len(lengths) == pytest.approx(200.0 * dive.now_s / 3600.0, rel=0.35)
    assert lengths.min() >= 0.4
    assert lengths.max() <= 2.7 or (lengths > 2.1).mean() < 0.05  # two gaps may meet


def test_no_echo_out_of_reach():
    for water in (120.0, math.nan):
        dive = Dive(sim_config(), water_m=water)
        dive.fly([STRAIGHT] * 2)
        assert not len(np.concatenate(dive.soundings))
        assert math.isnan(dive.vehicle.altitude_m)
    aground = Dive(sim_config(), water_m=2.0)
    aground.fly([STRAIGHT] * 2)
    assert aground.vehicle.groundings > 0


def test_pressure_has_noise_and_an_offset_per_run():
    depths = []
    for seed in range(60):
        dive = Dive(sim_config(dynamics=IDEAL), seed)
        dive.command(STRAIGHT)
        dive.tick()
        depths.append(dive.vehicle.pressure_depth_m - 3.0)
    assert np.std(depths) == pytest.approx(math.hypot(0.01, 0.03), rel=0.3)


def test_surfacing_brings_fixes():
    sim = sim_config(gps={"surface_every_s": 200.0, "surface_s": 40.0}, compass={"bias_deg": 3.0})
    dive = Dive(sim)
    errors, depths = [], []
    for step in range(40):
        dive.fly([STRAIGHT]) if step == 0 else dive.command(STRAIGHT)
        while dive.vehicle.step < step or dive.vehicle._m.along < 15.0:
            dive.tick()
            errors.append(np.hypot(*dive.vehicle.error[:2]))
            depths.append(dive.vehicle.position[2])
    errors, depths = np.array(errors), np.array(depths)
    up = depths < 0.3
    assert 0.05 < up[50:].mean() < 0.3
    ends = np.flatnonzero(up[1:-1] & ~up[2:]) + 1
    assert errors[ends].max() < 1.5


@pytest.mark.parametrize("depth_m", [3.0, 12.0])
def test_time_at_the_surface_is_counted_at_the_surface(depth_m):
    """A climb of 40 s (12 m at 0.3 m/s) is longer than the 30 s that the vehicle is to stay up."""
    sim = sim_config(gps={"surface_every_s": 60.0, "surface_s": 30.0}, dynamics={"depth_wobble_m": 0.0})
    dive = Dive(sim, depth_m=depth_m)
    dive.command(STRAIGHT)  # then it circles
    for _ in range(500):
        dive.tick()
    depths = results(dive).depth
    up = depths <= sim.gps.antenna_m
    begins = np.flatnonzero(~up[:-1] & up[1:]) + 1
    ends = np.flatnonzero(up[:-1] & ~up[1:]) + 1
    ends = ends[ends > begins[0]]
    count = min(len(begins), len(ends))
    assert count >= 3
    # Sub-steps of 0.1 s: 30 s up, and the second that the way down to the antenna's depth takes.
    assert (ends[:count] - begins[:count]) == pytest.approx(np.full(count, 310.0), abs=15.0)
    # From one surfacing to the next: 30 s up, the dive, 60 s to the next climb, and the climb.
    period = 900.0 + (2.0 * depth_m - 0.3) / 0.03
    assert np.diff(begins) == pytest.approx(np.full(len(begins) - 1, period), abs=15.0)
    assert depths.max() == pytest.approx(depth_m, abs=0.1)


def test_a_gps_without_noise_is_believed_at_the_start_and_at_the_surface():
    dive = Dive(sim_config(gps={"noise_m": 0.0, "surface_every_s": 60.0, "surface_s": 30.0}, compass={"bias_deg": 3.0}))
    dive.command(STRAIGHT)  # then it circles
    ups = 0
    for _ in range(300):
        dive.tick()
        if dive.vehicle.position[2] <= 0.0:
            ups += 1
            assert np.hypot(*dive.vehicle.error[:2]) < 1.0, "it drifts for at most one second between fixes"
    assert ups > 20


@pytest.mark.parametrize("ideal", [False, True])
def test_surfacing_costs_its_time(ideal):
    """It stops, climbs 3 m, waits 30 s, dives 3 m at 0.3 m/s, and goes on: 50 s and what stopping and starting take."""
    sections = {"dynamics": IDEAL, "navigation": IDEAL} if ideal else {"dynamics": {"depth_wobble_m": 0.0}}

    def flown(every_s: float) -> Dive:
        dive = Dive(sim_config(gps={"surface_every_s": every_s}, current=IDEAL, **sections))
        dive.fly([STRAIGHT] * 6)
        return dive

    free, once = flown(0.0), flown(60.0)
    assert once.now_s - free.now_s == pytest.approx(49.0 if ideal else 50.0, abs=2.0)
    rows = results(once)
    held = rows.depth <= 0.3
    moved = np.hypot(*np.ptp(positions(rows[600:][held[600:]][20:]), axis=0))
    assert moved < (1e-9 if ideal else 0.5), "it stays where it came up"
    assert path_error(once, [0.0, 0.0, 0.0], [STRAIGHT] * 6) < (0.03 if ideal else 3.0), "and goes on along its leg"


def test_a_fix_moves_the_estimate_and_not_the_raw_position():
    sections = {"compass": {"bias_deg": 4.0}, "gps": {"surface_every_s": 150.0}}
    dive, never = Dive(sim_config(**sections)), Dive(sim_config(compass={"bias_deg": 4.0}))
    fixes = []
    for d in (dive, never):
        d.command(STRAIGHT)
    for tick in range(240):
        for d in (dive, never):
            if tick % 16 == 10:
                d.command(STRAIGHT)
            d.tick()
        fixes += dive.vehicle.fixes
        if not fixes and tick < 150:  # the same until the first surfacing
            assert np.array_equal(dive.rows[-1], never.rows[-1])
    rows = results(dive)
    raw, estimate, truth = (positions(rows, kind) for kind in ("raw_", "est_", ""))
    assert np.array_equal(raw[:1500], estimate[:1500])
    (fix,) = fixes
    i = round(fix.stamp_s * 10.0) - 1
    assert rows[i].depth > 0.3 >= rows[i - 1].depth, "complete when it dives"
    assert (fix.raw_north_m, fix.raw_east_m) == tuple(raw[i])
    # 30 readings a second apart, correlated over 20 s: 1 m / sqrt(1 + 29 (1 - f) / (1 + f)), f = exp(-1 / 20)
    assert fix.std_m == pytest.approx(0.76, abs=0.02)
    off = np.hypot(*(np.array([fix.north_m, fix.east_m]) - truth[i]))
    assert off < 4.0 * fix.std_m < np.hypot(*(raw[i] - truth[i])), "better than the dead-reckoned position"
    assert np.hypot(*(estimate[i] - truth[i])) < 3.0
    jumps, corrected = (np.hypot(*np.diff(positions, axis=0).T).max() for positions in (raw, estimate))
    assert jumps < 1.0 < 4.0 < corrected, "the dead-reckoned position does not jump with the fix"
    raw_soundings = np.concatenate(dive.soundings)
    assert raw_soundings.shape[1] == 6
    late = raw_soundings[raw_soundings[:, 0] > fix.stamp_s]
    assert np.abs(late[:, 4:] - late[:, 1:3]).max() > 1.0
    assert dive.vehicle.dead_reckoning(1.0).north_m == raw[-1, 0]


def test_what_a_compass_makes_of_the_heading_does_not_shift_the_chance_of_the_rest():
    def flown(harmonic_deg: float) -> Dive:
        dive = Dive(sim_config(compass={"harmonic_deg": harmonic_deg}, navigation=IDEAL))
        dive.fly([STRAIGHT, RIGHT])
        return dive

    without, with_it = flown(0.0), flown(1.0)
    assert np.array_equal(results(without), results(with_it))
    names = ["gyro_bias", "compass_bias", "dvl_scale"]
    assert all(without.vehicle._m[name] == with_it.vehicle._m[name] for name in names)
    assert all(with_it.vehicle._m[name] != 0.0 for name in ("compass_sin", "compass_cos"))


def test_gps_errors_are_correlated_over_seconds():
    """While it waits, each reading is the truth and an error of 1 m that takes 20 s to change."""
    errors = []
    for seed in range(40):
        dive = Dive(sim_config(), seed, start_delay_s=86_400.0)
        for _ in range(60):
            dive.tick()
            errors.append(dive.vehicle._m.gps_error_north)
    errors = np.reshape(errors, (40, 60))
    assert errors.std() == pytest.approx(1.0, abs=0.2)  # 40 dives of 3 correlation times
    assert (errors[:, :-1] * errors[:, 1:]).mean() / errors.var() == pytest.approx(np.exp(-1 / 20), abs=0.03)


def test_one_part_made_ideal_does_not_shift_the_chance_of_the_others():
    def biases(**sections) -> np.ndarray:
        dive = Dive(sim_config(**sections))
        dive.command(STRAIGHT)
        for _ in range(20):
            dive.tick()
        return np.array([dive.vehicle._m.compass_bias, dive.vehicle._m.dvl_scale])

    assert np.array_equal(biases(), biases(gyro=IDEAL))
    assert np.array_equal(biases()[1:], biases(compass=IDEAL)[1:])
    assert biases(compass=IDEAL)[0] == 0.0


@pytest.mark.parametrize("part", ["gyro", "compass", "dvl"])
def test_each_ideal_instrument_makes_navigation_better(part):
    def rms(**sections) -> float:
        total = 0.0
        for seed in range(12):
            dive = Dive(sim_config(current=IDEAL, **sections), seed)
            dive.fly([STRAIGHT] * 12)
            e = dive.vehicle.error
            total += float(e[:2] @ e[:2])
        return math.sqrt(total / 12)

    # Everything else ideal, so that this instrument's error stands alone.
    others = {p: IDEAL for p in ("gyro", "compass", "dvl", "gps") if p != part}
    alone, none = rms(**others), rms(**others, **{part: IDEAL})
    assert none < 0.25  # what the filter's sub-step of 0.1 s leaves in 280 m
    if part == "gyro":  # an ideal compass leaves it nothing to spoil
        assert alone < 0.3
    else:
        assert alone > 2.0 * none


def test_plain_python_moves_alike():
    """The compiled sub-steps and the plain ones give the same numbers, to rounding."""
    a, b = Dive(sim_config()), Dive(sim_config())
    for dive in (a, b):
        dive.command(RIGHT)
    for _ in range(3):
        a.tick()
    compiled_advance = mm.advance
    mm.advance = plain(mm.advance)
    try:
        for _ in range(3):
            b.tick()
    finally:
        mm.advance = compiled_advance
    assert np.allclose(numbers(a), numbers(b), rtol=1e-9, atol=1e-12)


def test_current_is_what_was_asked_for():
    config = CurrentConfig(
        north_mps=0.2, tide_mps=0.5, tide_heading_deg=90.0, tide_period_s=1000.0, random_mps=0.1, random_time_s=50.0
    )
    current = Current(config, stream(1, "current"))
    flow = np.concatenate([current.advance(t, t + np.arange(1, 11) / 10.0) for t in np.arange(0.0, 30_000.0, 1.0)])
    times = np.arange(1, len(flow) + 1) / 10.0
    rest = flow - np.array([0.2, 0.0])
    rest[:, 1] -= 0.5 * np.cos(2 * np.pi * times / 1000.0)
    assert rest.std() == pytest.approx(0.1, rel=0.1)
    assert abs(rest.mean()) < 0.02
    lag = np.mean(rest[:-500] * rest[500:]) / np.mean(rest**2)  # 50 s: one correlation time
    assert lag == pytest.approx(math.exp(-1.0), abs=0.1)
    assert np.abs(np.diff(flow, axis=0)).max() < 0.05


def settle(dive: Dive, ticks: int) -> None:
    for _ in range(ticks):
        dive.tick()


@pytest.mark.parametrize("sim", [sim_config(**IDEAL), sim_config()], ids=["ideal", "real"])
def test_a_vehicle_told_to_hold_stays_there_and_then_travels_its_leg_to_the_end(sim) -> None:
    dive = Dive(sim)
    dive.command(STRAIGHT)
    settle(dive, 8)
    dive.command(RIGHT)
    held_at = np.array(dive.vehicle.position[:2])
    dive.vehicle.obey(HOLD)
    for _ in range(120):
        dive.tick()
        assert np.hypot(*(np.array(dive.vehicle.position[:2]) - held_at)) < 2.0 * 15.0 + 5.0
    assert dive.vehicle.step == 0
    assert not dive.vehicle.truth(0.0).loitering, "its mission is not over"
    end = dive.command(LEFT).end_state  # decided while it held
    dive.vehicle.obey(None)
    for _ in range(200):
        dive.tick()
        if dive.vehicle.truth(0.0).loitering:
            break
    assert dive.vehicle.step == 2
    rows = results(dive)[-600:]
    assert np.hypot(rows.est_north - end[1], rows.est_east - end[2]).min() < 3.0


def test_a_vehicle_told_to_surface_comes_up_and_dives_again() -> None:
    dive = Dive(sim_config(), depth_m=4.0)
    dive.command(STRAIGHT)
    settle(dive, 10)
    assert dive.vehicle.position[2] > 2.0
    dive.vehicle.obey(Stop(action=Action.SURFACE))
    settle(dive, 30)
    assert dive.vehicle.position[2] == 0.0
    dive.vehicle.obey(None)
    settle(dive, 20)
    assert dive.vehicle.position[2] > 2.0


def test_a_vehicle_told_to_go_to_a_position_goes_there_and_stays() -> None:
    dive = Dive(sim_config(**IDEAL))
    dive.command(STRAIGHT)
    settle(dive, 8)
    dive.vehicle.obey(Stop(action=Action.GO_TO, position_m=(-60.0, 40.0)))
    settle(dive, 200)
    for _ in range(30):
        dive.tick()
        assert math.dist(dive.vehicle.position[:2], (-60.0, 40.0)) < 2.0 * 15.0 + 3.0


def test_a_vehicle_that_is_told_to_hold_before_it_sets_out_waits() -> None:
    dive = Dive(sim_config(**IDEAL))
    dive.vehicle.obey(HOLD)
    dive.command(STRAIGHT)
    settle(dive, 20)
    assert dive.vehicle.truth(0.0).travelled_m == 0.0
    dive.vehicle.obey(None)
    settle(dive, 20)
    assert dive.vehicle.truth(0.0).travelled_m > 20.0


@pytest.mark.parametrize(
    ("then", "depth_m", "position_m"),
    [
        (None, 3.0, None),
        (Stop(action=Action.HOLD), 3.0, None),
        (Stop(action=Action.SURFACE), 0.0, None),
        (Stop(action=Action.GO_TO, position_m=(-60.0, 40.0)), 3.0, (-60.0, 40.0)),
    ],
)
def test_after_the_last_leg_a_vehicle_does_what_its_waypoint_says(then, depth_m, position_m) -> None:
    dive = Dive(sim_config(**IDEAL))
    leg = TABLE.leg(0, dive.state, STRAIGHT)
    dive.vehicle.command(leg, 1.0, then)
    settle(dive, 20)
    assert dive.vehicle.truth(0.0).travelled_m == pytest.approx(20.0, abs=0.2), "at the speed that it was told"
    settle(dive, 200)
    assert dive.vehicle.position[2] == pytest.approx(depth_m, abs=0.01)
    near = leg.end_state[1:] if position_m is None else position_m
    assert math.dist(dive.vehicle.position[:2], near) < 2.0 * 15.0 + 3.0


def test_a_leg_that_ends_in_a_surfacing_is_stopped_at():
    """It stops at the leg's end, comes back with a fix, and then travels the next leg from there."""
    dive = Dive(sim_config(current=IDEAL), depth_m=3.0)
    first = TABLE.leg(0, dive.state, STRAIGHT)
    second = TABLE.leg(1, first.end_state, STRAIGHT)
    dive.vehicle.command(replace(first, surface=True))
    dive.tick()
    dive.vehicle.command(second)
    fixes = []
    while not dive.vehicle.truth(0.0).loitering:
        dive.tick()
        fixes += dive.vehicle.fixes
        assert dive.now_s < 200.0
    (fix,) = fixes
    rows = results(dive)
    i = round(fix.stamp_s * 10.0) - 1
    assert np.hypot(rows[i].north - first.end_state[1], rows[i].east) < 8.0, "one stopping distance on"
    legs_s = (first.length_m + second.length_m) / 1.5
    assert dive.now_s == pytest.approx(legs_s + 50.0, abs=12.0)
