"""auv_lse import: logs of a survey over a known bottom become a recording, a map and a prior."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import re
import sys

import numpy as np
import pytest
from adjust.survey_logs import ORIGIN, START_S, Dataflash, dataflash, depth_m, lanes, nmea, survey, telemetry
from verb_main import verb_main

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic
from auv_lse_record.run_reader import read_run
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.geometry import check_geometry
from auv_lse_shore.export.export import export
from auv_lse_shore.export.survey import Survey
from auv_lse_shore.judge.team_map import team_map
from auv_lse_shore.survey_import.run import LEAST_NOISE_M, _learned

adjust_main = verb_main("adjust")
export_main = verb_main("export")
fit = verb_main("fit")
main = verb_main("import")

DRAUGHT = ["--draught", "0.3"]


def table(rows, time=True):
    """A CSV in degrees; depths are below the surface."""
    header = "time_s,lat,lon,depth_m" if time else "lat,lon,depth_m"
    lines = [",".join(f"{v:.8f}" for v in (row if time else row[1:])) for row in rows]
    return "\n".join([header, *lines]) + "\n"


def metres(rows):
    """A CSV in metres without times."""
    north, east = local_from_geodetic(rows[:, 1], rows[:, 2], *ORIGIN)
    lines = [f"{n:.3f},{e:.3f},{d:.3f}" for n, e, d in zip(north, east, rows[:, 3], strict=True)]
    return "\n".join(["north_m,east_m,depth_m", *lines]) + "\n"


LOGS = {
    "a.nmea": lambda rows: nmea(rows).encode(),
    "a.BIN": lambda rows: dataflash(rows).data,
    "sub.bin": lambda rows: dataflash(rows, "ArduSub V4.1.2", immersion_m=2.0).data,
    "a.tlog": telemetry,
    "a.csv": lambda rows: table(rows).encode(),
    "timeless.csv": lambda rows: table(rows, time=False).encode(),
    "metres.csv": lambda rows: metres(rows).encode(),
}


def written(folder, name, rows=None):
    path = folder / name
    path.write_bytes(LOGS[name](survey() if rows is None else rows))
    return path


@pytest.mark.parametrize("name", LOGS)
def test_every_format_gives_the_known_depths(tmp_path, name):
    path = written(tmp_path, name)
    assert main([str(path), "--out", str(tmp_path / "run"), *DRAUGHT, "--level", "11"]) == 0
    run = read_run(tmp_path / "run")
    soundings = run.vehicles[0].soundings
    assert len(soundings) == len(survey())
    if name == "metres.csv":
        assert run.origin is None
    else:
        assert run.origin == pytest.approx(ORIGIN, abs=1e-6)
    # 2 cm: logs have centimetres, and 1e-7 deg
    assert soundings.depth_m == pytest.approx(depth_m(soundings.north_m, soundings.east_m), abs=0.02)
    starts_in_utc = name not in ("timeless.csv", "metres.csv")
    assert soundings.stamp_s[0] == pytest.approx(START_S if starts_in_utc else 0.0, abs=0.01)


def test_the_map_has_the_known_depth_and_its_isobath_is_exported(tmp_path):
    path, run = written(tmp_path, "a.BIN"), tmp_path / "run"
    assert main([str(path), "--out", str(run), *DRAUGHT, "--level", "11"]) == 0
    team = team_map(read_run(run))
    north, east = np.meshgrid(team.field.grid.north_m, team.field.grid.east_m, indexing="ij")
    surveyed = (north > 0) & (north < 120) & (east > 0) & (east < 160)
    error = (team.field.mean_m - depth_m(north, east))[surveyed]
    assert np.abs(error).max() < 0.25  # the hump is 3 m high, lanes are 20 m apart
    list(export(run, run / "export"))
    features = json.loads((run / "export/isobath.geojson").read_text())["features"]
    found = [f for f in features if f["properties"]["class"] == "found"]
    lon, lat = np.concatenate([line for f in found for line in f["geometry"]["coordinates"]]).T
    line = np.column_stack(local_from_geodetic(lat, lon, *ORIGIN))
    inside = (line > 0).all(axis=1) & (line < [120, 160]).all(axis=1)
    assert inside.sum() > 10
    assert depth_m(*line[inside].T) == pytest.approx(11.0, abs=0.25)


@pytest.mark.parametrize(("altitude", "has_times"), [(True, True), (False, True), (False, False)])
def test_sound_speed_corrects_the_range_below_the_transducer_alone(tmp_path, altitude, has_times):
    """A vehicle's own depth comes from pressure; a boat's is 0, also without times."""
    depth = "depth,height above bottom" if altitude else "depth"
    text = f"lat,lon,{depth}{',utc' if has_times else ''}\n"
    for stamp_s, lat, lon, _ in survey():
        values = f"{6.0 + stamp_s % 3:.3f}" + altitude * ",6.000"
        text += f"{lat:.8f},{lon:.8f},{values}{f',{stamp_s:.0f}' if has_times else ''}\n"
    (tmp_path / "a.csv").write_text(text)
    assert main([str(tmp_path / "a.csv"), "--out", str(tmp_path / "run")]) == 0
    run = read_run(tmp_path / "run")
    recorded = run.vehicles[0].soundings.depth_m
    reduced = Survey(sound_speed=np.array([[0.0, 1450.0]])).reduce(run).vehicles[0].soundings.depth_m
    assert recorded - reduced == pytest.approx((6.0 if altitude else recorded) * 50.0 / 1500.0, abs=2e-3)


@pytest.mark.parametrize("is_bowl", [False, True])
def test_the_prior_of_a_smooth_bottom_has_a_mean_within_the_depths(tmp_path, is_bowl):
    """An endless length scale fits a plane best; that of a bowl is long, with a mean above its rim."""
    rows = survey()
    at = (rows[:, 1:3] - rows[:, 1:3].min(axis=0)) / np.ptp(rows[:, 1:3], axis=0)  # 0 to 1
    rows[:, 3] = 18.0 - 8.0 * ((at - 0.5) ** 2).sum(axis=1) / 0.5 if is_bowl else 12.0 + 4.0 * at[:, 0]
    path = tmp_path / "slope.csv"
    path.write_text(table(rows))
    assert main([str(path), "--out", str(tmp_path / "run"), "--level", "14"]) == 0
    gp = read_run(tmp_path / "run").parameters["/**"]["gp"]
    extent_m = np.ptp(np.stack(local_from_geodetic(rows[:, 1], rows[:, 2], *ORIGIN)), axis=1).max()
    assert gp["length_scale_m"] <= 0.5 * extent_m + 0.1
    assert rows[:, 3].min() < gp["mean_depth_m"] < rows[:, 3].max()
    assert gp["signal_std_m"] >= rows[:, 3].std() - 1e-3


def test_the_prior_does_not_depend_on_which_spikes_were_drawn() -> None:
    """A bay of 40,000 m2 with more soundings than are used, of which 1 % are wrong by metres."""
    rng = np.random.default_rng(3)
    north, east = rng.uniform(0.0, 200.0, (2, 8000))
    depth = 10.0 + 3.0 * np.sin(north / 25.0) * np.cos(east / 25.0) + rng.normal(0.0, 0.05, 8000)
    depth[rng.choice(8000, 80, replace=False)] += rng.normal(0.0, 4.0, 80)
    points = np.column_stack([north, east, depth])
    first, second = (_learned(rows, LEAST_NOISE_M) for rows in (points, points[rng.permutation(8000)]))
    for name in ("length_scale_m", "signal_std_m", "noise_std_m"):  # with one draw of 300 they differed by 4 times
        assert first[name] == pytest.approx(second[name], rel=0.1)
    assert first["noise_std_m"] == pytest.approx(math.hypot(0.05, math.sqrt(0.01) * 4.0), rel=0.25)


@pytest.mark.parametrize("span_m", [3.0, 300.0])
def test_the_log_of_a_boat_at_anchor_is_no_survey(tmp_path, capsys, span_m):
    rng = np.random.default_rng(2)
    lat, lon = geodetic_from_local(np.linspace(0.0, span_m, 200), rng.uniform(0.0, 1.0, 200), *ORIGIN)
    rows = np.column_stack([START_S + np.arange(200), lat, lon, rng.normal(5.0, 0.1, 200)])
    (tmp_path / "a.csv").write_text(table(rows))
    assert main([str(tmp_path / "a.csv"), "--out", str(tmp_path / "run"), "--position-std", "1.5"]) == 0
    text = capsys.readouterr().out
    assert ("the boat hardly moved" in text) == (span_m < 15.0)
    assert "length scale 0 m" not in text


def test_a_survey_can_be_adjusted_and_gives_a_prior(tmp_path):
    path, run = written(tmp_path, "a.nmea"), tmp_path / "run"
    assert main([str(path), "--out", str(run), *DRAUGHT]) == 0
    assert adjust_main([str(run), "--out", str(tmp_path / "adjusted")]) == 0
    assert (tmp_path / "adjusted/isobath.geojson").is_file()
    assert fit([str(run), "--points", "100", "--restarts", "1", "--out", str(tmp_path / "gp.yaml")]) == 0
    gp = read_parameter_file(tmp_path / "gp.yaml")["/**"]["gp"]
    assert 8.0 < gp["mean_depth_m"] < 16.0


@pytest.mark.parametrize("water_m", [0.2, 0.6, 1.0])
def test_the_proposed_dive_suits_shallow_water(tmp_path, capsys, water_m):
    """Vehicles cross the isobath, apart in depth, also by floating-point numbers that differ by a hair less."""
    rows = [(t, a, o, d * water_m) for t, a, o, d in survey()]
    run = tmp_path / "run"
    assert main([str(written(tmp_path, "a.nmea", rows)), "--out", str(run), *DRAUGHT]) == 0
    settings = Settings.load(run / "dive.yaml")
    found = Findings()
    check_geometry(settings, found)
    assert not [text for _, text in found.rows if "too close" in text or "to cross the isobath" in text]
    assert ("shallow water: in dive.yaml" in capsys.readouterr().out) == (water_m < 0.5)
    depths_m = [own.vehicle.depth_m for own in settings.vehicles]
    assert depths_m[1] - depths_m[0] >= 0.5 - 1e-9


def test_what_cannot_be_used_is_left_out_and_counted(tmp_path, capsys):
    rows = survey()
    rows[100:110, 3] = 0.0  # no echo
    rows[200, 3] += 30.0  # a fish
    rows[300, 1] += 0.01  # a GPS jump of 1.1 km
    lines = nmea(rows).splitlines(keepends=True)
    lines[3 * 400 + 2] = lines[3 * 400 + 2].replace("SDDBT", "SDDBT,9")  # a damaged line
    lines[0] = lines[0].replace(",A,", ",V,")
    path = tmp_path / "a.nmea"
    path.write_text("".join(lines))
    assert main([str(path), "--out", str(tmp_path / "run"), *DRAUGHT]) == 0
    printed = capsys.readouterr().out
    for count, reason in (
        (10, "depths of 0 or less: no echo"),
        (1, "sounding: jump"),
        (1, "position that jumps"),
        (1, "RMC sentence with a wrong checksum (--accept-checksums uses them)"),
        (1, "DBT sentence with a wrong checksum (--accept-checksums uses them)"),
    ):
        assert f"left out: {count} {reason}\n" in printed
        assert f"left out: {count} {reason}\n" in (tmp_path / "run/import.md").read_text()
    soundings = read_run(tmp_path / "run").vehicles[0].soundings
    # 0.1 m: the position without a position is between its neighbours
    assert soundings.depth_m == pytest.approx(depth_m(soundings.north_m, soundings.east_m), abs=0.1)
    assert f"{len(soundings)} soundings of {len(rows) - 11} depths" in printed
    assert len(soundings) == len(rows) - 1 - 10 - 1


@pytest.mark.parametrize("name", ["a.BIN", "a.tlog"])
def test_depths_out_of_the_range_finders_range_are_left_out(tmp_path, capsys, name):
    rows = survey()
    if name == "a.BIN":
        log = dataflash(rows[:300])
        for i, (stamp, *_) in enumerate(rows[300:320]):
            log.add("RFND", 5_000_000 + round(1e6 * (stamp - START_S)) + i, 0, 4000, 3, 25)
        data = log.data
    else:
        rows[:20, 3] = 50.0  # the sensor's largest distance
        data = telemetry(rows)
    (tmp_path / name).write_bytes(data)
    assert main([str(tmp_path / name), "--dry-run"]) == 0
    assert "left out: 20 depths out of the range finder's range\n" in capsys.readouterr().out


def test_range_finders_of_older_firmware_are_read(tmp_path):
    log = Dataflash(old=True)
    for i, (_, lat, lon, depth) in enumerate(survey()[:50]):
        log.add("POS", 1_000_000 * i, round(lat * 1e7), round(lon * 1e7), 372.0, 0.0, 0.0)
        log.add("RFND", 1_000_000 * i, 500, 0, round(100 * depth), 25)  # the first one looks ahead
    (tmp_path / "old.bin").write_bytes(log.data)
    assert main([str(tmp_path / "old.bin"), "--out", str(tmp_path / "run"), *DRAUGHT]) == 0
    soundings = read_run(tmp_path / "run").vehicles[0].soundings
    assert len(soundings) == 50
    assert soundings.depth_m == pytest.approx(depth_m(soundings.north_m, soundings.east_m), abs=0.02)


def test_a_telemetry_log_of_two_vehicles_gives_both(tmp_path, capsys):
    rows = survey()[:50]
    other = rows + np.array([0.0, 0.01, 0.0, 9.0])
    logs = ((1, rows), (2, other))
    (tmp_path / "two.tlog").write_bytes(b"".join(telemetry(r[i : i + 1], n) for i in range(50) for n, r in logs))
    assert main([str(tmp_path / "two.tlog"), "--out", str(tmp_path / "run"), *DRAUGHT]) == 0
    printed = capsys.readouterr().out
    assert "two.tlog (vehicle 1)" in printed
    assert "two.tlog (vehicle 2)" in printed
    vehicles = read_run(tmp_path / "run").vehicles
    soundings = [vehicle.soundings for vehicle in vehicles]
    assert [vehicle.vehicle for vehicle in vehicles] == [1, 2]
    assert soundings[0].depth_m == pytest.approx(depth_m(soundings[0].north_m, soundings[0].east_m), abs=0.02)
    assert soundings[1].depth_m == pytest.approx(soundings[0].depth_m + 9.0, abs=0.02)
    assert soundings[1].north_m - soundings[0].north_m == pytest.approx(1112.0, abs=2.0)


@pytest.mark.parametrize(("kept", "missing"), [("GLOBAL_POSITION_INT", "depths"), ("DISTANCE_SENSOR", "positions")])
def test_a_vehicle_without_depths_or_positions_in_a_telemetry_log_is_reported(tmp_path, capsys, kept, missing):
    """The first vehicle in the log is not the one with soundings."""
    rows = survey()[:50]
    data = telemetry(rows[:1], 7, kinds=(kept,)) + telemetry(rows, 2) + telemetry(rows[1:5], 7, kinds=(kept,))
    (tmp_path / "a.tlog").write_bytes(data)
    assert main([str(tmp_path / "a.tlog"), "--out", str(tmp_path / "run"), *DRAUGHT]) == 0
    assert f"left out: 5 messages of vehicle 7, which has no {missing}\n" in capsys.readouterr().out
    assert len(read_run(tmp_path / "run").vehicles[0].soundings) == 50


def test_a_wrong_time_does_not_fill_the_memory(tmp_path):
    rows = survey()[:50]
    rows[-1, 0] += 1e9  # 30 years
    (tmp_path / "late.csv").write_text(table(rows))
    assert main([str(tmp_path / "late.csv"), "--out", str(tmp_path / "run")]) == 0
    assert len(read_run(tmp_path / "run").vehicles[0].odometry) == 49


def test_a_truncated_log_is_imported_up_to_its_end(tmp_path):
    for name in ("a.BIN", "a.tlog"):
        path = written(tmp_path, name)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2 + 7])
        assert main([str(path), "--out", str(tmp_path / f"run {name}"), *DRAUGHT]) == 0
        soundings = read_run(tmp_path / f"run {name}").vehicles[0].soundings
        assert 200 < len(soundings) < 400
        assert soundings.depth_m == pytest.approx(depth_m(soundings.north_m, soundings.east_m), abs=0.02)


def without(name, *kinds):
    return "".join(line for line in nmea(survey()).splitlines(keepends=True) if not any(k in line for k in kinds))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (without("a", "DBT").encode(), "no usable depths (630 positions of GPGGA; 630 positions of GPRMC)"),
        (without("a", "GGA", "RMC").encode(), "no usable positions (630 depths of SDDBT)"),
        (dataflash([]).data, "no usable depths"),
        (b"\0\1\2\3" * 2000, "is of no format that can be read"),
        (b"\xa3\x95\x80" + b"\7" * 500 + b"\0", "is a damaged dataflash log"),
        (nmea([[*row[:3], 0.0] for row in survey()]).encode(), "630 depths of 0 or less: no echo"),
        (table(survey()[:5]).encode(), "5 usable soundings, and a map needs 10"),
        (b"this is\nno log\n", "has the columns this, is; a position or a depth is not among them"),
    ],
    ids=["empty", "no depth", "no position", "empty bin", "noise", "broken bin", "no echo", "short", "text"],
)
def test_an_unusable_log_is_refused_in_one_sentence(tmp_path, capsys, content, words):
    path = tmp_path / "log.bin" if content[:3] == b"\xa3\x95\x80" else tmp_path / "log.txt"
    path.write_bytes(content)
    assert main([str(path), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("name", "option", "use"),
    [
        ("a.nmea", ["--columns", "lat,lon,depth"], "tables"),
        ("a.nmea", ["--depth-unit", "ft"], "tables"),
        ("a.csv", ["--surface", "400"], "tables with elevations"),
        ("a.csv", ["--crs", "EPSG:32632"], "tables with positions in metres"),
        ("a.BIN", ["--no-day-first"], "tables with times"),
        ("a.tlog", ["--utc-offset", "2"], "logs with local times"),
        ("a.csv", ["--accept-checksums"], "NMEA sentences"),
    ],
)
def test_an_option_that_no_log_needs_is_refused(tmp_path, capsys, name, option, use):
    assert main([str(written(tmp_path, name)), "--out", str(tmp_path / "run"), *option]) == 2
    word = option[0].replace("no-day", "day")
    assert capsys.readouterr().err == f"error: {word} is for {use}, and there are none. Leave it out.\n"
    assert not (tmp_path / "run").exists()
    assert main([str(written(tmp_path, name)), "--dry-run"]) == 0


def test_an_option_that_one_of_several_logs_needs_is_used(tmp_path):
    logs = [str(written(tmp_path, "a.nmea")), str(written(tmp_path, "a.csv"))]
    assert main([*logs, "--dry-run", "--depth-unit", "m", "--accept-checksums"]) == 0


def test_what_is_missing_is_named(tmp_path, capsys, monkeypatch):
    assert main([str(tmp_path / "absent.bin")]) == 2
    assert "absent.bin: No such file" in capsys.readouterr().err
    path = written(tmp_path, "a.BIN")
    monkeypatch.setitem(sys.modules, "pymavlink.DFReader", None)
    assert main([str(path), "--out", str(tmp_path / "run")]) == 2
    assert "need the Python package pymavlink, which is not installed: pip install pymavlink" in capsys.readouterr().err


def test_ctrl_c_leaves_nothing_and_a_second_import_replaces_nothing(tmp_path, capsys, monkeypatch):
    path, out = written(tmp_path, "a.csv"), tmp_path / "run"

    def interrupted(run, folder):
        (folder / "mission.yaml").write_text("half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("auv_lse_shore.survey_import.run.write_run", interrupted)
        assert main([str(path), "--out", str(out)]) == 130
    assert "nothing is written" in capsys.readouterr().err
    assert not out.exists()
    assert main([str(path), "--dry-run", "--out", str(out)]) == 0
    assert not out.exists()
    assert main([str(path), "--out", str(out)]) == 0
    before = (out / "mission.yaml").read_text()
    assert main([str(path), "--out", str(out), "--level", "9"]) == 2
    assert "has a mission.yaml already" in capsys.readouterr().err
    assert (out / "mission.yaml").read_text() == before


def test_what_takes_long_is_shown_to_the_end(tmp_path, capsys, monkeypatch):
    path = written(tmp_path, "a.csv")
    assert main([str(path), "--out", str(tmp_path / "quick")]) == 0
    assert "..." not in capsys.readouterr().out
    monkeypatch.setattr("auv_lse_shore.survey_import.command._LINE_S", 0.0)
    assert main([str(path), "--out", str(tmp_path / "slow")]) == 0
    out = capsys.readouterr().out
    shown = [line for line in out.splitlines() if line.endswith((" ...", " %"))]
    assert shown == [
        f"reading a.csv [{'#' * 30}] 100 %", "placing a.csv ...", "learning the prior ...",
        f"writing {tmp_path / 'slow'} ...",
    ]  # fmt: skip
    assert "..." not in (tmp_path / "slow" / "import.md").read_text()


def test_several_logs_become_one_run_one_after_the_other(tmp_path):
    rows = survey()
    first, second = written(tmp_path, "a.nmea", rows[:300]), written(tmp_path, "a.tlog", rows[400:])
    assert main([str(second), str(first), "--out", str(tmp_path / "run"), *DRAUGHT]) == 0
    soundings = read_run(tmp_path / "run").vehicles[0].soundings
    assert len(soundings) == 530
    assert (np.diff(soundings.stamp_s) > 0).all()
    # the earlier log comes first; the origin is the first LOG's first position; times stay UTC
    assert soundings.north_m[:5] - soundings.north_m[0] == pytest.approx([0.0] * 5, abs=0.05)
    assert soundings.stamp_s[300] - soundings.stamp_s[299] == pytest.approx(101.0, abs=0.1)


def test_vehicles_that_took_turns_in_a_table_are_logs_of_their_own(tmp_path, capsys):
    """As in the soundings that auv_lse export writes: read as one track, every position would jump."""
    rows = survey()
    half = len(rows) // 2
    turns = []
    for stamp_s, first, second in zip(rows[:, 0], rows[:half, 1:], rows[half:, 1:], strict=False):
        for name, (lat, lon, depth) in (("auv1", first), ("auv2", second)):
            turns.append(f"{stamp_s:.3f},{name},{lat:.8f},{lon:.8f},{depth:.3f}")
    (tmp_path / "two.csv").write_text("\n".join(["time_s,vehicle,lat,lon,depth_m", *turns]) + "\n")
    assert main([str(tmp_path / "two.csv"), "--out", str(tmp_path / "run")]) == 0
    shown = capsys.readouterr().out
    assert "two.csv, vehicle auv1: " in shown
    assert "jump" not in shown
    assert "2 boats, because their logs are of the same time" in shown
    boats = read_run(tmp_path / "run").vehicles
    assert [len(boat.soundings) for boat in boats] == [half, half]


def test_the_mission_files_of_a_long_track_have_cells_that_a_map_can_have(tmp_path):
    """21 km to the north-east: a default cell of 5 m divides the area's extent into 9 million."""
    along_m = np.arange(0.0, 15e3, 25.0)
    lat, lon = geodetic_from_local(along_m, along_m, *ORIGIN)
    rows = np.column_stack([START_S + along_m, lat, lon, 10.0 + 3.0 * np.sin(along_m / 400.0)])
    assert main([str(written(tmp_path, "a.csv", rows)), "--out", str(tmp_path / "run")]) == 0
    for name in ("mission.yaml", "dive.yaml"):
        findings = Findings()
        check_geometry(Settings.load(tmp_path / "run" / name), findings)
        assert [text for level, text in findings.rows if level == "error"] == [], name


