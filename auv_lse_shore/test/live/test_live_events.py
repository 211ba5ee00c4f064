"""The live view's core: messages to events, maps to bytes and back, plans to lines, recordings as they grow."""

from __future__ import annotations

import base64
import json
import shutil
import threading
import zlib
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import yaml

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_gp.map.certainty import classify, length_of
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_record.growing_file import RecordingFile
from auv_lse_record.recording import RecordingError, recording_in
from auv_lse_record.run_writer import write_run
from auv_lse_run.shipped_files import shipped_file
from auv_lse_shore.live.sources import mission_node, running
from auv_lse_shore.live.sources.events import MissionEvents, topics_of
from auv_lse_shore.live.sources.facts import mission_facts
from auv_lse_shore.live.sources.follow import RecordingFollower
from auv_lse_shore.live.sources.map_layers import OUTSIDE, LayerCoder, scales_of, thinning
from auv_lse_shore.live.sources.own_map import OwnMap
from auv_lse_shore.live.sources.plan_lines import POINTS_PER_LEG, PlanLines
from auv_lse_shore.live.sources.recording import flown_parameters
from auv_lse_shore.live.sources.timeline import Timeline


def ns(**fields):
    return SimpleNamespace(**fields)


def header(stamp_s):
    return ns(stamp=ns(sec=int(stamp_s), nanosec=round(1e9 * (stamp_s % 1.0))))


@pytest.fixture(scope="module")
def settings():
    return Settings.load(None, {"mission.vehicles": 2, "mission.steps": 30})


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, synthetic_run):
    folder = tmp_path_factory.mktemp("live") / "a run"
    write_run(synthetic_run(), folder)
    return folder


def grow(recording, copy, share):
    """Makes `copy` the first part of a recording, as a recorder leaves it while it writes."""
    data = recording.read_bytes()
    copy.parent.mkdir(parents=True, exist_ok=True)
    copy.write_bytes(data[: int(share * len(data))])


def test_a_map_comes_back_from_its_changes_to_half_a_step():
    scales, rng = scales_of(15.0, 5.0), np.random.default_rng(1)
    coder, cells = LayerCoder(scales), np.zeros((4, 6, 5), dtype=np.uint8)
    for _ in range(3):
        layers = {
            "risk": rng.uniform(0.0, 5.0, (6, 5)),
            "p_safe": rng.uniform(0.0, 1.0, (6, 5)),
            "depth": rng.uniform(0.0, 30.0, (6, 5)),
            "std": rng.uniform(0.0, 6.0, (6, 5)),
        }
        layers["risk"][0, 0] = np.nan
        change = np.frombuffer(zlib.decompress(base64.b64decode(coder.code(layers))), dtype=np.uint8)
        cells = cells + change.reshape(4, 6, 5)  # modulo 256
        for plane, (name, scale) in zip(cells, scales.items(), strict=True):
            known = plane != OUTSIDE
            assert np.abs(scale.low + plane * scale.step - layers[name])[known].max() <= scale.step / 2.0 + 1e-12
            assert (~known).sum() == (1 if name == "risk" else 0)


def test_values_beyond_a_scale_take_its_end():
    depth = scales_of(15.0, 5.0)["depth"]
    assert depth.to_bytes(np.array([-1e9, 15.0, 1e9, np.nan])).tolist() == [0, 127, 254, OUTSIDE]


