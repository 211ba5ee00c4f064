"""auv_lse certify: what it supports, what it contradicts and where, and what it refuses."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.topics.records import CentersReport, FieldReport
from auv_lse_common.topics.table import VEHICLE_TOPICS
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_record import run_writer
from auv_lse_shore.certify import calibration, checks
from auv_lse_shore.judge.evaluation import local_map
from auv_lse_shore.judge.team_map import mission_settings, team_map

main = verb_main("certify")

ORIGIN = (46.5, 6.6)


def made(synthetic_run, steps=20, **level_set):
    """A mission without corrected positions, on Earth."""
    run = synthetic_run(steps=steps)
    run.ground = None
    run.parameters["/**"]["area"].update(origin_lat_deg=ORIGIN[0], origin_lon_deg=ORIGIN[1])
    run.parameters["/**"]["level_set"].update(level_set)
    return run


def published(run, vehicle, change=None):
    """The vehicle's own last map and its centers; `change` alters the centers before the map is computed."""
    settings = mission_settings(run.parameters, vehicle.vehicle)[-1]
    area = OperatingArea(settings.area)
    depth_map = local_map(vehicle, settings, area, 1.0)
    centers = depth_map.centers
    if change is not None:
        centers = change(centers)
        depth_map = DepthMap(settings.gp, settings.level_set, area)
        depth_map.gp.posterior.follow(centers)
    field, stamp_s = depth_map.field(), float(vehicle.soundings.stamp_s[-1])
    report = FieldReport(
        stamp_s=stamp_s,
        north_m=field.grid.north_m,
        east_m=field.grid.east_m,
        level_m=settings.level_set.level_m,
        variance_scale=field.variance_scale,
        **{name: getattr(field, name).copy() for name in ("mean_m", "std_m", "risk", "p_safe")},
    )
    return report, CentersReport(
        stamp_s=stamp_s,
        revision=1,
        locations_m=centers.locations_m,
        depths_m=centers.depths_m,
        noise_std_m=centers.noise_std_m,
    )


def write(monkeypatch, run, folder, alter=None, change=None):
    """Writes a recording with the vehicles' maps; `alter` changes the published map of auv2, `change` its centers."""
    values = run_writer._values

    def with_maps(vehicle):
        yield from values(vehicle)
        second = vehicle.vehicle == 2
        field, centers = published(run, vehicle, change if second else None)
        if second and alter is not None:
            alter(field)
        yield VEHICLE_TOPICS["kernel_centers"], centers.stamp_s, centers
        yield VEHICLE_TOPICS["field"], field.stamp_s, field

    with monkeypatch.context() as patch:
        patch.setattr(run_writer, "_values", with_maps)
        run_writer.write_run(run, folder)
    return folder


def certificate(folder):
    return json.loads((folder / "certificate" / "certificate.json").read_text())


@pytest.fixture(scope="module")
def healthy(tmp_path_factory, synthetic_run):
    with pytest.MonkeyPatch.context() as patch:
        return write(patch, made(synthetic_run), tmp_path_factory.mktemp("certify") / "run")


def test_a_healthy_mission_is_supported(healthy, capsys):
    assert main([str(healthy)]) == 0
    found, page = certificate(healthy), (healthy / "certificate" / "certificate.html").read_text()
    assert found["verdict"] == "supported"
    assert len(found["checks"]) == 10
    assert all(check["passed"] for check in found["checks"])
    assert found["asked"]["level_m"] == 15.0
    pieces = found["promised"]["pieces"]
    assert sum(p["length_m"] for p in pieces if p["class"] == "found") == pytest.approx(
        found["promised"]["found_m"], abs=1.0
    )
    assert {"latitude_deg", "north_m"} <= set(pieces[0]["from"])
    assert 0.0 <= found["not_promised"]["undiscovered_m"] <= found["not_promised"]["undiscovered_limit_m"]
    bag = next((healthy / "bag").glob("*.mcap"))
    digest = hashlib.sha256(bag.read_bytes()).hexdigest()
    assert [file["sha256"] for file in found["files"]] == [digest]
    assert digest in page.replace("<wbr>", "")
    assert found["repeat"] in page
    assert "support the maps" in capsys.readouterr().out