def columns_of(path, *names):
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return [[row[name] for row in rows] for name in names]


def exported_table(rows):
    """Soundings as auv_lse export writes them: positions that were estimated to 1 to 6 m north, 2 to 3 m east."""
    north, east = local_from_geodetic(rows[:, 1], rows[:, 2], *ORIGIN)
    stds = np.column_stack([np.linspace(1.0, 6.0, len(rows)), np.linspace(3.0, 2.0, len(rows))])
    header = "time_s,vehicle,east_m,north_m,depth_m,east_std_m,north_std_m,thu_m,tvu_m,s44_order"
    lines = [
        f"{t - START_S:.3f},1,{e:.3f},{n:.3f},{d:.3f},{std[1]:.3f},{std[0]:.3f},{1.96 * np.hypot(*std):.3f},0.611,2"
        for t, e, n, d, std in zip(rows[:, 0], east, north, rows[:, 3], stds, strict=True)
    ]
    return "\n".join([header, *lines]) + "\n", stds


def test_an_exported_table_comes_back_no_surer_than_it_was(tmp_path, capsys):
    """Its positions were estimated before: they are no independent fixes, however many there are."""
    text, stds = exported_table(survey())
    (tmp_path / "soundings.csv").write_text(text)
    assert main([str(tmp_path / "soundings.csv"), "--out", str(tmp_path / "run"), "--level", "11"]) == 0
    assert "with their standard deviations (north_std_m, east_std_m)" in capsys.readouterr().out
    run = read_run(tmp_path / "run")
    assert run.vehicles[0].fixes == []
    list(export(tmp_path / "run", tmp_path / "export"))
    north, east, tvu, order = columns_of(
        tmp_path / "export/soundings.csv", "north_std_m", "east_std_m", "tvu_m", "s44_order"
    )
    # the table's three decimals
    assert np.column_stack([np.array(north, float), np.array(east, float)]) == pytest.approx(stds, abs=1.1e-3)
    assert (np.array(tvu, float) >= 0.611).all()
    assert set(order) <= {"none", "2"}
    # The map keeps the positions' common error: it adds slope times shift. Rescaling, which would use it, too, is off.
    run.parameters["/**"]["gp"]["std_soundings"] = 0.0
    team = team_map(run)
    exact = dataclasses.replace(run.vehicles[0], position_std_m=np.empty((0, 2)))
    sure = team_map(dataclasses.replace(run, vehicles=[exact]))
    inside = np.isfinite(team.field.std_m)
    assert (team.field.std_m[inside] >= sure.field.std_m[inside] - 1e-12).all()
    grid, mean = team.field.grid, team.field.mean_m
    row, column = (np.abs(axis - at).argmin() for axis, at in ((grid.north_m, 80.0), (grid.east_m, 80.0)))
    slope = (mean[row + 1, column] - mean[row - 1, column]) / (2.0 * grid.resolution_m)  # the hump's side, north of it
    nearest = np.hypot(*(lanes() - [80.0, 80.0]).T).argmin()
    added = np.sqrt(team.field.std_m[row, column] ** 2 - sure.field.std_m[row, column] ** 2)
    # 15 %: the error there is an average of the soundings' around it, whose standard deviations differ
    assert added == pytest.approx(slope * stds[nearest, 0], rel=0.15)


