"""A mission written as a recording and read back."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin
from sim_helpers import other_bag

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.topics.records import HealthReport, Odometry
from auv_lse_common.topics.table import VEHICLE_TOPICS, find_topic
from auv_lse_common.vocabulary.dead_reckoning import Fix, MateNavigation
from auv_lse_common.vocabulary.health import Level
from auv_lse_common.vocabulary.plan import Tour
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record import run_writer
from auv_lse_record.bag_writer import BagWriter
from auv_lse_record.message_types import definitions, make_message, message_folder, project_types, types_of
from auv_lse_record.recording import MISSION_FILE, SOFTWARE, Recording, RecordingError, recording_in
from auv_lse_record.run_reader import read_bag, read_run, recorded_parameters
from auv_lse_record.run_writer import write_run
from auv_lse_record.software import version


def same(a, b):
    """Equal up to the nanosecond that a ROS stamp keeps and the rounding of a quaternion."""
    np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-8)


def test_run_survives_the_recording(tmp_path, synthetic_run):
    run = synthetic_run(steps=6)
    tour = Tour(segment_legs=2, bearings=(0, 255, 64))
    decisions = run.vehicles[1].decisions
    decisions[2] = replace(decisions[2], plan=replace(decisions[2].plan, tour=tour))
    write_run(run, tmp_path / "run")
    back = read_run(tmp_path / "run", ground=run.ground, wall_s=run.wall_s)
    assert back.parameters == run.parameters
    assert [v.vehicle for v in back.vehicles] == [1, 2]
    for a, b in zip(run.vehicles, back.vehicles, strict=True):
        same(a.soundings.rows, b.soundings.rows)
        same(a.received.rows, b.received.rows)
        assert a.received.vehicle.tolist() == b.received.vehicle.tolist()
        same(a.odometry[:, :3], b.odometry[:, :3])
        same(a.position_std_m, b.position_std_m)
        assert len(b.position_std_m) == len(b.odometry)
        same(np.exp(1j * a.truth[:, 3]), np.exp(1j * b.truth[:, 3]))  # headings, whatever the turn
        same(a.truth[:, :3], b.truth[:, :3])
        assert len(a.decisions) == len(b.decisions)
        for c, d in zip(a.decisions, b.decisions, strict=True):
            assert (c.step, c.plan) == (d.step, d.plan)
            same(
                (c.now_s, c.jbar, c.reward_so_far, c.lower_bound, c.wall_s),
                (d.now_s, d.jbar, d.reward_so_far, d.lower_bound, d.wall_s),
            )
    assert [(p.source, p.payload) for p in back.sent] == [(p.source, p.payload) for p in run.sent]
    assert [(p.receiver, p.source, p.snr_db) for p in back.received] == [
        (p.receiver, p.source, p.snr_db) for p in run.received
    ]
    assert back.end_s == pytest.approx(run.end_s)


def test_messages_are_kept_as_numbers(tmp_path, synthetic_run):
    """Objects of a survey's 600,000 soundings and positions took a gigabyte."""
    run, peaks = synthetic_run(steps=1), []
    run.vehicles = run.vehicles[:1]
    for count in (500, 8_500):
        rows = np.column_stack([np.arange(count), np.ones((count, 3))]).astype(float)
        vehicle = run.vehicles[0]
        vehicle.soundings, vehicle.odometry, vehicle.truth = Soundings.from_rows(rows), rows, rows
        vehicle.position_std_m = np.ones((count, 2))
        vehicle.dead_reckoning = np.column_stack([rows, np.ones(count)])
        write_run(run, tmp_path / str(count))
        tracemalloc.start()
        back = read_run(tmp_path / str(count))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(back.vehicles[0].soundings) == len(back.vehicles[0].dead_reckoning) == count
    assert (peaks[1] - peaks[0]) / (4 * 8_000) < 250.0


