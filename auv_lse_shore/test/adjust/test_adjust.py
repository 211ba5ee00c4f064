"""After the dive: recordings whose positions are found anew, and what is said of those that cannot be."""

from __future__ import annotations

import copy
import csv
import dataclasses
import json
import math
from unittest.mock import Mock

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_common.mission_file.degrees import in_metres
from auv_lse_common.vocabulary.dead_reckoning import Fix, MateNavigation
from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.positions.correction import Correction
from auv_lse_record.run_reader import read_run
from auv_lse_record.run_writer import write_mission_file, write_run
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.judge.team_map import team_map
from auv_lse_shore.judge.tracks import true_positions
from auv_lse_shore.positions import adjustment
from auv_lse_shore.positions.adjustment import AdjustError, adjust, corrects_positions
from auv_lse_shore.positions.merging import merged, on_one_clock
from auv_lse_shore.positions.recordings import missing_in

main = verb_main("adjust")


def dived(make_run, steps=24, bias_deg=(4.0, -3.0), fixed=True, seed=1):
    """The synthetic run with compasses that are off: raw tracks, soundings at dead-reckoned positions, packets, and a
    fix each."""
    rng = np.random.default_rng(seed)
    run = make_run(steps=steps, drift_mps=0.0)
    run.parameters["/**"]["positions"] = {"correct": True, "heading_std_deg": 4.0}
    for vehicle, bias in zip(run.vehicles, bias_deg, strict=True):
        truth, angle = vehicle.truth, math.radians(bias)
        way = truth[:, 1:3] - truth[0, 1:3]
        c, s = math.cos(angle), math.sin(angle)
        raw = truth[0, 1:3] + way @ np.array([[c, s], [-s, c]]) + 0.5 * rng.standard_normal(2)
        depth = np.full(len(truth), 3.0)
        vehicle.dead_reckoning = np.column_stack([truth[:, 0], raw, truth[:, 3] + angle, depth])
        vehicle.odometry = vehicle.dead_reckoning[:, :4].copy()
        vehicle.position_std_m = np.ones((len(truth), 2))
        north, east = (np.interp(vehicle.soundings.stamp_s, truth[:, 0], raw[:, i]) for i in (0, 1))
        vehicle.soundings = dataclasses.replace(
            vehicle.soundings, north_m=north, east_m=east, raw_north_m=north, raw_east_m=east
        )
        if fixed:
            i = int(0.6 * len(truth))
            position = truth[i, 1:3] + 0.5 * rng.standard_normal(2)
            vehicle.fixes = [
                Fix(
                    stamp_s=float(truth[i, 0]),
                    north_m=float(position[0]),
                    east_m=float(position[1]),
                    raw_north_m=float(raw[i, 0]),
                    raw_east_m=float(raw[i, 1]),
                    std_m=1.0,
                )
            ]

    def at(rows, stamp):
        return np.array([np.interp(stamp, rows[:, 0], rows[:, c]) for c in (1, 2)])

    by_number = {v.vehicle: v for v in run.vehicles}
    for packet in run.received:
        sender, receiver = by_number[packet.source], by_number[packet.receiver]
        sent = packet.stamp_s - 5.25
        apart = float(np.linalg.norm(at(sender.truth, sent) - at(receiver.truth, sent))) + 0.3 * rng.standard_normal()
        north, east = at(sender.dead_reckoning, sent)
        receiver.mates.append(
            MateNavigation(
                stamp_s=sent + apart / 1500.0,
                source=packet.source,
                sent_s=sent,
                raw_north_m=float(north),
                raw_east_m=float(east),
                travel_s=apart / 1500.0,
            )
        )
        stamps = sender.soundings.stamp_s
        chosen = sender.soundings[(stamps > sent - 30.0) & (stamps <= sent)][::10]
        new = Soundings.of_packet(packet.stamp_s, packet.source, np.float32(chosen.points_m))
        others = receiver.received[receiver.received.stamp_s != packet.stamp_s]
        receiver.received = Soundings.join([others, new])
    for vehicle in run.vehicles:
        vehicle.received = vehicle.received.in_order()
    return run


