"""auv_lse check: what it finds in mission files, the schema, the template, and the files that come with the project."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from ground_helpers import SURVEY_FILES, write_survey
from verb_main import verb_main

from auv_lse_common.mission_file.parameters import describe
from auv_lse_common.mission_file.sections.table import SECTIONS
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_comms.packet.codec import room_for_samples
from auv_lse_run.shipped_files import shipped_file
from auv_lse_shore import mission_options
from auv_lse_shore.check.command import check
from auv_lse_shore.check.schema import schema, schema_text, template_text
from auv_lse_shore.mission.mission import prepare

main = verb_main("check")

ROOT = Path(__file__).resolve().parents[3]
MISSIONS = sorted((ROOT / "config" / "missions").glob("*.yaml"))


def write(folder: Path, own: dict[str, Any] | None = None, **sections: Any) -> Path:
    path = folder / "a mission.yaml"
    body = {"/**": {"ros__parameters": sections}}
    if own is not None:
        body["/auv2/**"] = {"ros__parameters": own}
    path.write_text(yaml.safe_dump(body))
    return path


def found(path: Path, level: str, vehicle: str | None = None) -> list[str]:
    return [text for of, text in check(path, vehicle).rows if of == level]


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.name)
def test_every_mission_file_of_the_project_is_right(path: Path) -> None:
    assert found(path, "error") == []
    assert found(path, "warning") == []


@pytest.mark.parametrize(
    ("margin_m", "kind", "warns"), [(10.0, "mavlink", False), (3.0, "mavlink", True), (3.0, "direct", False)]
)
def test_a_margin_narrower_than_the_corners_that_an_ardusub_cuts_is_a_warning(
    tmp_path: Path, margin_m: float, kind: str, warns: bool
) -> None:
    path = write(tmp_path, area={"margin_m": margin_m}, link={"kind": kind})
    texts = [text for text in found(path, "warning") if "strays up to 4.0 m" in text]
    assert bool(texts) == warns, found(path, "warning")


def test_every_wrong_key_is_named_not_only_the_first(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        gp={"kernal": "matern52", "noise_std_m": -1.0},
        sim={"channel": {"packet_los": 0.1}},
        plannr={"horizon": 3},
        mission={"steps": 2.5},
        own={"vehicle": {"depth": 4.0}},
    )
    errors = found(path, "error")
    assert [error.removeprefix(f"{path}: ") for error in errors] == [
        "/**: gp.kernal: unknown parameter (value 'matern52'); did you mean 'kernel'?",
        "/**: gp.noise_std_m must be a number above 0 and at most 1000 m, not -1.0",
        "/**: mission.steps must be a whole number from 1 to 65,535, not 2.5",
        "/**: plannr: unknown section; did you mean 'planner'?",
        "/**: sim.channel.packet_los: unknown parameter (value 0.1); did you mean 'packet_loss'?",
        "/auv2/**: vehicle.depth: unknown parameter (value 4.0); did you mean 'depth_m'?",
    ]


TEN_MISTAKES = """\
/**:
  ros__parameters:
    mission: {vehicles: 2, steps: 50}
    gp: {kernal: matern52, noise_std_m: -1.0, mean: survey, survey_file: no_survey.csv}
    level_set: {level_m: deep}
    area: {polygon_m: [0.0, 0.0, 500.0, 500.0, 500.0, 0.0, 0.0, 500.0], origin_lat_deg: 47.6}
    plannr: {horizon: 3}
    planner: {method: genetic}
    tdma: {slot_s: 3.0}
    sim: {bathymetry: {file: no_ground.csv}}
/auv9/**:
  ros__parameters:
    vehicle: {depth_m: 4.0}
"""


def test_one_round_reports_every_mistake(tmp_path: Path) -> None:
    path = tmp_path / "ten.yaml"
    path.write_text(TEN_MISTAKES)
    texts = {level: "\n".join(found(path, level)) for level in ("error", "warning", "note")}
    beginnings = [
        "/**: gp.kernal: unknown parameter (value 'matern52'); did you mean 'kernel'?",
        "/**: gp.noise_std_m",
        "/**: level_set.level_m",
        "/**: plannr: unknown section; did you mean 'planner'?",
        "/**: planner.method",
        "area.polygon_m crosses itself: the edge from corner 1 (0, 0) to corner 2 (500, 500) meets the edge from "
        "corner 3 (500, 0) to corner 4 (0, 500). List the corners in order around the area",
        "area.origin_lat_deg, area.origin_lon_deg",
        "tdma.slot_s",
        "gp.survey_file",
        "sim.bathymetry.file",
    ]
    errors = [text.removeprefix(f"{path}: ") for text in found(path, "error")]
    assert [text[: len(begin)] for text, begin in zip(errors, beginnings, strict=True)] == beginnings
    assert "/auv9/**: there is no vehicle 9, because mission.vehicles is 2" in texts["warning"]
    assert "outside the operating area" not in texts["error"], "the default area is not the file's"
    assert "lanes" not in texts["note"]


@pytest.mark.parametrize(
    ("sections", "own", "words"),
    [
        ({"gp": {"x": 1}}, {"vehicle": {"start_north_m": 900.0}}, ["gp.x", "auv2: .* 900, 0 m is outside the op"]),
        ({"gp": {"x": 1}, "tdma": {"order": [1, 9]}}, None, ["gp.x", "tdma.order is .*9"]),
        ({"area": {"no_go": {"a": [1.0], "b": [2.0], "c": 3}}}, None, ["no_go.a ", "no_go.b ", "no_go.c "]),
        ({"tdma": {"order": [1, 7], "gurd_s": 3}}, None, ["tdma.gurd_s", "tdma.order is .*7"]),
        ({"motion": {"actions_deg": [1.0, 1.0]}}, {"vehicle": {"start_north_m": 900.0}}, ["actions", "auv2: .* 900"]),
        ({"packet": {"tag": True}}, None, ["packet.key_file", "packet.session"]),
        ({"packet": {"tag": True, "key_file": 3}}, None, ["packet.key_file", "packet.session"]),
        ({"gp": {"signal_std_m": "x", "min_depth_m": 9.0, "max_depth_m": 8.0}}, None, ["signal_std_m", "min_depth_m"]),
        ({"sim": {"dvl": {"rate_hz": 0, "dropout_min_s": 9.0}, "lake": {"level_m": 99.0}}}, None,
         ["dvl.rate_hz", "dvl.dropout_min_s is 9 s", "lake.terrace_m, level_m"]),
        ({"mission": {"vehicles": 0}}, {"modem": {"kind": "micromodem"}}, ["vehicles", r"\(auv2\): modem.port"]),
        ({"link": {"kind": "mavlink", "endpoint": "foo", "mode": "mission"}}, None, ["link.endpoint"]),
        ({"link": {"kind": "mavlink", "mode": "mission"}, "gp.x": 1}, None, ["gp.x", "link.mode"]),
        ({"gp.kernel.x": 1, "gp.kernel": "wendland_c2", "motion": {"actions_deg": []}}, None, ["gp.kern", "actions"]),
        ({}, {"mission": {"steps": 5}, "gp": {"x": 1}}, ["/auv2.*: mission is the same", "gp.x"]),
    ],
)  # fmt: skip
def test_one_mistake_hides_no_other(
    tmp_path: Path, sections: dict[str, Any], own: dict[str, Any] | None, words: list[str]
) -> None:
    errors = found(write(tmp_path, own=own, **sections), "error")
    assert len(errors) == len(words), errors
    for word in words:
        assert any(re.search(word, error) for error in errors), (word, errors)


def test_a_vehicle_that_climbs_in_time_needs_no_more_water(tmp_path: Path) -> None:
    vehicle = {"depth_m": 4.0, "min_altitude_m": 3.0, "min_water_m": 3.0}
    safety = {"min_altitude_m": 2.0, "altitude_response": "surface"}
    path = write(tmp_path, own={"vehicle": vehicle, "safety": safety}, level_set={"level_m": 5.5})
    assert not [text for text in found(path, "warning") if "auv2" in text and "water" in text]


def test_a_mission_is_compared_with_the_battery(tmp_path: Path) -> None:
    def mission(**vehicle: Any) -> Path:
        return write(tmp_path, vehicle={"recovery_north_m": 0.0, "recovery_east_m": 0.0, "at_end": "go_to", **vehicle})

    text = "auv1: the battery (100%) lasts for about {} of 100 legs and up to 851 m to the recovery position"
    assert any(row.startswith(text.format(82)) for row in found(mission(battery_km=3.5), "warning"))
    assert any(row.startswith(text.format(31)) for row in found(mission(battery_km=2.0), "error"))
    assert not [
        row for path in (mission(battery_km=9.0), mission()) for row in found(path, "warning") if "lasts" in row
    ]


def test_a_refused_value_causes_no_further_findings(tmp_path: Path) -> None:
    polygon = [0.0, 0.0, 500.0, 500.0, 500.0, 0.0, 0.0, 500.0]
    path = write(tmp_path, own={"vehicle": {"start_north_m": 9e3}}, area={"polygon_m": polygon})
    assert len(found(path, "error")) == 1, "no start can be outside of a polygon that is none"
    assert len(found(write(tmp_path, gp={"signal_std_m": "x", "noise_std_m": 1e-4}), "error")) == 1
    assert found(write(tmp_path, own={"vehicle": {"depth_m": "3"}}), "warning") == []


def test_files_are_those_of_the_checked_computer(tmp_path: Path) -> None:
    path = write(tmp_path, own={"gp": {"mean": "survey", "survey_file": "no_survey.csv"}})
    error = "auv2: gp.survey_file: 'no_survey.csv' does not exist on this machine"
    assert error in found(path, "error")
    assert error in found(path, "error", "auv2")
    assert error not in found(path, "error", "auv1")


def test_contradictory_values_are_an_error(tmp_path: Path) -> None:
    assert "packet.key_file is empty, but tag: true needs" in found(write(tmp_path, packet={"tag": True}), "error")[0]
    assert "tdma.slot_s: 3 s is too short; use at least" in found(write(tmp_path, tdma={"slot_s": 3.0}), "error")[0]


@pytest.mark.parametrize(
    ("sections", "own", "level", "words"),
    [
        ({}, {"vehicle": {"start_north_m": 900.0}}, "error", "auv2: .* 900, 0 m is outside the operating area"),
        (
            {"area": {"no_go": {"a": [990.0, 0.0, 991.0, 0.0, 990.0, 1.0], "b": [-60.0, 0.0, 0.0, 9.0, 0.0, 99.0]}}},
            None,
            "warning",
            "area.no_go.a lies outside the operating area and changes nothing",
        ),
        ({"level_set": {"level_m": -15.0}}, None, "error", "level_set.level_m must be a number from 0 to .* not -15"),
        (
            {},
            {"vehicle": {"start_north_m": -45.0}},
            "warning",
            r"auv2: .* m from the border, less than area.margin_m \(10 m\)",
        ),
        ({"area": {"polygon_m": [-20.0, -20.0, 30.0, -20.0, 30.0, 600.0, -20.0, 600.0]}}, None, "warning", "one lane"),
        (
            {"area": {"polygon_m": [-20.0, -20.0, 20.0, -20.0, 20.0, 600.0, -20.0, 600.0]}},
            None,
            "error",
            r"40 m wide, and area.margin_m \(10 m\) on both sides leaves 20 m.* circle takes 30 m. Choose a "
            "motion.turn_radius_m of at most 10 m,",
        ),
        (
            {"area": {"polygon_m": [-8.0, -20.0, 8.0, -20.0, 8.0, 600.0, -8.0, 600.0]}},
            None,
            "error",
            r"16 m wide, and area.margin_m \(10 m\) on both sides leaves nothing. Choose a smaller margin or a wider",
        ),
        (
            {},
            {"vehicle": {"at_end": "go_to", "recovery_north_m": 900.0, "recovery_east_m": 0.0}},
            "error",
            "auv2.*: vehicle.recovery_north_m, .* = 900, 0 m, the target of vehicle.at_end, is .* m outside",
        ),
        ({"planner": {"lane_spacing_m": 20.0}}, None, "warning", "use at least 30 m, twice motion.turn_radius_m"),
        ({}, {"vehicle": {"depth_m": 3.2}}, "warning", "auv1, auv2: .* 3 and 3.2 m are too close.* at least 0.5 m"),
        (
            {"level_set": {"level_m": 6.0}},
            None,
            "warning",
            r"auv1: .* = 6 m of water.*stay below level_set.level_m \(6 m\)",
        ),
        (
            {},
            {"safety": {"max_depth_m": 4.0}},
            "error",
            r"auv2: safety.max_depth_m 4 is not deeper than vehicle.depth_m 4, so that the response \(surface\)",
        ),
        ({}, {"safety": {"max_depth_m": 2.0, "depth_response": "warn"}}, "warning", "auv2: safety.max_depth_m 2 is"),
        (
            {"level_set": {"level_m": 2.5}},
            {"vehicle": {"depth_m": 0.0, "min_altitude_m": 1.5}},
            "warning",
            r"auv2: vehicle.depth_m 0 \+ vehicle.min_water_m 3 = 3 m of water are too much",
        ),
        (
            {},
            {"vehicle": {"depth_m": 11.5}},
            "warning",
            r"auv2: vehicle.depth_m 11.5 \+ vehicle.min_water_m 3 = 14.5 m of water are barely .* below 14 m$",
        ),
        (
            {},
            {"safety": {"min_altitude_m": 14.0}},
            "warning",
            r"auv2: 1 m, to which it climbs, \+ safety.min_altitude_m 14 ",
        ),
        (
            {},
            {"safety": {"min_altitude_m": 11.0, "altitude_response": "hold"}},
            "warning",
            r"auv2: vehicle.depth_m 4 \+ safety.min_altitude_m 11 = 15 m of water are too much",
        ),
        (
            {},
            {"vehicle": {"speed_mps": 3.1}},
            "warning",
            r"auv2 \(3.1 m/s\) is more than 2 times as fast as auv1, auv3",
        ),
        ({"tdma": {"order": [1, 2]}}, None, "warning", r"tdma.order: \[1, 2\] has no slot for auv3"),
        ({"tdma": {"order": [1, 2, 9]}}, None, "error", "9"),
        ({"tdma": {"max_range_m": 500.0}}, None, "warning", "shorter than the area.*use at least 922 m$"),
        (
            {"area": {"polygon_m": [0.0, 0.0, 20e3, 0.0, 20e3, 1e3, 0.0, 1e3]}},
            None,
            "warning",
            "tdma.max_range_m: 1500 m.* use at least 20025 m, and tdma.slot_s of at least 16.8 s",
        ),
        ({"planner": {"plan_expiry_s": 50.0}}, None, "warning", "use at least two cycles, 60 s"),
        ({"planner": {"replan_lead_s": 16.0}}, None, "warning", "is not less than the time of a leg, 15.7 s"),
        ({"planner": {"deadline_s": 4.0}}, None, "warning", r"is not less than planner.replan_lead_s \(4 s\)"),
        ({"planner": {"method": "plain", "horizon": 200}}, None, "note", "200 actions and 3 samples"),
        ({"planner": {"method": "lawnmower"}}, None, "note", "start, 1 action and 19 samples"),
        ({"mission": {"until": {"found": 1.0}}}, None, "error", "mission.until.found must be .*0.99, not 1.0"),
        ({"mission": {"until": {"found": 0.0}}}, None, "error", "mission.until.found must be .*, not 0.0"),
        (
            {"mission": {"until": {"undiscovered_m": -5.0}}},
            None,
            "error",
            "mission.until.undiscovered_m must be .*, not -5.0",
        ),
        ({"mission": {"until": {"deviation_m": 0.0}}}, None, "error", "mission.until.deviation_m must be .*, not 0.0"),
        ({"mission": {"until": {"deviation_m": 24.0}}}, None, "warning", "24 m has no effect.* within 19.6 m"),
        ({"mission": {"until": {"soon": 1.0}}}, None, "error", "soon"),
        (
            {"mission": {"until": {"found": 0.9, "undiscovered_m": 150.0}}},
            None,
            "note",
            r"ends earlier with 90 % found, at most 150 m undiscovered \(with 95 % probability\)",
        ),
        ({"mission": {"steps": 5}}, None, "warning", "The area is too large for this mission"),
        ({"sim": {"bathymetry": {"file": "/nowhere.csv"}}}, None, "error", "nowhere.csv"),
    ],
)
def test_each_mistake_is_reported(
    tmp_path: Path, sections: dict[str, Any], own: dict[str, Any] | None, level: str, words: str
) -> None:
    rows = found(write(tmp_path, own=own, **sections), level)
    assert any(re.search(words, row) for row in rows), rows


def test_the_expectations_of_the_papers_trial() -> None:
    notes = found(ROOT / "config" / "missions" / "trial_3_augmented.yaml", "note")
    assert any("3 x 10 s = a cycle of 30 s" in note for note in notes)
    assert any("3 actions and 19 samples" in note for note in notes)
    assert any("of 30 soundings in a cycle one in 2 is sent. Sent ones are 3 m apart" in note for note in notes)
    assert any("duration: 26 min 11 s without current. Each vehicle has 100 legs of 23.6 m" in note for note in notes)
    plan = Plan(step=0, heading_rad=0.0, north_m=0.0, east_m=0.0, actions=(5,) * 3, naive_path=0xF0)
    assert room_for_samples(plan) == 19


def test_the_machine_of_a_vehicle_is_checked(tmp_path: Path) -> None:
    port, key = tmp_path / "port", tmp_path / "key"
    port.write_text("")
    modem = {"kind": "micromodem", "port": str(port)}
    link = {"kind": "mavlink", "endpoint": "serial:///dev/no_such:57600", "key_file": str(tmp_path / "no_key")}
    path = write(tmp_path, modem=modem, link=link, packet={"tag": True, "key_file": str(key), "session": "a"}, sim={})
    errors = found(path, "error", "auv2")
    assert f"modem.port: {port} is not a serial device" in errors
    assert "link.endpoint: /dev/no_such does not exist on this machine" in errors
    assert any(error.startswith("packet.key_file: ") for error in errors)
    assert any(error.startswith("link.key_file: ") and "no_key" in error for error in errors)
    warnings = found(path, "warning", "auv2")
    assert any("has a section sim" in text for text in warnings)
    assert "record.folder is empty, so the dive is not recorded; set a folder" in warnings
    assert found(path, "error", "auv4") == [*found(path, "error"), "auv4 is not in the mission, which has 3 vehicles"]
    fast = write(
        tmp_path, modem={**modem, "port": "/dev/no_modem:115200"}, link={**link, "endpoint": "/dev/no_such:57600"}
    )
    assert {
        "modem.port: /dev/no_modem does not exist on this machine",
        "link.endpoint: /dev/no_such does not exist on this machine",
    } <= set(found(fast, "error", "auv2"))


def test_degrees_alone_need_the_origin_of_an_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "start.yaml"
    path.write_text("/**:\n  ros__parameters:\n    vehicle: {start_deg: [47.3, 8.5]}\n")
    origin = [f"area.origin_{name}_deg={value}" for name, value in (("lat", 47.3), ("lon", 8.5))]
    assert main([str(path), "--set", origin[0], "--set", origin[1]]) == 0
    assert "0 errors" in capsys.readouterr().out


def test_numbers_that_a_vehicle_must_have_are_an_error_for_a_vehicle_alone(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text("/**:\n  ros__parameters:\n    mission: {steps: 30}\n")
    text = "mission.vehicles is missing: a simulation takes 3, but auv_lse vehicle needs the number of vehicles there"
    assert text in found(path, "note")
    assert text in found(path, "error", "auv2")
    assert not any("mission.steps is missing" in line for line in found(path, "note"))


def test_exit_codes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    default = str(ROOT / "config" / "missions" / "default.yaml")
    assert main([default]) == 0
    assert "0 errors, 0 warnings" in capsys.readouterr().out
    doubtful = str(write(tmp_path, mission={"steps": 5}))
    assert (main([doubtful]), main([doubtful, "--strict"])) == (0, 1)
    assert main([default, str(write(tmp_path, gp={"x": 1}))]) == 1
    assert main([str(tmp_path / "none.yaml")]) == 2
    capsys.readouterr()


def test_a_vehicle_alone_needs_no_modem(tmp_path: Path) -> None:
    """As docs/guide/bluerov2.md writes its file."""
    for vehicles, is_warned in ((1, False), (2, True)):
        path = write(tmp_path, mission={"vehicles": vehicles, "steps": 60}, modem={"kind": "direct"})
        assert any("drives no modem" in text for text in found(path, "warning", "auv1")) == is_warned
    alone = write(tmp_path, mission={"vehicles": 1, "steps": 60})
    assert "auv2 is not in the mission, which has 1 vehicle" in found(alone, "error", "auv2")


@pytest.mark.parametrize("words", [[], ["--vehicle", "auv2"], ["--strict"], ["--set", "mission.seed=2"]])
def test_without_a_file_the_default_mission_is_checked(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    main(words)
    assert capsys.readouterr().out.splitlines()[0] == str(shipped_file("missions/default.yaml"))


@pytest.mark.parametrize(
    ("name", "text", "option"),
    [("mission.schema.json", schema_text, "--schema"), ("missions/template.yaml", template_text, "--template")],
)
def test_what_is_made_from_the_declarations_is_current(name: str, text: Any, option: str) -> None:
    path = ROOT / "config" / name
    assert path.read_text() == text(), f"a parameter has changed: auv_lse check {option} > config/{name}"


def test_the_template_has_every_parameter_with_its_default(tmp_path: Path) -> None:
    lines = template_text().splitlines()
    whole = [" " + line[1:] if re.match(r"# {2,}\w+:", line) else line for line in lines]
    path = tmp_path / "whole.yaml"
    path.write_text("\n".join(whole))
    values = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    for name, cls in SECTIONS.items():
        for parameter, *_ in describe(cls, ""):
            part = values[name]
            for key in parameter.split("."):
                assert key in part, f"{name}.{parameter}"
                part = part[key]
    assert Settings.load(path).to_patterns() == Settings.load(None, {"vehicle.depth_m": 3.0}).to_patterns()


def accepts(rule: dict[str, Any], value: Any, root: dict[str, Any]) -> bool:
    """Whether a schema accepts a value; the words of JSON schema that ours uses."""
    if "$ref" in rule:
        rule = root["definitions"][rule["$ref"].rsplit("/", 1)[1]]
    kinds: dict[str, Any] = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int}
    kinds |= {"number": (int, float), "null": type(None)}
    wanted = rule.get("type", [])
    wanted = [wanted] if isinstance(wanted, str) else wanted
    if wanted and not any(isinstance(value, kinds[k]) and (k == "boolean" or value is not True) for k in wanted):
        return False
    if isinstance(value, dict):
        known, patterns = rule.get("properties", {}), rule.get("patternProperties", {})
        others = rule.get("additionalProperties", True)
        for key, content in value.items():
            rules = [known[key]] if key in known else [r for p, r in patterns.items() if re.search(p, key)]
            rules = rules or ([others] if isinstance(others, dict) else [])
            if (not rules and others is False) or not all(accepts(r, content, root) for r in rules):
                return False
        return all(key in value for key in rule.get("required", []))
    if isinstance(value, list):
        return all(accepts(rule["items"], v, root) for v in value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            value >= rule.get("minimum", value)
            and value <= rule.get("maximum", value)
            and ("exclusiveMinimum" not in rule or value > rule["exclusiveMinimum"])
        )
    return value in rule.get("enum", [value])


def test_the_schema_accepts_what_the_loader_accepts_and_refuses_what_it_refuses(tmp_path: Path) -> None:
    root = json.loads(schema_text())
    for path in MISSIONS:
        assert accepts(root, yaml.safe_load(path.read_text()), root), path
    complete = yaml.safe_load(Settings.load(None).to_parameter_file())
    assert accepts(root, complete, root)
    for section in (
        {"gp": {"kernal": "matern52"}},
        {"gp": {"kernel": "rbf"}},
        {"gp": {"noise_std_m": 0.0}},
        {"mission": {"steps": 2.5}},
        {"mission": {"vehicles": 21}},
        {"sim": {"channel": {"packet_loss": 1.5}}},
        {"planner": {"naive_paths": [1]}},
        {"plannr": {}},
    ):
        assert not accepts(root, {"/**": {"ros__parameters": section}}, root), section
        assert found(write(tmp_path, **section), "error")
    assert not accepts(root, {"/auv1/**": {"ros__parameters": {"mission": {"steps": 5}}}}, root), "for all alike"
    assert schema() == root


def test_the_recordings_size_is_estimated_and_the_vehicles_disk_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text("/**:\n  ros__parameters:\n    record: {folder: bag}\n")
    monkeypatch.setattr("auv_lse_shore.check.machine.free_mb", lambda folder: 202.0)
    assert ("note", "recording: about 3 MB on each vehicle, 8 MB of a simulated mission") in check(path).rows
    assert not any("record.folder" in text for _, text in check(path).rows), "another machine's disk"
    assert any(
        level == "error" and text.startswith("record.folder has 2 MB of free space beyond")
        for level, text in check(path, "auv1").rows
    )


def test_the_goals_method_is_reported_beside_an_error_elsewhere(tmp_path, capsys):
    assert main([str(write(tmp_path, mission={"goal": "line"}, tdma={"slot_s": -1.0}))]) == 1
    assert "mission.goal: line flies the method line" in capsys.readouterr().out
    given = write(tmp_path, mission={"goal": "line"}, tdma={"slot_s": -1.0}, planner={"method": "plain"})
    assert main([str(given)]) == 1
    assert "because planner.method is set (plain)" in capsys.readouterr().out


def test_vehicles_at_close_depths_are_one_warning_for_each_depth(tmp_path: Path) -> None:
    rows = found(write(tmp_path, mission={"vehicles": 8}, vehicle={"depth_m": 5.0}), "warning")
    close = [row for row in rows if "too close" in row]
    assert len(close) == 1
    assert "auv1, auv2, auv3, auv4, auv5, auv6, auv7, auv8: vehicle.depth_m: 5 m each is too close" in close[0]
    rows = found(write(tmp_path, mission={"vehicles": 5}), "warning")  # by default 3, 4 and 5 m in turn
    assert [row.partition(", because")[0] for row in rows if "too close" in row] == [
        "auv1, auv4: vehicle.depth_m: 3 m each is too close",
        "auv2, auv5: vehicle.depth_m: 4 m each is too close",
    ]
    assert not any("too close" in row for row in found(write(tmp_path, mission={"vehicles": 3}), "warning"))


def test_what_to_expect_of_a_mission_over_a_bathymetry_is_reported_once(tmp_path: Path) -> None:
    at = np.arange(0.0, 601.0, 10.0)
    np.savez(tmp_path / "a.npz", north_m=at, east_m=at, depth_m=np.broadcast_to(10.0 + 0.02 * at, (61, 61)))
    sim = {"bathymetry": {"file": str(tmp_path / "a.npz")}, "current": {"north_mps": 2.9}}
    area = {"polygon_m": [0.0, 0.0, 500.0, 0.0, 500.0, 600.0, 0.0, 600.0]}
    rows = found(write(tmp_path, sim=sim, area=area, vehicle={"speed_mps": 2.8}), "warning")
    for words in ("motion.turn_radius_m: 15 m is too small", "sim.current: 2.9 m/s is too fast for"):
        assert len([row for row in rows if row.startswith(words)]) == 1, rows


def test_tagged_packets_of_a_fast_mate_are_accepted(tmp_path: Path) -> None:
    packet = {"tag": True, "key_file": str(tmp_path / "key")}
    rows = found(write(tmp_path, own={"vehicle": {"speed_mps": 3.1}}, packet=packet), "warning")
    assert not any("times as fast" in row for row in rows)


def test_the_bathymetry_and_parameters_of_a_mission_are_checked_as_it_flies_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_survey(tmp_path)
    path, ground = write(tmp_path, mission={"steps": 40}), tmp_path / SURVEY_FILES[0]
    options = [str(path), "--bathymetry", str(ground), "--set", "mission.steps=70", "--set", "auv2.vehicle.depth_m=4"]
    flown, notes = prepare(mission_options.parser().parse_args(options))
    main(options)
    said = capsys.readouterr().out
    assert "70 legs each" in said
    assert f"{flown.mission.vehicles} vehicles" in said
    for note in notes:
        assert note in said
    main([str(path)])
    assert "40 legs each" in capsys.readouterr().out


def test_without_a_mission_file_the_default_one_is_checked_with_the_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_survey(tmp_path)
    main(["--bathymetry", str(tmp_path / SURVEY_FILES[0])])
    assert SURVEY_FILES[0] in capsys.readouterr().out
    assert main(["--set", "mission.steps=70"]) == 0
    assert "70 legs each" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["--set", "planner.iterationz=3"], 2, "--set planner.iterationz=3: planner.iterationz: unknown parameter"),
        (["--set", "auv9.vehicle.depth_m=4"], 2, "--set auv9.vehicle.depth_m: the mission has no auv9"),
        (["--depths"], 2, "--depths is for a bathymetry, and there is none"),
        (["--set", "area.file=nowhere.kml"], 2, "nowhere.kml: cannot be read"),
        (["--bathymetry", "nowhere.csv"], 1, "nowhere.csv' does not exist on this machine"),
        (["--set", "area.margin_m=400"], 1, "leaves nothing. Choose a smaller margin"),
    ],
)
def test_options_of_a_mission_that_are_impossible_are_named(
    capsys: pytest.CaptureFixture[str], words: list[str], code: int, error: str
) -> None:
    assert main(words) == code
    said = capsys.readouterr()
    assert error in said.out + said.err


def test_a_parameter_on_the_command_line_replaces_a_vehicles_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, own={"vehicle": {"depth_m": 9.0}})
    main([str(path), "--set", "vehicle.depth_m=4"])
    assert "auv1, auv2, auv3: vehicle.depth_m: 4 m each is too close" in capsys.readouterr().out
    main([str(path), "--set", "vehicle.depth_m=4", "--set", "auv2.vehicle.depth_m=8"])
    assert "auv1, auv3: vehicle.depth_m: 4 m each is too close" in capsys.readouterr().out
    wrong = write(tmp_path, mission={"steps": 2.5}, own={"vehicle": {"depth_m": -9.0}})
    assert main([str(wrong), "--set", "mission.steps=70"]) == 1
    assert "vehicle.depth_m must be" in (said := capsys.readouterr().out)
    assert "mission.steps must be" not in said
    assert main([str(wrong), "--set", "mission.steps=70", "--set", "auv2.vehicle.depth_m=4"]) == 0
    assert "70 legs each" in capsys.readouterr().out