@pytest.mark.parametrize("origin", [None, (46.51, 6.58)])
def test_an_exported_table_comes_back_to_the_same_positions_on_earth(tmp_path, origin):
    """Also under another origin than that of its metres."""
    assert main([str(written(tmp_path, "a.csv")), "--out", str(tmp_path / "run"), "--level", "11"]) == 0
    list(export(tmp_path / "run", tmp_path / "export"))
    table, again = tmp_path / "export/soundings.csv", tmp_path / "again"
    more = [] if origin is None else ["--origin", *map(str, origin)]
    assert main([str(table), "--out", str(again), "--level", "11", *more]) == 0
    run = read_run(again)
    assert origin in (None, run.origin)
    soundings, columns = run.vehicles[0].soundings, columns_of(table, "latitude_deg", "longitude_deg", "depth_m")
    latitude, longitude, depth = np.array(columns, float)
    back = geodetic_from_local(soundings.north_m, soundings.east_m, *run.origin)
    assert np.array(back) == pytest.approx(np.array([latitude, longitude]), abs=1e-9)
    assert soundings.depth_m == pytest.approx(depth)


def test_exported_soundings_below_a_datum_come_back_without_a_question(tmp_path, capsys):
    assert main([str(written(tmp_path, "a.csv")), "--out", str(tmp_path / "run"), "--level", "11"]) == 0
    list(export(tmp_path / "run", tmp_path, survey=Survey(datum="LAT", provider=("Club", "a@b.ch"))))
    (tmp_path / "soundings_b12_auv1.geojson").read_text().index("the water surface was taken as the datum")
    capsys.readouterr()
    for name in ("soundings.csv", "soundings_b12_auv1.geojson"):
        assert main([str(tmp_path / name), "--out", str(tmp_path / f"again {name}"), "--level", "11"]) == 0
        printed = capsys.readouterr().out
        assert "question" not in printed
        assert "depths are reduced to LAT: auv_lse export --datum LAT keeps it" in printed
        first, again = (read_run(tmp_path / folder).vehicles[0].soundings for folder in ("run", f"again {name}"))
        assert again.depth_m == pytest.approx(first.depth_m, abs=6e-4)  # three decimals