def test_raw_positions_fixes_and_mate_navigation_survive_the_recording(tmp_path, synthetic_run):
    run = synthetic_run(steps=2)
    one, two = run.vehicles
    own = one.soundings
    one.soundings = replace(own, raw_north_m=own.north_m + 2.0, raw_east_m=own.east_m + 2.0)
    one.dead_reckoning = np.column_stack([one.odometry, np.full(len(one.odometry), 3.0)])
    one.fixes = [Fix(stamp_s=20.0, north_m=1.0, east_m=2.0, raw_north_m=3.0, raw_east_m=4.0, std_m=0.8)]
    told = MateNavigation(stamp_s=9.25, source=1, sent_s=9.0, raw_north_m=5.0, raw_east_m=6.0, travel_s=0.25)
    fix = {"fix_raw_north_m": 3.0, "fix_raw_east_m": 4.0, "fix_north_m": 1.0, "fix_east_m": 2.0}
    two.mates = [told, replace(told, stamp_s=39.25, sent_s=39.0, **fix)]
    run.received[0] = replace(run.received[0], sent_s=9.0, arrival_s=9.25, travel_s=0.25)
    write_run(run, tmp_path)
    back = read_run(tmp_path)
    same(back.vehicles[0].soundings.raw_positions_m, one.soundings.raw_positions_m)
    same(back.vehicles[0].dead_reckoning, one.dead_reckoning)
    assert back.vehicles[0].fixes == one.fixes
    assert [mate.has_fix for mate in back.vehicles[1].mates] == [False, True]
    assert back.vehicles[1].mates[1] == two.mates[1]
    assert np.isnan(back.vehicles[1].soundings.raw_positions_m).all()
    heard = back.received[0]
    assert (heard.sent_s, heard.arrival_s, heard.travel_s) == (9.0, 9.25, 0.25)


def test_odometry_without_covariance_has_no_position_error(tmp_path, synthetic_run):
    run = synthetic_run(steps=1)
    for vehicle in run.vehicles:
        vehicle.position_std_m = np.empty((0, 2))
    write_run(run, tmp_path)
    back = read_run(tmp_path)
    assert all(len(v.position_std_m) == 0 for v in back.vehicles)
    assert np.isnan(back.vehicles[0].position_std_at(np.array([1.0, 2.0]))).all()


def test_recording_with_the_old_name_of_the_naive_path_is_read(tmp_path, synthetic_run, monkeypatch):
    run = synthetic_run(steps=2)
    kind = "auv_lse_msgs/msg/Plan"
    texts = definitions([message_folder()], "auv_lse_msgs")
    no_tour = [line for line in texts[kind].splitlines() if "segment_legs" not in line and "bearings" not in line]
    assert len(no_tour) == len(texts[kind].splitlines()) - 2
    old = {**texts, kind: "\n".join(no_tour).replace("naive_path ", "heuristic ")}
    assert "heuristic " in old[kind]
    monkeypatch.setattr(run_writer, "project_types", lambda: types_of(old))
    records = run_writer._records

    def old_records(run):
        for stamp_s, name, kind_, fields, latched in records(run):
            if kind_ == kind:
                gone = ("naive_path", "segment_legs", "bearings")
                kept = {key: value for key, value in fields.items() if key not in gone}
                fields = {**kept, "heuristic": fields["naive_path"]}
            yield stamp_s, name, kind_, fields, latched

    monkeypatch.setattr(run_writer, "_records", old_records)
    write_run(run, tmp_path / "run")
    back = read_run(tmp_path / "run")
    assert [d.plan for v in back.vehicles for d in v.decisions] == [d.plan for v in run.vehicles for d in v.decisions]


def test_health_with_another_clock_does_not_extend_a_mission(tmp_path, synthetic_run, monkeypatch):
    run, records = synthetic_run(steps=2), run_writer._records
    health = HealthReport(stamp_s=1.8e9, name="/auv1/gp_node", level=Level.WARN, text="of another dive", values={})

    def with_health(run):
        yield from records(run)
        yield run_writer._record(VEHICLE_TOPICS["diagnostics"], 20.0, health, 1)

    monkeypatch.setattr(run_writer, "_records", with_health)
    write_run(run, tmp_path / "run")
    assert read_run(tmp_path / "run").end_s == pytest.approx(run.end_s)