def test_ranges_beyond_the_end_of_a_track_are_refused(synthetic_run):
    """The recording of one vehicle ends with its INS; its mate hears it, and is heard, for as long again."""
    run = dived(synthetic_run)
    one, other = run.vehicles
    end_s = float(np.median(one.dead_reckoning[:, 0]))
    one.dead_reckoning = one.dead_reckoning[one.dead_reckoning[:, 0] <= end_s]
    one.soundings = one.soundings[one.soundings.stamp_s <= end_s]
    whole = adjust([copy.deepcopy(run)])
    late = sum(mate.stamp_s > end_s + 2.0 for v in run.vehicles for mate in v.mates)
    assert late >= 3
    for vehicle in run.vehicles:
        vehicle.mates = [mate for mate in vehicle.mates if mate.stamp_s <= end_s + 2.0]
    without = adjust([run])
    assert whole.refused == without.refused + late
    for a, b in zip(whole.runs[0].vehicles, without.runs[0].vehicles, strict=True):
        assert np.array_equal(a.soundings.locations_m, b.soundings.locations_m)
    assert whole.ranges > whole.refused
    assert other.soundings.stamp_s[-1] > end_s


def off(vehicle, recorded):
    """Root mean square distance (m) of a vehicle's soundings from where they were taken."""
    apart = vehicle.soundings.locations_m - true_positions(recorded).locations_m
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def test_soundings_go_where_they_were_taken(synthetic_run):
    run = dived(synthetic_run)
    adjustment = adjust([run])
    for old, new, moved in zip(run.vehicles, adjustment.runs[0].vehicles, adjustment.vehicles, strict=True):
        assert off(new, old) < 0.25 * off(old, old)
        assert moved.largest_m >= moved.mean_m > 1.0
        assert moved.fixes == 1
        assert moved.ranges > 5
        assert np.array_equal(new.soundings.rows[:, [0, 3]], old.soundings.rows[:, [0, 3]])
        assert np.array_equal(new.odometry, old.odometry)
        assert off(new, old) < 3.0 * np.sqrt(2.0) * moved.std_m
    # samples heard are the mates' soundings, and go with them
    heard, mates = adjustment.runs[0].vehicles[0].received, adjustment.runs[0].vehicles[1].soundings
    apart = np.sqrt(((heard.locations_m[:, None] - mates.locations_m[None]) ** 2).sum(axis=2)).min(axis=1)
    assert apart.max() < 0.01


def test_long_recordings_are_moved_piece_by_piece(synthetic_run, monkeypatch):
    """The derivatives of all positions at once would take gigabytes."""
    run = dived(synthetic_run)
    whole, sizes = adjust([run]), []
    monkeypatch.setattr(adjustment, "_AT_ONCE", 200)
    for name in ("positions", "position_std_m"):
        method = getattr(Correction, name)

        def noted(self, vehicle, stamps_s, raw_m, method=method):
            sizes.append(len(stamps_s))
            return method(self, vehicle, stamps_s, raw_m)

        monkeypatch.setattr(Correction, name, noted)
    pieces = adjust([run])
    assert max(sizes) <= 200 < len(run.vehicles[0].soundings)
    for one, other in zip(pieces.runs[0].vehicles, whole.runs[0].vehicles, strict=True):
        assert one.soundings.points_m == pytest.approx(other.soundings.points_m, rel=1e-12)
        assert one.position_std_m == pytest.approx(other.position_std_m, rel=1e-9)


def test_a_recording_without_odometry_is_adjusted_all_the_same(synthetic_run):
    """As of a recorder that took only what adjusting needs."""
    run = dived(synthetic_run)
    none = [dataclasses.replace(v, odometry=v.odometry[:0], position_std_m=v.position_std_m[:0]) for v in run.vehicles]
    bare = dataclasses.replace(run, vehicles=none)
    for one, other in zip(adjust([bare]).runs[0].vehicles, adjust([run]).runs[0].vehicles, strict=True):
        assert one.soundings.points_m == pytest.approx(other.soundings.points_m, rel=1e-12)
        assert one.position_std_m.shape == (0, 2)


def test_the_report_judges_the_adjusted_map(synthetic_run):
    run = dived(synthetic_run)
    assert corrects_positions(run)
    team = team_map(run)
    assert off(team.run.vehicles[0], run.vehicles[0]) < 0.25 * off(run.vehicles[0], run.vehicles[0])
    corrected = evaluate(run, bounds=2).summary
    run.parameters["/**"]["positions"]["correct"] = False
    assert not corrects_positions(run)
    as_flown = evaluate(run, bounds=2).summary
    assert corrected.isobath_error_m < 0.5 * as_flown.isobath_error_m
    assert corrected.position_error_m[0] < 0.25 * as_flown.position_error_m[0]
    assert corrected.error_over_std < 0.5 * as_flown.error_over_std
    assert corrected.navigation_error_m == as_flown.navigation_error_m