def test_what_may_be_missing_is_that_of_the_report(synthetic_run, tmp_path, monkeypatch):
    run = made(synthetic_run, steps=4)
    assert main([str(write(monkeypatch, run, tmp_path / "run"))]) == 0
    missing, report = certificate(tmp_path / "run")["not_promised"], team_map(run).undiscovered
    page = (tmp_path / "run" / "certificate" / "certificate.html").read_text()
    expected = f"{missing['undiscovered_m']:,.0f} m of isobath"
    assert re.search(rf"Isobath farther than 10 m from the pieces found: {expected} (expected|on average)", page)
    # the pieces found differ by less than a cell at each of their ends
    assert missing["undiscovered_m"] == pytest.approx(report.expected_m, rel=0.005)
    assert missing["undiscovered_limit_m"] == pytest.approx(report.limit_m, rel=0.01)


def test_every_recording_of_a_dive_is_listed(healthy, tmp_path):
    for name in ("bag", "bag-2"):
        shutil.copytree(healthy / "bag", tmp_path / name)
    main([str(tmp_path)])
    assert len(certificate(tmp_path)["files"]) == 2


def test_a_second_certificate_replaces_the_first_and_is_the_same(healthy, tmp_path):
    for _ in range(2):
        assert main([str(healthy), "--out", str(tmp_path)]) == 0
        first = (tmp_path / "certificate.json").read_bytes()
    assert main([str(healthy / "bag"), "--out", str(tmp_path)]) == 0  # nothing beside the recording is used
    second = (tmp_path / "certificate.json").read_bytes()
    assert first.replace(b"auv_lse certify run", b"auv_lse certify bag") == second
    assert {path.name for path in tmp_path.iterdir()} == {"certificate.json", "certificate.html"}


def test_an_altered_map_is_contradicted_at_its_location(monkeypatch, synthetic_run, tmp_path, capsys):
    def alter(field):
        field.mean_m[30, 20] += 0.03

    folder = write(monkeypatch, made(synthetic_run), tmp_path / "run", alter)
    assert main([str(folder)]) == 1
    bad = [check for check in certificate(folder)["checks"] if not check["passed"]]
    assert {(check["vehicle"], check["cells_beyond"]) for check in bad} == {(2, 1)}
    assert (bad[0]["at"]["north_m"], bad[0]["at"]["east_m"]) == (183.0, 123.0)
    assert bad[0]["at"]["latitude_deg"] == pytest.approx(ORIGIN[0], abs=0.01)
    assert bad[0]["published"] - bad[0]["recomputed"] == pytest.approx(0.03, abs=0.01)
    error = capsys.readouterr().err
    assert "auv2: depth, against the recorded kernel centers" in error
    assert "north 183 m, east 123 m (46.50" in error


@pytest.mark.parametrize(("by_m", "code"), [(0.03, 0), (-60.0, 1)])
def test_old_parts_of_a_large_map_are_noted_and_compared_with_the_soundings(
    monkeypatch, synthetic_run, tmp_path, by_m, code
):
    def alter(field):
        field.mean_m[30, 20] += by_m

    monkeypatch.setattr(checks, "DENSE_CENTERS", 1)  # every map counts as a large one
    monkeypatch.setattr(checks, "TILED_SIGMAS", 0.0)
    folder = write(monkeypatch, made(synthetic_run), tmp_path / "run", alter)
    assert main([str(folder)]) == code
    found = certificate(folder)
    bad = [check["what"] for check in found["checks"] if not check["passed"]]
    assert bad == code * ["depth, against the soundings"]
    assert any(text.startswith("auv2: 1 of ") and "published in parts" in text for text in found["cannot_certify"])


def test_a_map_that_no_sounding_supports_is_contradicted(monkeypatch, synthetic_run, tmp_path, capsys):
    def change(centers):  # one that fits the published map
        depths = centers.depths_m.copy()
        depths[np.hypot(*(centers.locations_m - [120.0, 250.0]).T) < 40.0] -= 3.0
        return Centers(centers.locations_m, depths, centers.noise_std_m)

    folder = write(monkeypatch, made(synthetic_run), tmp_path / "run", change=change)
    assert main([str(folder)]) == 1
    bad = [check for check in certificate(folder)["checks"] if not check["passed"]]
    assert [check["what"] for check in bad] == ["depth, against the soundings"]
    assert np.hypot(bad[0]["at"]["north_m"] - 120.0, bad[0]["at"]["east_m"] - 250.0) < 60.0
    assert "not supported: auv2" in capsys.readouterr().err