def test_a_large_map_is_thinned():
    assert thinning(120, 140) == 1
    apart = thinning(1000, 1000)
    assert (1000 // apart) ** 2 <= 40_000 < (1000 // (apart - 1)) ** 2


def test_a_plan_becomes_a_line_through_the_ends_of_its_legs(settings):
    planner = settings.planner_settings(1)
    lines = PlanLines(planner, OperatingArea(settings.area))
    plan = Plan(step=20, heading_rad=0.0, north_m=50.0, east_m=60.0, actions=(5, 10, 5), naive_path=0xF0)
    told = lines.lines(plan)
    points = np.array(told["line"]).reshape(-1, 2) / 10.0
    assert (told["step"], told["own"], told["continued"]) == (20, 3, "lanes of a lawnmower")
    assert len(points) == 1 + POINTS_PER_LEG * 10, "to the mission's end"
    radius = planner.motion.turn_radius_m
    leg_m = radius * np.pi / 2.0
    # straight on, a quarter circle to starboard, straight on
    expected = [(50.0, 60.0), (50.0 + leg_m, 60.0), (50.0 + leg_m + radius, 60.0 + radius)]
    expected.append((expected[-1][0], expected[-1][1] + leg_m))
    assert points[: 3 * POINTS_PER_LEG + 1 : POINTS_PER_LEG] == pytest.approx(np.array(expected), abs=0.051)
    short = lines.lines(Plan(step=20, heading_rad=0.0, north_m=50.0, east_m=60.0, actions=(5,), naive_path=NONE))
    assert (len(short["line"]), short["continued"]) == (2 * (1 + POINTS_PER_LEG), "")
    strange = lines.lines(Plan(step=20, heading_rad=0.0, north_m=np.nan, east_m=60.0, actions=(5,), naive_path=NONE))
    assert strange["line"] == []


def test_a_tour_continues_the_actions_and_shows_its_waypoints(settings):
    lines = PlanLines(settings.planner_settings(1), OperatingArea(settings.area))
    tour = Tour(segment_legs=2, bearings=(0, 64, 64))  # north, east, east
    told = lines.lines(
        Plan(step=20, heading_rad=0.0, north_m=50.0, east_m=60.0, actions=(5, 5), naive_path=NONE, tour=tour)
    )
    assert (told["own"], told["continued"]) == (2, "a tour of 3 segments")
    leg_m = 15.0 * np.pi / 2.0
    start = (50.0 + 2 * leg_m, 60.0)
    north = [start, (start[0] + 2 * leg_m, 60.0)]
    expected = [*north, (north[1][0], 60.0 + 2 * leg_m), (north[1][0], 60.0 + 4 * leg_m)]
    assert np.array(told["waypoints"]).reshape(-1, 2) / 10.0 == pytest.approx(np.array(expected), abs=0.051)
    assert len(told["line"]) == 2 * (1 + POINTS_PER_LEG * 8), "two actions, six legs of the tour"


def test_repetitions_make_no_event(settings):
    events = MissionEvents(settings)
    plan = ns(vehicle=1, step=0, heading_rad=0.0, north_m=50.0, east_m=60.0, actions=[5, 5], naive_path=0xF0)
    assert [e["kind"] for e in events.take("/auv1/plan", ns(header=header(0.0), **vars(plan)))] == ["plan"]
    assert events.take("/auv1/plan", ns(header=header(15.0), **vars(plan))) == [], "the same plan, kept"
    status = ns(level=b"\x01", name="/auv1/planner_node", message="late", values=[ns(key="a", value="1")])
    health = events.take("/auv1/diagnostics", ns(header=header(0.0), status=[status]))
    assert [(e["node"], e["level"], e["text"], e["values"]) for e in health] == [
        ("planner_node", "warning", "late", {"a": "1"})
    ]
    assert events.take("/auv1/diagnostics", ns(header=header(10.0), status=[status])) == []
    status.level = 0  # as a recording has it
    assert events.take("/auv1/diagnostics", ns(header=header(20.0), status=[status]))[0]["level"] == "ok"
    assert events.take("/auv3/plan", plan) == [], "not of this mission"
    assert events.take("/elsewhere", plan) == []


def test_the_state_of_a_mission_is_an_event_when_it_changes(settings):
    events = MissionEvents(settings)

    def state(revision, number, reason, *limits):
        fields = {"revision": revision, "state": number, "reason": reason, "limits": list(limits), "warnings": []}
        stop = {"action": 0, "go_to_north_m": np.nan, "go_to_east_m": np.nan, "team_abort": False}
        return ns(header=header(float(revision)), **fields, **stop)

    (first,) = events.take("/auv1/mission/state", state(1, 1, "GO by test"))
    assert (first["kind"], first["vehicle"], first["state"], first["t"]) == ("run", 1, "running", 1.0)
    assert events.take("/auv1/mission/state", state(1, 1, "GO by test")) == [], "safety_node repeats it"
    (later,) = events.take("/auv1/mission/state", state(2, 2, "leak", "leak: the autopilot reports a leak"))
    assert (later["state"], later["limits"]) == ("holding", ["leak: the autopilot reports a leak"])
    assert "/auv2/mission/state" in topics_of(2)


def test_numbers_that_json_lacks_become_null(settings):
    bound = ns(
        header=header(1.0),
        step=1,
        jbar=float("nan"),
        reward_so_far=1.0,
        lower_bound=float("-inf"),
        lower_bound_max=2.0,
        incumbent_kept=True,
        planning_s=0.04,
        deadline_hit=False,
    )
    (event,) = MissionEvents(settings).take("/auv1/planner/bound", bound)
    assert (event["jbar"], event["bound"], event["reward"]) == (None, None, 1.0)
    json.dumps(event, allow_nan=False)


@pytest.mark.parametrize(("variance_m2", "shown_m"), [(0.0, None), (8.0, 4.0)])
def test_an_unknown_position_error_is_not_shown_as_none(settings, variance_m2, shown_m):
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = variance_m2
    place = ns(position=ns(x=1.0, y=2.0, z=-3.0), orientation=ns(x=0.0, y=0.0, z=0.0, w=1.0))
    speed = ns(linear=ns(x=1.0, y=0.0, z=0.0), angular=ns(x=0.0, y=0.0, z=0.0))
    message = ns(
        header=header(4.0),
        child_frame_id="auv1/base_link",
        pose=ns(pose=place, covariance=covariance.ravel()),
        twist=ns(twist=speed, covariance=np.zeros(36)),
    )
    events = MissionEvents(settings, maps_on_request=True).take("/auv1/odometry", message)
    assert [event["std"] for event in events if event["kind"] == "pose"] == [shown_m]


def test_a_recording_becomes_a_timeline(run_folder, synthetic_run):
    timeline = Timeline()
    follower = RecordingFollower(recording_in(run_folder), timeline)
    assert timeline.state["reading"], "a page draws seldom until then"
    follower.follow(threading.Event())
    assert (timeline.state["reading"], timeline.state["growing"]) == (False, False)
    _, first, events = timeline.since("", 0, 10**6)
    kinds = {kind: [e for e in events if e["kind"] == kind] for kind in {e["kind"] for e in events}}
    run = synthetic_run()
    assert (first, events[0]["kind"], events[0]["name"]) == (0, "mission", "a run")
    assert len(kinds["sent"]) == len(run.sent)
    assert len(kinds["received"]) == len(run.received)
    assert len(kinds["bound"]) == sum(len(v.decisions) for v in run.vehicles)
    gaps = np.diff([e["t"] for e in kinds["pose"] if e["vehicle"] == 1])
    assert gaps.min() >= 2.0 - 1e-6, "thinned"
    assert {e["vehicle"] for e in kinds["map"]} == {1, 2}, "made from soundings: the recording holds no field"
    risks = [e["expected_loss"] for e in kinds["map"] if e["vehicle"] == 1]
    assert risks[-1] < 0.6 * risks[0]
    json.dumps(events, allow_nan=False)


def test_every_recording_of_a_dive_becomes_its_timeline(run_folder, synthetic_run, tmp_path):
    for name in ("bag", "bag-2"):
        shutil.copytree(run_folder / "bag", tmp_path / name)
    timeline = Timeline()
    RecordingFollower(recording_in(tmp_path), timeline).follow(threading.Event())
    _, _, events = timeline.since("", 0, 10**6)
    assert sum(event["kind"] == "sent" for event in events) == 2 * len(synthetic_run().sent)
    assert events[0]["name"] == tmp_path.name


def test_a_growing_recording_is_read_as_it_grows(run_folder, tmp_path):
    whole, copy = run_folder / "bag" / "bag.mcap", tmp_path / "part" / "bag" / "bag.mcap"
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "mission.yaml").write_text((run_folder / "mission.yaml").read_text())
    topics = frozenset(topics_of(2))
    expected = [topic for topic, _ in RecordingFile(whole).messages(topics)]
    grow(whole, copy, 0.0)
    growing, found = RecordingFile(copy), []
    for share in (0.0, 1e-5, 0.3, 0.6, 0.61, 1.0):
        grow(whole, copy, share)
        found += [topic for topic, _ in growing.messages(topics)]
        assert growing.complete == (share == 1.0)
    assert found == expected
    assert list(growing.messages(topics)) == []