def test_unknown_uncertainties_stay_unknown(tmp_path):
    text, _ = exported_table(survey())
    lines = [",".join([*line.split(",")[:5], "", "", "", "", "none"]) for line in text.splitlines()[1:]]
    (tmp_path / "soundings.csv").write_text("\n".join([text.splitlines()[0], *lines]) + "\n")
    assert main([str(tmp_path / "soundings.csv"), "--out", str(tmp_path / "run"), "--level", "11"]) == 0
    list(export(tmp_path / "run", tmp_path / "export"))
    north, order = columns_of(tmp_path / "export/soundings.csv", "north_std_m", "s44_order")
    assert set(north) == {""}
    assert set(order) == {"none"}


def test_estimated_positions_are_not_mixed_with_measured_ones(tmp_path, capsys):
    (tmp_path / "soundings.csv").write_text(exported_table(survey())[0])
    header, *rows = metres(survey() + np.array([0.0, 0.0, 0.0, 1.0])).splitlines()
    timed = "\n".join(f"{second},{row}" for second, row in enumerate(rows))
    (tmp_path / "b.csv").write_text(f"time_s,{header}\n{timed}\n")
    arguments = [str(tmp_path / name) for name in ("soundings.csv", "b.csv")]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 2
    assert "states standard deviations of its positions, and others do not. Import it alone" in capsys.readouterr().err