def test_a_map_of_another_level_is_contradicted(monkeypatch, synthetic_run, tmp_path):
    def alter(field):
        object.__setattr__(field, "level_m", 14.0)

    folder = write(monkeypatch, made(synthetic_run), tmp_path / "run", alter)
    assert main([str(folder)]) == 1


def test_without_a_published_map_it_says_what_it_cannot_certify(synthetic_run, tmp_path, capsys):
    run = made(synthetic_run, steps=8)
    for vehicle in run.vehicles:  # as auv_lse import writes it
        vehicle.decisions = []
    run_writer.write_run(run, tmp_path / "run")
    assert main([str(tmp_path / "run")]) == 3
    found = certificate(tmp_path / "run")
    assert found["verdict"] == "nothing published"
    assert found["map"]["soundings"] > 0
    text = capsys.readouterr().out
    assert "auv1: its recording has no published map" in text
    assert "no plan is recorded" in text


def test_a_truncated_recording_and_an_empty_file_are_refused(healthy, tmp_path, capsys):
    whole = next((healthy / "bag").glob("*.mcap")).read_bytes()
    for name, data in (("half.mcap", whole[: len(whole) // 2]), ("empty.mcap", b"")):
        (tmp_path / name).write_bytes(data)
        assert main([str(tmp_path / name)]) == 2
        assert name in capsys.readouterr().err
    assert main([str(tmp_path / "nothing")]) == 2
    assert not (tmp_path / "certificate").exists()


def test_a_recording_without_soundings_is_refused(synthetic_run, tmp_path, capsys):
    run = made(synthetic_run, steps=2)
    for vehicle in run.vehicles:
        vehicle.soundings = vehicle.soundings[:0]
    run_writer.write_run(run, tmp_path / "run")
    assert main([str(tmp_path / "run")]) == 2
    assert "holds no sounding" in capsys.readouterr().err


def alone(run, number):
    """The recording of one vehicle."""
    run.vehicles = [v for v in run.vehicles if v.vehicle == number]
    return run


def test_recordings_of_one_mission_are_certified_together_and_of_two_refused(
    monkeypatch, healthy, synthetic_run, tmp_path, capsys
):
    first = write(monkeypatch, alone(made(synthetic_run), 1), tmp_path / "auv1")
    second = write(monkeypatch, alone(made(synthetic_run), 2), tmp_path / "auv2")
    assert main([str(first), str(second)]) == 0
    both = certificate(first)
    assert len(both["files"]) == 2
    assert main([str(healthy)]) == 0
    assert both["promised"] == certificate(healthy)["promised"]
    assert main([str(first), str(first)]) == 2
    assert "each vehicle once" in capsys.readouterr().err
    other = write(monkeypatch, alone(made(synthetic_run, level_m=14.0), 2), tmp_path / "other")
    assert main([str(first), str(other)]) == 2
    assert "section level_set" in capsys.readouterr().err
    late = alone(made(synthetic_run), 2)
    for vehicle in late.vehicles:
        vehicle.soundings.stamp_s[:] += 5000.0
    write(monkeypatch, late, tmp_path / "late")
    assert main([str(first), str(tmp_path / "late")]) == 2
    assert "Certify missions one by one" in capsys.readouterr().err


def test_the_calibration_is_that_of_the_evidence():
    page = Path(__file__).resolve().parents[3] / "docs" / "evidence" / "gp.md"
    row = re.search(r"^\| all \|(.*)\|$", page.read_text(), re.MULTILINE)
    assert row is not None
    cells = [cell.strip() for cell in row[1].split("|")]
    assert int(cells[0]) == calibration.MISSIONS
    assert float(cells[3]) == calibration.LENGTH_RATIO
    low, high = calibration.LIMIT_INTERVAL
    assert cells[6] == f"{calibration.LIMIT_HOLDS:.2f} ({low:.2f} to {high:.2f})"
    assert float(cells[7]) == calibration.LOSS_RATIO
    assert float(cells[8]) == calibration.BAND_HOLDS
