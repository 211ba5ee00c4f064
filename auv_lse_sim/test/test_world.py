"""The world as the engines see it: ticks, soundings at estimated positions, packets."""

import numpy as np
import pytest
from sim_helpers import FunctionGround

from auv_lse_common.mission_file.parameters import from_mapping
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.ground.lake import SyntheticLake
from auv_lse_sim.world import World

TABLE = MotionTable(MotionConfig())
EXTENT = Extent(north_min_m=-1000, north_max_m=1000, east_min_m=-1000, east_max_m=1000)
SLOPE = FunctionGround(lambda n, e: 20.0 + 0.02 * n - 0.01 * e, EXTENT)


def world(vehicles=2, seed=3, ground=SLOPE, **sim) -> World:
    configs = [VehicleConfig(depth_m=3.0 + k, start_east_m=40.0 * k) for k in range(vehicles)]
    return World(from_mapping(SimConfig, sim, "test"), configs, None, ground, seed)


def fly(w: World, ticks: int, tick_s: float = 1.0):
    """Straight ahead, legs commanded as they are taken; gives the outputs of all ticks."""
    outputs = []
    states = {k: np.array([0.0, 0.0, 40.0 * (k - 1)]) for k in w.vehicles}
    steps = dict.fromkeys(w.vehicles, 0)
    for i in range(1, ticks + 1):
        output = w.tick(i * tick_s)
        for k in w.vehicles:
            if output[k].truth.step == steps[k] - 1:
                w.command(k, TABLE.leg(steps[k], states[k], 5))
                states[k], steps[k] = TABLE.end_state(states[k], 5), steps[k] + 1
        outputs.append(output)
    return outputs


def test_ideal_soundings_are_the_ground():
    outputs = fly(world(ideal=True), 60)
    for k in (1, 2):
        soundings = Soundings.join(o[k].soundings for o in outputs)
        assert len(soundings) == 60  # one a second
        assert np.abs(soundings.depth_m - SLOPE.depth_m(soundings.north_m, soundings.east_m)).max() < 1e-9
        last = outputs[-1][k]
        assert last.altitude_m == pytest.approx(last.truth.water_m - last.truth.depth_m)
        assert last.pressure_depth_m == pytest.approx(2.0 + k)


def test_soundings_belong_to_the_true_position_but_carry_the_estimated_one():
    w = world(
        1, compass={"bias_deg": 8.0}, altimeter={"ideal": True}, pressure={"ideal": True}, dynamics={"ideal": True}
    )
    outputs = fly(w, 300)
    soundings = Soundings.join(o[1].soundings for o in outputs)[10:]
    truth = np.array([[o[1].truth.stamp_s, o[1].truth.north_m, o[1].truth.east_m] for o in outputs])
    north, east = (np.interp(soundings.stamp_s, truth[:, 0], truth[:, i]) for i in (1, 2))
    assert np.abs(soundings.depth_m - SLOPE.depth_m(north, east)).max() < 0.01
    assert np.hypot(soundings.north_m - north, soundings.east_m - east)[-1] > 2.0
    e = outputs[-1][1]
    assert e.odometry.north_m == pytest.approx(w.vehicles[1].state[0])


def test_stamps_are_within_their_tick_and_grow():
    outputs = fly(world(3), 50)
    for k in (1, 2, 3):
        last = 0.0
        for i, output in enumerate(outputs, 1):
            stamps = output[k].soundings.stamp_s
            assert (stamps <= i).all()
            assert (stamps > last).all()
            last = max([last, *stamps])
            assert output[k].odometry.stamp_s == output[k].truth.stamp_s == i


def test_same_seed_same_world_and_another_one_differs():
    def end(seed):
        output = fly(world(2, seed, SyntheticLake(mission_seed=1)), 100)[-1]
        return [(o.odometry.north_m, o.odometry.east_m, o.truth.north_m) for o in output.values()]

    assert end(5) == end(5)
    assert end(5) != end(6)


def test_more_vehicles_do_not_change_the_first_ones():
    def first(vehicles):
        return [o[1].odometry.north_m for o in fly(world(vehicles), 60)]

    assert first(1) == first(4)


def test_packets_arrive_later_and_elsewhere():
    w = world(3, channel={"fading_db": 0.0})
    w.tick(1.0)
    end = w.transmit(1, 1.0, bytes(252))
    arrivals = []
    for t in range(2, 10):
        for k, output in w.tick(float(t)).items():
            arrivals += [(k, a.source, a.arrival_s) for a in output.arrivals]
            assert all(t - 1.0 < a.arrival_s <= t for a in output.arrivals)
    assert sorted(k for k, _, _ in arrivals) == [2, 3]
    assert {s for _, s, _ in arrivals} == {1}
    travel = {k: time - end for k, _, time in arrivals}
    assert travel[2] == pytest.approx(40.0 / 1500.0, rel=0.05)  # 40 m apart
    assert travel[3] == pytest.approx(80.0 / 1500.0, rel=0.05)