def test_part_of_a_log_an_origin_and_the_transducers_position(tmp_path):
    path, out = written(tmp_path, "a.csv"), tmp_path / "run"
    part = ["--from", "100", "--to", "150", "--offset", "2", "1", "--origin", "46.4999", "6.6"]
    assert main([str(path), "--out", str(out), *part]) == 0
    run = read_run(out)
    soundings, rows = run.vehicles[0].soundings, survey()[100:151]
    assert run.origin == (46.4999, 6.6)
    assert len(soundings) == 51
    north, east = local_from_geodetic(rows[:, 1], rows[:, 2], 46.4999, 6.6)
    # this lane leads west: 2 m ahead is west, 1 m to starboard is north
    assert soundings.north_m == pytest.approx(north + 1.0, abs=0.01)
    assert soundings.east_m == pytest.approx(east - 2.0, abs=0.01)


def test_the_help_names_the_exit_codes(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    assert "Exit codes: 0 success; 2" in " ".join(capsys.readouterr().out.split())
    for arguments in (["x", "--from", "9", "--to", "3"], ["x", "--origin", "95", "0"], ["x", "--density", "0"]):
        assert main(arguments) == 2


def test_times_stay_utc_to_a_tide_table_and_own_crowdsourced_bathymetry_comes_back_equal(tmp_path):
    rows = survey()[:60]
    path, run, back = written(tmp_path, "a.nmea", rows), tmp_path / "run", tmp_path / "back"
    assert main([str(path), "--out", str(run), *DRAUGHT]) == 0
    first, last = (f"{np.datetime64(round(rows[i, 0]), 's')}Z" for i in (0, -1))
    (tmp_path / "tide.csv").write_text(f"time_utc,level_m\n{first},1.0\n{last},3.0\n")
    tide = ["--water-level", str(tmp_path / "tide.csv"), "--datum", "LN02"]
    assert export_main([str(run), *tide, "--provider", "Lake Lab", "a@b.ch"]) == 0
    assert main([str(run / "export/soundings_b12_auv1.geojson"), "--out", str(back)]) == 0
    before, after = (read_run(folder).vehicles[0].soundings for folder in (run, back))
    assert len(before) > 50
    reduced = before.depth_m - np.interp(before.stamp_s, rows[[0, -1], 0], (1.0, 3.0))
    np.testing.assert_allclose(after.stamp_s, before.stamp_s, atol=2e-3)
    np.testing.assert_allclose(after.depth_m, reduced, atol=6e-3)
    features = json.loads((run / "export/soundings_b12_auv1.geojson").read_text())["features"]
    lon, lat = np.array([feature["geometry"]["coordinates"][:2] for feature in features]).T
    origin = read_run(back).origin
    np.testing.assert_allclose(np.column_stack([after.north_m, after.east_m]),
                               np.column_stack(local_from_geodetic(lat, lon, *origin)), atol=0.02)  # fmt: skip


def test_the_table_of_a_large_survey_has_one_sounding_of_each_cell_and_tells(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("auv_lse_shore.survey_import.run.MOST_SOUNDINGS", 100)
    path = written(tmp_path, "a.csv")
    assert main([str(path), "--out", str(tmp_path / "run")]) == 0
    rows = (tmp_path / "run" / "soundings.csv").read_text().splitlines()[1:]
    assert 20 < len(rows) <= 100
    assert f"soundings.csv has {len(rows)} of {len(survey())} soundings, one of each cell of" in capsys.readouterr().out
    assert len(read_run(tmp_path / "run").vehicles[0].soundings) == len(survey())


def test_a_log_of_another_lake_in_a_folder_is_left_out(tmp_path, capsys):
    written(tmp_path, "a.nmea")
    written(tmp_path, "a.tlog", survey() - [0.0, 90.0, 0.0, 0.0])
    reason = r"a\.tlog has no usable position \(\d+ positions farther than 200 km from the origin\)"
    assert main([str(tmp_path), "--dry-run"]) == 0
    assert re.search(f"left out: {reason}", capsys.readouterr().out)
    assert main([str(tmp_path / "a.nmea"), str(tmp_path / "a.tlog"), "--dry-run"]) == 2
    assert re.search(reason, capsys.readouterr().err)


def test_an_import_without_standard_output_is_whole(tmp_path, monkeypatch):
    """As with `>&-`."""
    (tmp_path / "a.csv").write_text(table(survey()))
    monkeypatch.setattr(sys, "stdout", None)
    assert main([str(tmp_path / "a.csv"), "--out", str(tmp_path / "out"), *DRAUGHT]) == 0
    monkeypatch.undo()
    assert len(read_run(tmp_path / "out").vehicles[0].soundings) == len(survey())