def test_mcap_library_reads_the_recording(tmp_path, synthetic_run):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    run = synthetic_run(steps=4)
    write_run(run, tmp_path / "run")
    (file,) = (tmp_path / "run" / "bag").glob("*.mcap")
    counts = {}
    with file.open("rb") as stream:
        for _, channel, message, decoded in reader.make_reader(
            stream, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic == "/auv1/sounding" and counts[channel.topic] == 1:
                stamp_ns = decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec
                assert stamp_ns == message.log_time
                assert decoded.depth_m == pytest.approx(run.vehicles[0].soundings.depth_m[0])
    assert counts["/auv1/sounding"] == len(run.vehicles[0].soundings)
    assert counts["/auv2/plan"] == 4
    assert counts["/truth/auv2/odometry"] == len(run.vehicles[1].truth)


def test_recording_contains_the_mission_file_and_the_software_version(tmp_path, synthetic_run):
    run = synthetic_run(steps=2)
    write_run(run, tmp_path)
    with Recording(recording_in(tmp_path)) as recording:
        assert recording.text(SOFTWARE) == version()
        assert yaml.safe_load(recording.text(MISSION_FILE)).keys() == run.parameters.keys()
        assert recording.topics[MISSION_FILE].latched
        assert recording.topics["/auv1/plan"].latched
        assert not recording.topics["/auv1/sounding"].latched
    (tmp_path / "mission.yaml").unlink()
    (file,) = (tmp_path / "bag").glob("*.mcap")
    alone = tmp_path / "elsewhere" / "copied.mcap"
    alone.parent.mkdir()
    alone.write_bytes(file.read_bytes())
    for path in (tmp_path, tmp_path / "bag", alone):
        assert recorded_parameters(path) == run.parameters, path
        assert read_run(path).steps == 2


def test_recording_with_a_parameter_of_an_earlier_version_is_read(tmp_path, synthetic_run):
    run = synthetic_run(steps=2)
    flown = dict(run.parameters)
    for pattern in ("/**", "/auv1/**"):
        values = dict(flown.get(pattern, {}))
        run.parameters[pattern] = {**values, "planner": {**values.get("planner", {}), "floor": "lanes"}}
    run.parameters["/auv1/**"]["planner.floor"] = "strips"
    write_run(run, tmp_path)
    for mission in (None, tmp_path / "mission.yaml"):
        read = read_run(tmp_path, mission=mission)
        assert read.notes == [
            "Recorded by an earlier version with parameters that this version leaves out: planner.floor."
        ]
        back = read.parameters
        assert "floor" not in str(back)
        assert back["/**"]["planner"] == flown["/**"].get("planner", {})
    kept = read_parameter_file(tmp_path / "mission.yaml")["/**"]["planner"]
    assert kept["floor"] == "lanes", "a new mission file is checked as it is"


def test_recording_of_the_last_version_is_read(tmp_path, synthetic_run):
    """Its mission file has every parameter of its time; these are gone."""
    run = synthetic_run(steps=2)
    gone = {
        "planner": {"batch": 8, "coordination": "sequential", "team_order": "id", "team_routes": False},
        "motion": {"track_spacing_m": 1.0},
        "packet": {"check_limits": True, "selection": "every_nth", "expected_loss": 0.2, "min_spacing_m": 0.0},
        "gp": {"outlier_sigmas": 0.0},
    }
    flown = run.parameters["/**"]
    run.parameters["/**"] = {**flown, **{name: {**flown.get(name, {}), **old} for name, old in gone.items()}}
    write_run(run, tmp_path)
    assert Settings.from_patterns(read_run(tmp_path).parameters, "it").mission.steps == 2


@pytest.mark.parametrize("in_recording", [True, False])
def test_numbers_that_an_earlier_version_read_in_base_8_or_60_are_read_as_it_did(
    tmp_path, synthetic_run, monkeypatch, in_recording
):
    text = run_writer.parameter_text(synthetic_run(steps=8).parameters)
    earlier = text.replace("steps: 8\n", "steps: 010\n")
    assert earlier != text
    with monkeypatch.context() as patch:
        patch.setattr(run_writer, "parameter_text", lambda parameters: earlier)
        if not in_recording:
            patch.setattr(run_writer, "MISSION_FILE", "/recorder/other")
        write_run(synthetic_run(steps=8), tmp_path)
    run = read_run(tmp_path)
    assert Settings.from_patterns(run.parameters, "it").mission.steps == 8
    assert not run.notes
    with pytest.raises(ParameterError, match="YAML reads 010 in base 8"):
        read_run(tmp_path, mission=tmp_path / "mission.yaml")


def test_recording_with_a_value_of_an_earlier_version_is_read(tmp_path, synthetic_run):
    run = synthetic_run(steps=2)
    flown = run.parameters["/**"]
    run.parameters["/**"] = {**flown, "planner": {"method": "best"}, "motion": {"straight": "printed"}}
    run.parameters["/auv2/**"] = {"planner.method": "best"}
    write_run(run, tmp_path)
    back = read_run(tmp_path)
    assert Settings.from_patterns(back.parameters, "it").vehicle(2).planner.method == "tour"
    assert back.notes == [
        "Recorded by an earlier version with motion.straight 'printed'; this version reads it as 'growing'.",
        "Recorded by an earlier version with planner.method 'best'; this version reads it as 'tour'.",
    ]
    with pytest.raises(ParameterError, match=r"must be one of .*, not 'best'\. 'best' was replaced by 'tour'"):
        Settings.load(tmp_path / "mission.yaml")


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3], ids=["mcap", "sqlite3"])
def test_recording_of_another_recorder_is_read(tmp_path, synthetic_run, plugin):
    run = synthetic_run(steps=3)
    write_run(run, tmp_path / "run")
    other_bag(tmp_path / "run" / "bag", tmp_path / "other", plugin)
    (file,) = [f for f in (tmp_path / "other").iterdir() if f.suffix in (".mcap", ".db3")]
    for path in (tmp_path / "other", file):
        with pytest.raises(RecordingError, match=r"has no mission file .* Copy the mission's file to \S+/other/mis"):
            read_run(path)
    (tmp_path / "mission.yaml").write_text((tmp_path / "run" / "mission.yaml").read_text())
    for path in (tmp_path / "other", file):  # beside the recording's folder, however it is named
        assert recorded_parameters(path) == read_parameter_file(tmp_path / "mission.yaml")
    back = read_run(tmp_path / "other", mission=tmp_path / "run" / "mission.yaml")
    assert back.parameters == read_parameter_file(tmp_path / "run" / "mission.yaml")
    assert [d.plan for v in back.vehicles for d in v.decisions] == [d.plan for v in run.vehicles for d in v.decisions]
    assert back.end_s == pytest.approx(run.end_s), "times are the messages' own"
    assert read_run(file, mission=tmp_path / "run" / "mission.yaml").steps == 3