def test_a_damaged_recording_is_named(run_folder, tmp_path):
    damaged = tmp_path / "a.mcap"
    data = bytearray((run_folder / "bag" / "bag.mcap").read_bytes())
    data[5000:6000] = bytes(1000)
    damaged.write_bytes(data)
    with pytest.raises(RecordingError, match=r"a\.mcap: damaged near byte [\d,]+: .*\. When .* auv_lse recover"):
        for _ in RecordingFile(damaged).messages(frozenset(topics_of(2))):
            pass


def test_the_mission_file_inside_a_recording_is_the_one_that_was_flown(run_folder, tmp_path):
    copy = tmp_path / "dives" / "dive 7" / "bag"
    shutil.copytree(run_folder / "bag", copy)
    (tmp_path / "dives" / "mission.yaml").write_text("/**: {ros__parameters: {mission: {steps: 999}}}\n")
    patterns, where = flown_parameters(recording_in(copy))
    assert "/recorder/mission_file" in where
    assert Settings.from_patterns(patterns, where).mission.steps != 999


def test_a_mission_file_of_an_earlier_version_is_read(run_folder, tmp_path):
    """Inside the recording or named: the values that went are replaced."""
    patterns = read_parameter_file(run_folder / "mission.yaml")
    patterns["/**"]["planner"] = {**patterns["/**"]["planner"], "method": "best", "floor": "lanes"}
    old = tmp_path / "old.yaml"
    old.write_text(yaml.safe_dump({pattern: {"ros__parameters": values} for pattern, values in patterns.items()}))
    follower = RecordingFollower(recording_in(run_folder), Timeline(), old)
    assert follower.settings.common.planner.method == "tour"