def test_runs_together_are_better_than_alone(synthetic_run):
    """A run without fixes takes its positions from the ground that one with fixes has mapped."""
    without = dived(synthetic_run, fixed=False, seed=2, bias_deg=(4.0, 4.0))
    alone = adjust([without]).runs[0].vehicles
    together = adjust([dived(synthetic_run), without]).runs[1].vehicles
    before = np.mean([off(new, old) for new, old in zip(alone, without.vehicles, strict=True)])
    after = np.mean([off(new, old) for new, old in zip(together, without.vehicles, strict=True)])
    assert after < 0.7 * before


def test_one_vehicles_recording_is_enough(synthetic_run):
    run = dived(synthetic_run)
    run.vehicles = run.vehicles[:1]
    adjustment = adjust([run])
    assert off(adjustment.runs[0].vehicles[0], run.vehicles[0]) < 0.4 * off(run.vehicles[0], run.vehicles[0])


def test_each_vehicles_own_recording_of_a_dive_is_as_good_as_one_of_all(synthetic_run):
    whole = dived(synthetic_run)
    parts = [dataclasses.replace(whole, vehicles=[vehicle]) for vehicle in whole.vehicles]
    together, apart = adjust([whole]), adjust(parts)
    assert apart.ranges == together.ranges
    assert set(apart.correction.model.vehicles) == {1, 2}, "a mate that was heard is the vehicle that recorded itself"
    for one, other in zip(together.runs[0].vehicles, (run.vehicles[0] for run in apart.runs), strict=True):
        np.testing.assert_allclose(other.soundings.rows, one.soundings.rows, atol=1e-6)
        np.testing.assert_allclose(other.received.rows, one.received.rows, atol=1e-6)
    dives = adjust([whole, dived(synthetic_run, seed=2)])
    assert len(dives.correction.model.vehicles) == 4, "the same vehicles at the same times: another dive, simulated"


def own_recordings(whole, ahead_s=0.0):
    """What each vehicle of a dive recorded: its own soundings and packets; the second's clock is ahead."""
    parts = []
    for vehicle in whole.vehicles:
        sent = [p for p in whole.sent if p.source == vehicle.vehicle]
        heard = [p for p in whole.received if p.receiver == vehicle.vehicle]
        parts.append(dataclasses.replace(whole, vehicles=[copy.deepcopy(vehicle)], sent=sent, received=heard))
    two = parts[1]
    two.sent = [dataclasses.replace(p, stamp_s=p.stamp_s + ahead_s) for p in two.sent]
    two.received = [dataclasses.replace(p, stamp_s=p.stamp_s + ahead_s) for p in two.received]
    for number, part in enumerate(parts):
        (vehicle,) = part.vehicles
        for mate in vehicle.mates:
            by_both = {"travel_s": mate.travel_s + (ahead_s if number else -ahead_s)}
            own = {"stamp_s": mate.stamp_s + ahead_s} if number else {"sent_s": mate.sent_s + ahead_s}
            vehicle.mates[vehicle.mates.index(mate)] = dataclasses.replace(mate, **own, **by_both)
    (vehicle,) = two.vehicles
    for name in ("odometry", "dead_reckoning", "truth"):
        getattr(vehicle, name)[:, 0] += ahead_s
    for name in ("soundings", "received"):
        rows = getattr(vehicle, name)
        setattr(vehicle, name, dataclasses.replace(rows, stamp_s=rows.stamp_s + ahead_s))
    vehicle.fixes = [dataclasses.replace(fix, stamp_s=fix.stamp_s + ahead_s) for fix in vehicle.fixes]
    vehicle.decisions = [dataclasses.replace(d, now_s=d.now_s + ahead_s) for d in vehicle.decisions]
    return parts


def test_recordings_with_clocks_apart_are_put_on_one(synthetic_run):
    whole = dived(synthetic_run)
    runs, offsets = on_one_clock(own_recordings(whole, ahead_s=3600.0))
    assert offsets == [0.0, pytest.approx(3600.0, abs=0.02)]
    together, apart = adjust([whole]), adjust(runs)
    assert apart.ranges == together.ranges
    assert apart.refused == together.refused
    one = merged(apart.runs)
    assert [v.vehicle for v in one.vehicles] == [1, 2]
    assert len(one.sent) == len(whole.sent)
    assert len(one.received) == len(whole.received)
    for new, old in zip(one.vehicles, together.runs[0].vehicles, strict=True):
        np.testing.assert_allclose(new.soundings.rows[:, 1:], old.soundings.rows[:, 1:], atol=0.3)
        np.testing.assert_allclose(new.soundings.stamp_s, old.soundings.stamp_s, atol=0.02)


