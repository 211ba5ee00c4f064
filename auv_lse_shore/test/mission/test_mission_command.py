"""The command line of auv_lse mission, without flying: the vehicles' file, and how it says what is wrong."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from verb_main import verb_main

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_run.process import fork_server
from auv_lse_run.process.domain import node_environment
from auv_lse_shore.check.command import check
from auv_lse_shore.mission import mission, sim
from auv_lse_shore.mission.vehicle_file import vehicle_file
from auv_lse_shore.mission_options import overrides_of, parser
from auv_lse_sim.engine.hardware import hardware_of
from auv_lse_sim.ground import ground_source
from auv_lse_sim.ground.ground_source import GROUND_VARIABLE

main = verb_main("mission")

pytestmark = pytest.mark.ros

PORT = ("--set", "modem.port=/dev/ttyUSB0")


def test_a_folder_that_no_port_can_lie_in_is_refused_by_name() -> None:
    with pytest.raises(ParameterError, match=r"folder /runs/10:30 has a colon in its name, .* another --out"):
        hardware_of("emulated", "direct", Settings.load(), Path("/runs/10:30"))


def test_a_link_that_is_down_for_a_while_finds_its_port_free() -> None:
    wanted = hardware_of("direct", "mavlink", Settings.load(), Path("/nowhere"))
    ports = [int(wanted[f"auv{k}.link.endpoint"].rsplit(":", 1)[1]) for k in (1, 2, 3)]
    assert len(set(ports)) == 3
    assert min(ports) > 60999, "no socket of another process gets it by chance while the node is started again"


def test_emulated_modems_are_synchronous_unless_a_vehicle_pings(tmp_path: Path) -> None:
    file, folder = tmp_path / "mission.yaml", tmp_path / "run"
    file.write_text("/auv2/**:\n  ros__parameters: {modem: {ping: true}}\n")
    for words, pings, synchronous in (
        ([], False, True),
        ([str(file)], True, False),
        (["--set", "auv2.modem.ping=true"], True, False),
        (["--set", "modem.synchronous=false"], False, False),
        (["--set", "auv2.modem.synchronous=false"], False, False),
    ):
        options = parser().parse_args([*words, "--modem", "emulated"])
        settings = mission.prepare(options)[0]
        folder.mkdir(exist_ok=True)
        modem = mission.write_mission(settings, folder, options).vehicle(2).modem
        assert (modem.ping, modem.synchronous) == (pings, synchronous), words


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--for-vehicles", "x.yaml", *PORT, "--out", "run", "--live"], "flies nothing; leave out --out, --live"),
        (["--for-vehicles", "x.yaml", *PORT, "--real-time-factor", "2"], "leave out --real-time-factor"),
        (["--set", "record.folder=bag"], "records in its run folder; choose that with --out"),
    ],
)
def test_what_would_be_ignored_is_refused(tmp_path, monkeypatch, capsys, words, error):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert error in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_vehicle_without_a_slot_is_named_before_the_start() -> None:
    _, notes = mission.prepare(parser().parse_args(["--set", "tdma.order=[1, 3]"]))
    assert "tdma.order: [1, 3] has no slot for auv2, which therefore never sends" in notes


def test_on_a_clock_an_emulated_modem_has_the_slots_of_a_real_one(tmp_path: Path) -> None:
    def duration_s(*words: str) -> float:
        options = parser().parse_args([*words, "--modem", "emulated"])
        return mission.write_mission(mission.prepare(options)[0], tmp_path, options).tdma.send_duration_s

    assert duration_s() == 2.2, "in lockstep it begins at once"
    assert duration_s("--real-time-factor", "10") == 4.0
    assert duration_s("--real-time-factor", "10", "--set", "tdma.send_duration_s=4.5") == 4.5
    with pytest.raises(ParameterError, match=r"tdma\.send_duration_s: 3 s is too short.* use at least 4\.00 s"):
        duration_s("--real-time-factor", "10", "--set", "tdma.send_duration_s=3")


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ((), r"area\.raster_m: 2\.0 m needs .* at least 4\.5 m"),
        (("area.raster_m=20",), r"gp\.map_resolution_m: cells of 5\.0 m .* at least 20 m"),
        (
            ("area.raster_m=20", "gp.map_resolution_m=20", "planner.map_spacing_m=5"),
            r"planner\.map_spacing_m: cells of",
        ),
        (("area.raster_m=20", "gp.map_resolution_m=20"), ""),
    ],
)
def test_an_area_of_20_km_names_each_parameter_that_is_too_fine_before_the_start(tmp_path, given, named):
    axis = np.arange(-10_000.0, 10_001.0, 100.0)
    np.savez(tmp_path / "big.npz", north_m=axis, east_m=axis, depth_m=20.0 + axis[:, None] / 2000.0 + 0.0 * axis)
    area = ["--area", "-10000", "-10000", "10000", "10000", "--bathymetry", str(tmp_path / "big.npz")]
    options = parser().parse_args([*area, *(word for text in given for word in ("--set", text))])
    if named:
        with pytest.raises(ParameterError, match=named):
            mission.prepare(options)
    else:
        mission.prepare(options)


def test_a_survey_file_that_is_missing_is_named_before_the_start(tmp_path):
    given = ["--set", "gp.mean=survey", "--set", f"gp.survey_file={tmp_path / 'no.csv'}"]
    with pytest.raises(ParameterError, match=r"gp\.survey_file: '.*no\.csv' does not exist on this machine"):
        mission.prepare(parser().parse_args(given))


def test_a_survey_whose_metres_count_from_another_origin_is_refused_before_the_start(tmp_path):
    north, east = (axis.ravel() for axis in np.meshgrid([0.0, 50.0, 100.0], [0.0, 50.0, 100.0]))
    lat, lon = geodetic_from_local(north, east, 46.5, 6.6)
    rows = np.column_stack([north, east, 12.0 + north / 50.0, lat, lon])
    np.savetxt(tmp_path / "a.csv", rows, "%.8f", ",", header="north_m,east_m,depth_m,lat,lon", comments="")
    survey = ["--set", "gp.mean=survey", "--set", f"gp.survey_file={tmp_path / 'a.csv'}"]
    for lat_deg, message in (
        (46.501, r"a\.csv' are relative to 46\.500000, 6\.600000 deg, 111 m from the mission's"),
        (46.5, ""),
    ):
        origin = ["--set", f"area.origin_lat_deg={lat_deg}", "--set", "area.origin_lon_deg=6.6"]
        options = parser().parse_args([*survey, *origin])
        if message:
            with pytest.raises(ParameterError, match=message):
                mission.prepare(options)
        else:
            mission.prepare(options)
    path = tmp_path / "mission.yaml"
    path.write_text(
        f"/**:\n  ros__parameters:\n    gp: {{mean: survey, survey_file: {tmp_path / 'a.csv'}}}\n"
        "    area: {origin_lat_deg: 46.501, origin_lon_deg: 6.6}\n"
    )
    assert any("111 m from the mission's" in text for kind, text in check(path).rows if kind == "error")


def test_mission_files_appear_whole_because_vehicles_are_started_as_soon_as_they_exist(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options, folder = sim.parser().parse_args(["--apart", "--vehicles", "2"]), tmp_path / "run"
    folder.mkdir()
    settings, in_place, write_text = mission.prepare(options)[0], list[str](), Path.write_text

    def noted(path: Path, text: str, **options: Any) -> int:
        in_place.append(path.name)
        return write_text(path, text, **options)

    monkeypatch.setattr(Path, "write_text", noted)
    sim._written(settings, folder, options)
    names = {path.name for path in folder.iterdir()}
    assert {"mission.yaml", "vehicles.yaml"} <= names
    assert not names & set(in_place)


def test_a_rehearsal_of_separate_vehicles_leaves_its_state_in_its_own_folder(tmp_path: Path) -> None:
    """Its simulated water is gone then: a dive that it left there would make the next one hold, a real one too."""
    settings = mission.prepare(sim.parser().parse_args(["--apart", "--vehicles", "2"]))[0]
    for chosen, expected in (("", str(tmp_path / "state_copies")), ("/media/card", "/media/card")):
        sim._apart(settings.with_overrides({"safety.state_copies": chosen}), tmp_path)
        own = parameters_for(read_parameter_file(tmp_path / "vehicles.yaml"), "/auv2/safety_node")
        assert own["safety"]["state_copies"] == expected


def run_file(folder: Path, modem: str = "direct", link: str = "direct") -> Path:
    """The mission.yaml that a simulated run leaves."""
    settings = Settings.load(None, {"mission.steps": 40, "auv2.vehicle.depth_m": 6.5, "gp.noise_std_m": 0.25})
    settings = settings.with_overrides({"record.folder": str(folder / "bag")})
    settings = settings.with_overrides(hardware_of(modem, link, settings, folder))
    path = folder / "mission.yaml"
    path.write_text(settings.to_parameter_file())
    return path


def test_the_vehicles_file_of_a_run_lets_nodes_run_without_a_simulator(tmp_path: Path) -> None:
    out = tmp_path / "vehicles.yaml"
    assert main([str(run_file(tmp_path)), "--for-vehicles", str(out), *PORT]) == 0
    for k in (1, 2, 3):
        own = parameters_for(read_parameter_file(out), f"/auv{k}/planner_node")
        assert "sim" not in own
        assert own["record"]["folder"] == "bag"
        assert (own["modem"]["kind"], own["modem"]["port"]) == ("micromodem", "/dev/ttyUSB0")
        assert (own["link"]["kind"], own["link"]["endpoint"]) == ("mavlink", "udpin://127.0.0.1:14550")
        assert own["link"]["soundings"] is True
        assert own["vehicle"]["depth_m"] == (3.0, 6.5, 5.0)[k - 1]
    again = Settings.load(out)
    common = again.common.vehicle.start, again.common.modem.kind, again.common.link.kind
    assert common == ("on_call", "micromodem", "mavlink"), "of a vehicle that is added by hand, too"
    assert (again.mission.steps, again.common.gp.noise_std_m) == (40, 0.25)
    assert str(tmp_path / "bag") not in out.read_text()
    before = out.read_text()
    assert main([str(run_file(tmp_path)), "--for-vehicles", str(out), *PORT]) == 2, "it exists"
    assert out.read_text() == before
    assert {p.name for p in tmp_path.iterdir()} == {"mission.yaml", "vehicles.yaml"}, "nothing was flown"


def test_hardware_chosen_by_the_user_stays_in_the_vehicles_file(tmp_path: Path) -> None:
    out = tmp_path / "vehicles.yaml"
    chosen = ["--set", "modem.kind=direct", "--set", "auv2.link.kind=direct", "--set", "vehicle.start=at_once"]
    assert main([str(run_file(tmp_path)), "--for-vehicles", str(out), *chosen]) == 0
    own = Settings.load(out).vehicles
    assert [(v.modem.kind, v.link.kind, v.vehicle.start) for v in own] == [
        ("direct", kind, "at_once") for kind in ("mavlink", "direct", "mavlink")
    ]
    assert Settings.load(out).common.link.kind == "mavlink"


def test_a_vehicles_file_with_errors_is_not_written(tmp_path: Path, capsys) -> None:
    words = [str(run_file(tmp_path)), "--for-vehicles", str(tmp_path / "vehicles.yaml"), *PORT]
    words += ["--set", "auv2.vehicle.start_north_m=-300", "--set", "vehicle.at_end=go_to"]
    words += ["--set", "vehicle.recovery_north_m=50", "--set", "vehicle.recovery_east_m=50"]
    words += ["--set", "auv3.vehicle.recovery_north_m=9000"]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert f"--for-vehicles {tmp_path / 'vehicles.yaml'} is not written, because" in said
    assert "auv2: vehicle.start_north_m, start_east_m = -300" in said
    assert "(auv3): vehicle.recovery_north_m, recovery_east_m = 9000" in said, "all errors at once"
    assert {p.name for p in tmp_path.iterdir()} == {"mission.yaml"}


def test_the_vehicles_file_comes_without_warnings_about_the_simulator(tmp_path: Path, capsys) -> None:
    axis = np.arange(0.0, 400.0, 10.0)
    np.savez(tmp_path / "deep.npz", north_m=axis, east_m=axis, depth_m=np.full((40, 40), 80.0) + 0.1 * axis)
    words = ["--bathymetry", str(tmp_path / "deep.npz"), "--for-vehicles", str(tmp_path / "v.yaml")]
    words += ["--set", "sim.current.north_mps=3", "--set", "vehicle.speed_mps=3", "--set", "link.kind=direct", *PORT]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "coverage: " in said
    assert "sim." not in said


def test_the_area_asked_for_is_not_fitted_to_the_synthetic_lake(tmp_path: Path) -> None:
    path, out = tmp_path / "mission.yaml", tmp_path / "vehicles.yaml"
    corners = [0.0, 0.0, 900.0, 0.0, 900.0, 900.0, 0.0, 900.0]
    path.write_text(f"/**:\n  ros__parameters:\n    area: {{polygon_m: {corners}}}\n")
    assert main([str(path), "--for-vehicles", str(out), *PORT]) == 0
    assert list(Settings.load(out).area.polygon_m) == corners


def test_hardware_that_vehicles_do_not_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"auv1: modem\.port is missing. Give a serial device"):
        vehicle_file(Settings.load(run_file(tmp_path)))
    for modem, link in (("emulated", "direct"), ("direct", "mavlink")):
        with pytest.raises(ParameterError, match="of a run's emulated hardware"):
            vehicle_file(Settings.load(run_file(tmp_path, modem, link), {"modem.port": "/dev/ttyUSB0"}))
    by_hand = tmp_path / "by_hand.yaml"
    link = {"kind": "mavlink", "endpoint": "serial:///dev/ttyS1:57600", "soundings": False}
    modem = {"kind": "micromodem", "port": "tcp://10.0.0.2:4000"}
    by_hand.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"modem": modem, "link": link}}}))
    out = tmp_path / "vehicles.yaml"
    out.write_text(vehicle_file(Settings.load(by_hand)))
    own = Settings.load(out).vehicle(2)
    assert (own.modem.port, own.link.endpoint, own.link.soundings) == (modem["port"], link["endpoint"], False)
    assert vehicle_file(Settings.load(out)).splitlines()[3:] == out.read_text().splitlines()[3:], "of its own, too"


@pytest.mark.parametrize(
    ("hardware", "words", "cure"),
    [
        (("emulated", "direct"), [], r"modem\.kind is 'micromodem', .* --modem emulated\. .* --set modem\.kind=direct"),
        (("direct", "mavlink"), ["--modem", "emulated"], r"link\.kind is 'mavlink', .* --vehicle-link mavlink"),
    ],
)
def test_drivers_that_no_option_starts_are_named_before_the_start(tmp_path, monkeypatch, capsys, hardware, words, cure):
    """The nodes waited two minutes for them: "discovery timed out"."""
    monkeypatch.setattr(mission, "fly", lambda *_, **__: 0)
    out = tmp_path / "run"
    assert main([str(run_file(tmp_path, *hardware)), *words, "--out", str(out)]) == 2
    assert re.match(f"error: auv1: {cure}", capsys.readouterr().err)
    assert not out.exists()


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("planner.iterations=[1", "error: --set planner.iterations: '[1': not valid YAML: line 1, column 3: "),
        (
            "planner.iterations=0100",
            "error: --set planner.iterations: '0100': not valid YAML: line 1, column 1: YAML reads",
        ),
        ("planner.[/x]=1", "planner.[/x]: unknown parameter"),
        ("planner.iterations", "is not NAME=VALUE"),
        (
            "planner.iteratons=5",
            "error: --set planner.iteratons=5: planner.iteratons: unknown parameter (value 5); did you mean",
        ),
        ("auv2.planner.horizon=0", "error: --set auv2.planner.horizon=0: planner.horizon must be a whole"),
        ("planer.horizon=3", "error: --set planer.horizon=3: planer: unknown section; did you mean 'planner'?"),
        ("planner.method=best", "error: --set planner.method=best: planner.method must be one of 'tour'"),
    ],
)
def test_a_wrong_set_is_named(
    argument: str, words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert main(["--set", argument, "--out", str(tmp_path / "run")]) == 2
    assert words in capsys.readouterr().err
    assert fork_server._early is None, "a mission that is refused leaves no process"


@pytest.mark.parametrize(("factor", "words"), [("0", "must be more than 0; without it"), ("-1", "not -1.0")])
def test_a_pace_that_cannot_be_is_refused(
    factor: str, words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """0 was taken and flown at once real time, where the parameter says that it is as fast as it goes."""
    monkeypatch.setenv("COLUMNS", "300")
    assert main(["--real-time-factor", factor]) == 2
    assert "error: --real-time-factor" in (said := capsys.readouterr().err)
    assert words in said


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--steps", "3", "--set", "mission.steps=4"], "mission.steps: the command line sets it to 3 and 4"),
        (["--real-time-factor", "9", "--set", "sim.lockstep=true"], "sim.lockstep: the command line sets it to False"),
    ],
)
def test_two_values_of_one_parameter_are_refused(words: list[str], named: str) -> None:
    """The value of --set was flown, and the other option ignored."""
    with pytest.raises(ParameterError, match=named):
        overrides_of(parser().parse_args(words))
    assert overrides_of(parser().parse_args(["--steps", "4", "--set", "mission.steps=4"])) == {"mission.steps": 4}


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--real-time-factor", "5"], "--apart runs in real time; leave out --real-time-factor 5"),
        (["--modem", "direct"], "--apart needs emulated modems; leave out --modem direct"),
        (["--vehicle-link", "direct"], "--apart needs simulated autopilots; leave out --vehicle-link direct"),
    ],
)
def test_separate_vehicles_refuse_options_that_they_would_ignore(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], error: str
) -> None:
    assert sim.run(sim.parser().parse_args(["--apart", *words, "--out", str(tmp_path / "run")])) == 2
    assert f"error: {error}" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_the_help_names_the_methods_that_there_are() -> None:
    listed = parser().format_help().split("planning method: ")[1].split(" (docs/design/planner.md)")[0]
    assert "".join(listed.split()).split(",") == list(METHODS)


def test_a_nodes_last_words_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    words = "[ERROR] [1.5] [auv1.gp_node]: [/x] [red]"
    mission.complain(words)
    mission._say(Console(width=200), words)
    assert capsys.readouterr() == (f"{words}\n", f"error: {words}\n")


def test_a_disk_without_room_for_the_recording_refuses_the_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(mission, "free_mb", lambda folder: 205.0)
    assert main(["--out", str(tmp_path / "run")]) == 2
    assert "record.folder has 5 MB of free space beyond record.least_free_mb (200 MB)" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_the_nodes_of_a_mission_find_the_ground_that_the_command_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ground_source, "_last", None)
    found: list[Path] = []

    def fly(*_: object, **__: object) -> int:
        found.append(Path(node_environment(3)[GROUND_VARIABLE]))
        assert found[0].stat().st_size > 1000
        return 0

    monkeypatch.setattr(mission, "fly", fly)
    assert main(["--out", str(tmp_path / "run")]) == 0
    assert not found[0].exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--depths"], {"sim.bathymetry.depth_sign": "down"}),
        (
            ["--elevations", "--water-level", "372"],
            {"sim.bathymetry.depth_sign": "up", "sim.bathymetry.water_level_m": 372.0},
        ),
    ],
)
def test_flags_say_what_the_bathymetry_holds(words: list[str], expected: dict[str, object]) -> None:
    assert overrides_of(parser().parse_args(words)) == expected


def test_a_parameter_of_a_vehicle_that_the_mission_lacks_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--set", "auv4.vehicle.depth_m=4", "--for-vehicles", str(tmp_path / "v.yaml"), *PORT]
    assert main(words) == 2
    assert "--set auv4.vehicle.depth_m: the mission has no auv4; its vehicles are auv1 to auv3" in (
        capsys.readouterr().err
    )
    assert main([*words, "--vehicles", "4"]) == 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--set", "tdma.slot_s=3"), r"^the command line: tdma\.slot_s: 3 s is too short"),
        (("--set", "gp.mean=survey"), r"^the command line \(auv1\): gp\.survey_file is empty"),
        (("--set", "motion.actions_deg=[0.0]"), r"^the command line: motion\.actions_deg: \[0\.0\] has no turn"),
    ],
)
def test_a_contradiction_that_the_command_line_makes_is_not_blamed_on_the_file(given, words):
    with pytest.raises(ParameterError, match=words):
        mission.prepare(parser().parse_args(given))


@pytest.mark.parametrize("given", [(), ("--set", "mission.steps=20")])
def test_a_contradiction_in_the_file_names_the_file(tmp_path, given):
    path = tmp_path / "short.yaml"
    path.write_text("/**:\n  ros__parameters:\n    tdma: {slot_s: 3.0}\n")
    with pytest.raises(ParameterError, match=r"short\.yaml: tdma\.slot_s: 3 s is too short"):
        mission.prepare(parser().parse_args([str(path), *given]))
    assert mission.prepare(parser().parse_args([str(path), "--set", "tdma.slot_s=5"]))


@pytest.mark.parametrize(("speed", "named"), [("0.5", True), ("1.0", False)])
def test_speeds_too_far_apart_are_reported_before_the_start(speed, named):
    notes = mission.prepare(parser().parse_args(["--set", f"auv1.vehicle.speed_mps={speed}"]))[1]
    assert any("times as fast as auv1 (0.5 m/s)" in note for note in notes) == named