def test_a_path_without_a_recording_is_named(tmp_path):
    text = tmp_path / "a.mcap"
    text.write_text("not a recording at all")
    with pytest.raises(RecordingError, match="is not an MCAP file"):
        list(RecordingFile(text).messages(frozenset()))
    with pytest.raises(RecordingError, match="is not an MCAP file"):  # not that its mission file is missing
        flown_parameters(text)
    empty = tmp_path / "b.mcap"
    empty.write_bytes(b"")
    with pytest.raises(RecordingError, match=r"b\.mcap has no mission file .*Copy the mission's file to"):
        flown_parameters(empty)


def test_the_facts_hold_what_the_page_draws(settings):
    facts = mission_facts(settings, name="x", simulated=True)
    assert [v["number"] for v in facts["vehicles"]] == [1, 2]
    assert facts["tdma"]["order"] == [1, 2]
    assert facts["leg_s"] == pytest.approx(15.0 * np.pi / 2.0 / 1.5)
    assert facts["true_isobath"]
    assert mission_facts(settings, name="x", simulated=False)["true_isobath"] == []
    json.dumps(facts, allow_nan=False)


def test_a_page_that_comes_back_goes_on_where_it_was():
    timeline = Timeline()
    timeline.begin({"kind": "mission"})
    timeline.add([{"n": i} for i in range(5)])
    name, first, events = timeline.since("", 0, 4)
    assert (first, len(events)) == (0, 4)
    assert timeline.since(name, 4, 10)[1:] == (4, [{"n": 3}, {"n": 4}])
    assert timeline.since(name, 99, 10)[1] == 0, "more than there is: from the beginning"
    timeline.begin({"kind": "mission"})
    assert timeline.since(name, 4, 10)[1:] == (0, [{"kind": "mission"}]), "another mission"


def test_the_end_of_a_mission_is_no_problem(tmp_path, monkeypatch):
    timeline, stop = Timeline(), threading.Event()
    follower = running.MissionFollower(timeline, 7, None)
    followed = []

    def follow(found, stop):
        followed.append(found)
        return False

    def wait(timeout):
        stop.set()

    monkeypatch.setattr(running, "busy_domains", lambda: [] if followed else [7])
    monkeypatch.setattr(running, "run_on", lambda domain: tmp_path)
    monkeypatch.setattr(follower, "_follow", follow)
    monkeypatch.setattr(stop, "wait", wait)
    follower.follow(stop)
    assert followed == [running.RunningMission(7, tmp_path)]
    assert timeline.state == {"growing": False, "control": False, "problem": "", "waiting": "waiting for a mission"}


def test_a_mission_of_another_computer_without_its_file_is_named_on_the_terminal(monkeypatch, capsys):
    timeline, stop = Timeline(), threading.Event()
    monkeypatch.setattr(running, "busy_domains", list)
    monkeypatch.setattr(stop, "wait", lambda timeout: stop.set())
    running.MissionFollower(timeline, 82, None).follow(stop)
    assert capsys.readouterr().err == (
        "live view: ROS domain 82: its mission was not started on this machine, so its mission file is unknown. Name "
        "it with --mission FILE\n"
    )


@pytest.mark.parametrize(("here", "silent_s", "named"), [(True, 20.0, False), (False, 9.0, False), (False, 11.0, True)])
def test_a_page_names_the_silence_of_another_computer(tmp_path, monkeypatch, here, silent_s, named):
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.9.0.2")
    found = running.RunningMission(82, tmp_path if here else None)
    text = running.MissionFollower._silence(found, silent_s)
    assert text.startswith("ROS domain 82: nothing heard through ROS_STATIC_PEERS=10.9.0.2 for 10 s") == named
    assert bool(text) == named