def test_travel_times_are_distances_with_clocks_and_echoes():
    """Vehicles 40 m apart on parallel lines: what is measured beyond the true time is what the clocks say."""
    quiet = {"noise_s": 0.0, "echo_share": 0.0, "sound_speed_error": 0.0}

    def measured(**ranging) -> list[float]:
        w, found = (
            world(2, ranging=ranging, channel={"fading_db": 0.0}, gps={"ideal": True}, navigation={"ideal": True}),
            [],
        )
        for t in range(1, 60):
            outputs = w.tick(float(t))
            found += [a.travel_s for a in outputs[2].arrivals]
            if t % 10 == 1:
                w.transmit(1, float(t), bytes(252))
        return found

    true_s = np.hypot(40.0, 1.0) / 1500.0
    assert measured(ideal=True) == pytest.approx([true_s] * 6, abs=1e-4)
    assert measured(**quiet, clock_offset_s=0.0, clock_drift_ppm=0.0) == pytest.approx([true_s] * 6, abs=1e-4)
    offsets = np.array(measured(**quiet, clock_drift_ppm=0.0)) - true_s
    assert np.ptp(offsets) < 1e-4 < abs(offsets).mean() < 5e-3, "one offset of two clocks"
    drifts = np.diff(measured(**quiet, clock_offset_s=0.0, clock_drift_ppm=100.0))
    assert drifts == pytest.approx(np.full(5, drifts.mean()), abs=1e-5)
    assert 1e-5 < abs(drifts.mean()) < 5e-3
    late = np.array(measured(echo_share=1.0, clock_offset_s=0.0, clock_drift_ppm=0.0, noise_s=0.0)) - true_s
    assert (late > -1e-3).all()
    assert late.max() > 5e-3
    assert np.isnan(world_arrival_without_delay().travel_s)


def world_arrival_without_delay():
    w = world(2, channel={"delay": False, "fading_db": 0.0})
    w.tick(1.0)
    w.transmit(1, 1.0, bytes(252))
    return next(a for t in (2.0, 3.0, 4.0) for a in w.tick(t)[2].arrivals)


def test_the_distance_is_from_the_sender_then_to_the_receiver_when_it_hears():
    """600 m apart and 0.4 s of travel: a receiver that comes with 1.5 m/s is 0.6 m nearer when it hears."""
    w = world(2, ranging={"ideal": True}, channel={"fading_db": 0.0}, ideal=True)
    w.vehicles[2]._m[1] = 600.0
    w.command(
        2,
        Leg(step=0, heading_rad=-np.pi / 2, north_m=0.0, east_m=600.0, action_rad=0.0, radius_m=15.0, straight_m=60.0),
    )
    for t in range(1, 11):
        w.tick(float(t))
    position = w.positions()[2][1]
    w.transmit(1, 10.0, bytes(252))
    (arrival,) = [a for t in (11.0, 12.0, 13.0) for a in w.tick(t)[2].arrivals]
    apart = np.hypot(position - 1.5 * arrival.travel_s, w.positions()[2][2] - w.positions()[1][2])
    assert arrival.travel_s * 1500.0 == pytest.approx(apart, abs=0.01)
    assert arrival.heard_s == 10.0 + arrival.travel_s


def test_lost_packets_are_told_apart():
    w = world(2, channel={"packet_loss": 1.0})
    w.tick(1.0)
    w.transmit(1, 1.0, bytes(252))
    lost = []
    for t in range(2, 10):
        assert not any(o.arrivals for o in w.tick(float(t)).values())
        lost += w.lost
    assert [(a.receiver, a.why) for a in lost] == [(2, "random")]


def test_time_does_not_run_backwards():
    w = world()
    w.tick(2.0)
    with pytest.raises(ValueError, match="cannot tick to 1 s, which is not after 2 s"):
        w.tick(1.0)


def test_shorter_ticks_make_the_same_truth():
    whole = fly(world(1, ideal=True), 30)[-1][1].truth
    halves = fly(world(1, ideal=True), 60, 0.5)[-1][1].truth
    # The first leg is commanded half a second earlier.
    assert halves.travelled_m == pytest.approx(whole.travelled_m + 0.75, abs=1e-6)


@pytest.mark.parametrize("keeps_altitude", [False, True])
@pytest.mark.parametrize(("tick_s", "rate_hz"), [(0.25, 10.0), (0.05, 10.0), (1.0, 3.0), (0.7, 8.0)])
def test_ticks_need_not_hold_whole_sub_steps(tick_s, rate_hz, keeps_altitude):
    """Nothing is lost or gained where a sub-step reaches over a tick's end."""
    w = world(1, ideal=True, dvl={"rate_hz": rate_hz}, altimeter={"sounding_every_s": 0.0})
    w.vehicles[1].keep_altitude(1.0 if keeps_altitude else 0.0)
    w.tick(0.0)
    leg = Leg(step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, action_rad=0.0, radius_m=15.0, straight_m=500.0)
    w.command(1, leg)
    ticks = round(21.0 / tick_s)
    stamps = [s for i in range(1, ticks + 1) for s in w.tick(i * tick_s)[1].soundings.stamp_s]
    assert len(stamps) == 21.0 * rate_hz
    assert np.allclose(np.diff(stamps), 1.0 / rate_hz)
    assert w.positions()[1][0] == pytest.approx(21.0 * 1.5, abs=1e-6)


def test_leaving_the_known_ground_gives_no_soundings_and_goes_on():
    small = Extent(north_min_m=-10, north_max_m=30, east_min_m=-50, east_max_m=90)
    w = world(1, ground=FunctionGround(lambda n, e: 20.0 + 0.0 * n, small))
    outputs = fly(w, 80)
    counts = [len(o[1].soundings) for o in outputs]
    assert sum(counts[:15]) > 10
    assert sum(counts[40:]) == 0
    assert np.isnan(outputs[-1][1].altitude_m)
    assert outputs[-1][1].truth.north_m > 80.0