def test_second_recording_does_not_overwrite_the_first(tmp_path, synthetic_run):
    run = synthetic_run(steps=1)
    write_run(run, tmp_path)
    with pytest.raises(RecordingError, match=r"bag exists"):
        write_run(run, tmp_path)


def test_truncated_recording_is_named(tmp_path, synthetic_run):
    run = synthetic_run(steps=1)
    with pytest.raises(RecordingError, match=r"nothing does not exist"):
        read_bag(tmp_path / "nothing", run.parameters)
    with pytest.raises(RecordingError, match=r"neither it nor its folder bag has a metadata\.yaml"):
        read_bag(tmp_path, run.parameters)
    write_run(run, tmp_path)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(RecordingError, match="cannot be read"):
        read_bag(tmp_path / "bag", run.parameters)


def test_recording_without_a_mission_is_named(tmp_path, synthetic_run):
    run = synthetic_run(steps=1)
    run.vehicles, run.sent, run.received = [], [], []
    write_run(run, tmp_path)
    with pytest.raises(RecordingError, match="has no topic"):
        read_bag(tmp_path / "bag", run.parameters)


def test_messages_of_a_track_are_those_that_encoders_make(tmp_path, synthetic_run):
    run = synthetic_run(steps=3)
    vehicle = run.vehicles[0]
    write_run(run, tmp_path)
    store = types_of(definitions([message_folder()], "auv_lse_msgs"))
    stds = vehicle.position_std_m[5]
    stamp_s, north_m, east_m, heading_rad = vehicle.odometry[5]
    covariance = np.diag([0.0, stds[0] ** 2, stds[1] ** 2])
    value = Odometry(stamp_s=stamp_s, heading_rad=heading_rad, north_m=north_m, east_m=east_m, covariance=covariance)
    expected = {"/auv1/odometry": value, "/auv1/sounding": next(iter(vehicle.soundings[5:]))}
    for name, value in expected.items():
        topic = find_topic(name).topic
        message = make_message(store, topic.kind, topic.encode(value, 1))
        with Recording(recording_in(tmp_path)) as recording:
            found = [data for _, _, data in recording.raw({name})]
        assert found[5] == bytes(store.serialize_cdr(message, topic.kind))


def test_a_state_of_another_version_leaves_out_a_note_and_not_the_run(tmp_path):
    topic, store = find_topic("/auv1/mission/state").topic, project_types()
    bag = BagWriter(tmp_path / "bag", store, {})
    bag.add_topic("/auv1/mission/state", topic.kind)
    message = make_message(store, topic.kind, {"state": 250})
    bag.write("/auv1/mission/state", 0, bytes(store.serialize_cdr(message, topic.kind)))
    bag.close()
    with Recording(recording_in(tmp_path)) as recording:
        with pytest.raises(RecordingError, match="mission/state"):
            list(recording.values({"mission/state"}))
        assert list(recording.values({"mission/state"}, optional={"mission/state"})) == []


def test_a_definition_is_parsed_once_however_many_topics_have_it(tmp_path, synthetic_run, monkeypatch):
    from rosbags.highlevel import anyreader

    parsed, parse = [], anyreader.get_types_from_msg
    monkeypatch.setattr(anyreader, "get_types_from_msg", lambda text, kind: parsed.append(kind) or parse(text, kind))
    write_run(synthetic_run(steps=2), tmp_path / "run")
    with Recording(recording_in(tmp_path / "run")) as recording:
        kinds = [topic.kind for topic in recording.topics.values()]
    assert len(kinds) > len(set(kinds))
    assert sorted(parsed) == sorted(set(kinds))