@pytest.mark.parametrize(("noted", "taken"), [(None, None), ("", None), ("sim-1", "sim-1")])
def test_a_domain_without_a_noted_simulation_is_shown_whoever_flies_there(monkeypatch, noted, taken):
    """A full disk keeps no note; no message has the empty id."""
    listener = Mock(side_effect=OSError("enough"))
    monkeypatch.setattr(mission_node, "MissionListener", listener)
    monkeypatch.setattr(running, "dive_on", lambda domain: noted)
    follower = running.MissionFollower(Timeline(), 82, shipped_file("missions/default.yaml"))
    with pytest.raises(OSError, match="enough"):
        follower._follow(running.RunningMission(82, None), threading.Event())
    assert listener.call_args.args[3] == taken


def sounded(number, north_m, east_m):
    """A sounding on ground that reaches the level of 15 m at 120 m north; one every 2 s."""
    depth_m = 15.0 - 0.1 * (120.0 - north_m)
    return ns(header=header(2.0 * number), north_m=float(north_m), east_m=float(east_m), depth_m=float(depth_m))


@pytest.mark.parametrize("is_published", [True, False])
@pytest.mark.parametrize("by_mate", [True, False])
def test_a_line_that_soundings_only_lead_to_is_not_found_on_the_page_either(settings, is_published, by_mate):
    events, planner = MissionEvents(settings, maps_on_request=True), settings.planner_settings(1)
    depth_map = DepthMap(planner.gp, planner.level_set, OperatingArea(settings.area))
    rows = [(north_m, east_m, 0.0) for east_m in range(0, 161, 10) for north_m in range(40, 97, 3)]
    for number, (north_m, east_m, _) in enumerate(rows):
        message = sounded(number, north_m, east_m)
        depth_map.add_soundings([(2.0 * number, north_m, east_m, message.depth_m)])
        if not by_mate:
            events.take("/auv1/sounding", message)
        else:
            sample = ns(**{name: [getattr(message, name)] for name in ("north_m", "east_m", "depth_m")})
            events.take("/auv1/team/samples", ns(header=message.header, source=2, **vars(sample)))
    events.take("/auv1/sounding", sounded(len(rows), np.nan, 0.0))
    field, signal_std_m = depth_map.field(), planner.gp.signal_std_m
    if is_published:
        layers = {"risk": field.risk, "p_safe": field.p_safe, "depth": field.mean_m, "std": field.std_m}
        shown = events._map_event(1, 999.0, field.grid.north_m, field.grid.east_m, layers, field.variance_scale)
    else:
        events.last_s["/auv1/odometry"] = 999.0
        shown = events.newest_map(1)[0]
    lines = depth_map.isobath().lines
    report, blind = (classify(lines, field, signal_std_m, np.array(rows)[:known]) for known in (len(rows), 0))
    assert length_of(report, "found") < length_of(blind, "found") - 50.0, "the case tells them apart"
    found_m = sum(
        float(np.hypot(*np.diff(np.reshape(line, (-1, 2)) / 10.0, axis=0).T).sum()) for line in shown["found"]
    )
    assert found_m == pytest.approx(length_of(report, "found"), abs=20.0)


def test_soundings_of_a_vehicle_that_publishes_its_map_are_decoded_now_and_then(settings):
    """Each is needed where the map is computed here; else their locations are, every 2 s."""
    events = MissionEvents(settings)
    events._map_of(1).stop()

    def wanted(stamp_s):
        data = b"\0\1\0\0" + int(stamp_s).to_bytes(4, "little") + round(1e9 * (stamp_s % 1.0)).to_bytes(4, "little")
        return events.wants("/auv1/sounding", data)

    assert wanted(0.0)
    events.take("/auv1/sounding", sounded(0, 40.0, 0.0))
    assert [wanted(stamp_s) for stamp_s in (0.5, 1.9, 2.0)] == [False, False, True]
    assert events.wants("/auv2/sounding", b"\0\1\0\0" + bytes(8)), "its map is computed here"


def test_a_large_map_is_recomputed_as_seldom_as_a_vehicle_publishes_it(settings, monkeypatch):
    vehicle = settings.planner_settings(1)
    area = OperatingArea(vehicle.area)
    cells, period_s = len(area.grid(vehicle.gp.map_resolution_m).locations_m), vehicle.gp.publish_period_s
    monkeypatch.setattr("auv_lse_gp.map.depth_map.MANY_CELLS", cells / 3)
    own = OwnMap(vehicle, area)
    times = [t for t in np.arange(0.0, 8.0 * period_s, 5.0) if own.field(float(t)) is not None]
    assert np.diff(times) == pytest.approx(3.0 * period_s)