def test_small_offsets_and_packets_one_way_shift_nothing(synthetic_run):
    close = own_recordings(dived(synthetic_run, steps=12), ahead_s=0.2)
    assert on_one_clock(close)[1] == [0.0, 0.0]
    far = own_recordings(dived(synthetic_run, steps=12), ahead_s=3600.0)
    far[0].received = []
    assert on_one_clock(far)[1] == [0.0, 0.0]


def test_one_command_makes_one_map_and_one_report_of_each_vehicles_recording(synthetic_run, tmp_path, capsys):
    whole = dived(synthetic_run)
    whole.ground = None
    for vehicle in whole.vehicles:
        vehicle.truth = np.empty((0, 4))
    names = []
    for part in own_recordings(whole):
        names.append(str(tmp_path / f"auv{part.vehicles[0].vehicle}"))
        write_run(part, tmp_path / names[-1])
    assert main([*names, "--out", str(tmp_path / "all"), "--report", "--contours", "15"]) == 0
    out = capsys.readouterr().out
    assert "may be missing: " in out
    summary = json.loads((tmp_path / "all" / "summary.json").read_text())
    assert (summary["vehicles"], summary["steps"]) == (2, 24)
    assert summary["soundings"] == sum(len(v.soundings) for v in whole.vehicles)
    assert summary["packets_sent"] == len(whole.sent)
    assert summary["packets_received"] == len(whole.received)
    assert "auv2" in (tmp_path / "all" / "report.html").read_text()
    assert "metadata" in json.loads((tmp_path / "all" / "isobath.geojson").read_text())
    assert main([names[0], names[0], "--out", str(tmp_path / "twice"), "--report"]) == 2
    assert "so they would count twice" in capsys.readouterr().err


def test_an_interrupted_evaluation_leaves_no_files_without_their_map(synthetic_run, tmp_path, monkeypatch, capsys):
    write_run(dived(synthetic_run), tmp_path / "run")
    monkeypatch.setattr("auv_lse_shore.adjust.command.evaluate", Mock(side_effect=KeyboardInterrupt))
    assert main([str(tmp_path / "run"), "--report"]) == 130
    assert "stopped" in capsys.readouterr().err
    assert not (tmp_path / "run" / "adjusted").exists()


def test_what_ends_an_adjustment_while_it_writes_leaves_the_earlier_one(synthetic_run, tmp_path, monkeypatch, capsys):
    write_run(dived(synthetic_run), tmp_path / "run")
    words = [str(tmp_path / "run"), "--report", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").iterdir()}
    (tmp_path / "out" / "mission.yaml").write_text("a run's own")
    for error, code in ((KeyboardInterrupt(), 130), (OSError(28, "No space left on device"), 2)):
        with monkeypatch.context() as patch:
            patch.setattr("auv_lse_shore.export.formats.soundings_csv.write", Mock(side_effect=error))
            assert main(words) == code
        kept = {path for path, changed_ns in before.items() if path.stat().st_mtime_ns == changed_ns}
        assert kept == before.keys() - {tmp_path / "out" / "mission.yaml"}, error
    assert main(words) == 0
    assert (tmp_path / "out" / "mission.yaml").read_text() == "a run's own"
    assert not {path for path in kept if path.stat().st_mtime_ns == before[path]}, "all are new"


def test_without_dead_reckoning_it_says_what_is_missing(synthetic_run):
    run = dived(synthetic_run)
    run.vehicles[1].dead_reckoning = np.empty((0, 5))
    assert missing_in(run.vehicles[1]) == "no dead reckoning (topic dead_reckoning)"
    adjustment = adjust([run])
    assert [m.missing for m in adjustment.vehicles] == ["", "no dead reckoning (topic dead_reckoning)"]
    assert np.array_equal(adjustment.runs[0].vehicles[1].soundings.rows, run.vehicles[1].soundings.rows)
    run.vehicles[0].dead_reckoning = np.empty((0, 5))
    with pytest.raises(AdjustError, match=r"auv1 of run 1: no dead reckoning \(topic dead_reckoning\)"):
        adjust([run])
    assert not corrects_positions(run)


def test_raw_positions_that_were_not_recorded_come_from_the_raw_track(synthetic_run):
    run, bare = dived(synthetic_run), dived(synthetic_run)
    for vehicle in bare.vehicles:
        vehicle.soundings = Soundings.from_rows(vehicle.soundings.rows)
    for a, b in zip(adjust([run]).runs[0].vehicles, adjust([bare]).runs[0].vehicles, strict=True):
        assert a.soundings.rows == pytest.approx(b.soundings.rows, abs=1e-6)


def test_runs_of_different_origins_are_refused(synthetic_run):
    one, other = dived(synthetic_run, steps=6), dived(synthetic_run, steps=6)
    one.origin, other.origin = (46.0, 6.0), (47.0, 6.0)
    with pytest.raises(AdjustError, match="different origins"):
        adjust([one, other])


def test_a_recording_that_is_given_twice_is_refused(synthetic_run):
    """It once counted twice, and the map believed itself more than it should."""
    run = dived(synthetic_run, steps=6)
    part = copy.copy(run)
    part.vehicles = run.vehicles[1:]
    with pytest.raises(
        AdjustError, match=r"auv2 of run 2 has the soundings of auv2 of run 1, so they would count twice"
    ):
        adjust([run, part])


def test_the_command_writes_map_table_and_report_and_can_be_repeated(synthetic_run, tmp_path, capsys):
    run = dived(synthetic_run)
    area, origin = run.parameters["/**"]["area"], (46.5, 6.6)
    area["origin_lat_deg"], area["origin_lon_deg"] = origin
    folder = tmp_path / "a run"
    write_run(run, folder)
    for _ in range(2):
        assert main([str(folder)]) == 0
    out = capsys.readouterr().out
    assert "| a run | auv1 |" in out
    adjusted = folder / "adjusted"
    assert "± " in (adjusted / "moved.md").read_text()
    with (adjusted / "before_and_after.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(v.soundings) for v in run.vehicles)
    assert any(abs(float(r["adjusted_north_m"]) - float(r["north_m"])) > 3.0 for r in rows)
    positions = np.array([[float(r[f"adjusted_{side}_m"]) for side in ("north", "east")] for r in rows])
    degrees = [[float(r[f"adjusted_{name}_deg"]) for r in rows] for name in ("latitude", "longitude")]
    assert np.column_stack(local_from_geodetic(*degrees, *origin)) == pytest.approx(positions, abs=2e-3)
    lines = json.loads((adjusted / "isobath.geojson").read_text())["features"]
    assert any(feature["properties"]["class"] == "found" for feature in lines)
    assert (adjusted / "soundings.csv").is_file()
    again = adjust([read_run(folder)]).runs[0].vehicles[0].soundings.rows
    assert again == pytest.approx(adjust([run]).runs[0].vehicles[0].soundings.rows, abs=1e-5)


def test_errors_of_the_command_name_the_cause(synthetic_run, tmp_path, capsys):
    assert main([str(tmp_path / "none")]) == 2
    assert "none" in capsys.readouterr().err
    run = synthetic_run(steps=4)
    write_run(run, tmp_path / "old")
    assert main([str(tmp_path / "old")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: auv1 of run 1: no dead reckoning (topic dead_reckoning)")
    assert not (tmp_path / "old" / "adjusted").exists()


def test_samples_are_not_needed_for_mates_whose_own_recordings_are_given(synthetic_run):
    run = dived(synthetic_run)
    with_samples = adjust([run])
    assert any(len(vehicle.received) for vehicle in run.vehicles)
    for vehicle in run.vehicles:
        vehicle.received = Soundings.from_rows(())
    without = adjust([run])
    assert np.array_equal(with_samples.correction.theta, without.correction.theta)
    assert with_samples.ranges == without.ranges > 0


def test_mission_files_with_an_area_file_are_read_beside_a_recording_and_instead_of_its_own(
    synthetic_run, tmp_path, capsys
):
    """Copied beside it, one that says the same gets no note."""
    ring = [[6.595, 46.497], [6.605, 46.497], [6.605, 46.503], [6.595, 46.503], [6.595, 46.497]]
    (tmp_path / "lake.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    run = dived(synthetic_run)
    written = copy.deepcopy(run.parameters)
    written["/**"]["area"] = {"file": "../lake.geojson", "origin_lat_deg": 46.5, "origin_lon_deg": 6.6}
    (tmp_path / "run").mkdir()
    run.parameters = in_metres(written, tmp_path / "run", "it", read_area)
    write_run(run, tmp_path / "run")
    mission = tmp_path / "run" / "mission.yaml"
    write_mission_file(mission, written)
    assert main([str(tmp_path / "run"), "--out", str(tmp_path / "one")]) == 0
    assert "ignored" not in capsys.readouterr().out
    assert main([str(tmp_path / "run"), "--mission", str(mission), "--out", str(tmp_path / "two")]) == 0
    assert (tmp_path / "one" / "depth.asc").read_text() == (tmp_path / "two" / "depth.asc").read_text()
    capsys.readouterr()
    written["/**"]["area"]["origin_lat_deg"] = 46.501
    write_mission_file(mission, written)
    assert main([str(tmp_path / "run"), "--out", str(tmp_path / "three")]) == 0
    assert f"{mission} is not the mission file in the recording" in capsys.readouterr().out
