"""`auv_lse faults`: a row for each kind, also for one that breaks; the day's schedule, and what counts as lost."""

import contextlib
import math
import os
import shutil
import signal
import subprocess
import sys
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node import state_memory
from auv_lse_common.node.journal import Journal
from auv_lse_common.node.state_file import StateFile
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_comms.packet.fields import PACKET_BYTES
from auv_lse_comms.packet.tag import Tagger
from auv_lse_comms.tdma import Tdma
from benchmarks.faults import __main__ as faults
from benchmarks.faults import day, files, water
from benchmarks.faults.bed.dive_bed import DiveBed, Vehicle
from benchmarks.faults.bed.ledger import Ledger, journal_problem, lost_positions
from benchmarks.faults.report import Report

main = verb_main("faults")


def kind(outcome, *, small=("--size", "2")):
    """A module of a kind of faults whose run returns or raises `outcome`."""
    made = SimpleNamespace(seen=[], arguments=lambda parser: parser.add_argument("--size", type=int, default=99))

    def run(options, folder, say):
        made.seen.append((options.size, options.seed, folder.name))
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    made.run = run
    if small is not None:
        made.SMALL = small
    return made


@pytest.fixture
def kinds(monkeypatch):
    def set_kinds(**modules):
        monkeypatch.setattr(faults, "KINDS", dict.fromkeys(modules, "a kind"))
        monkeypatch.setattr(faults, "_kind", modules.__getitem__)

    return set_kinds


def test_all_runs_every_small_kind_and_prints_one_table(kinds, capsys):
    disk, soak = kind(Report(["a line"], tried=20, survived=20, worst_recovery_s=1.5)), kind(None, small=None)
    kinds(disk=disk, soak=soak, kills=kind(Report([], tried=5, survived=5)))
    assert main(["all", "--seed", "7"]) == 0
    out = capsys.readouterr().out
    assert disk.seen == [(2, 7, "disk")]
    assert soak.seen == []
    assert "a line" in out
    assert "soak" not in out
    assert "| disk | 20 | 20 | 1.5 s | nothing |" in out
    assert "| all | 25 | 25 | 1.5 s | nothing |" in out


def test_a_kind_that_breaks_is_a_row_and_the_others_still_run(kinds, capsys):
    kinds(disk=kind(RuntimeError("no tmpfs")), kills=kind(Report([], tried=5, survived=4, lost=["a slot"])))
    assert main(["all"]) == 1
    out = capsys.readouterr().out
    assert "| disk | 1 | 0 | - | RuntimeError: no tmpfs |" in out
    assert "| kills | 5 | 4 | - | a slot |" in out
    assert "| all | 6 | 4 | - | 2 |" in out


def test_ctrl_c_prints_what_there_is(kinds, capsys):
    last = kind(Report([], tried=1, survived=1))
    kinds(disk=kind(Report([], tried=20, survived=20)), kills=kind(KeyboardInterrupt()), water=last)
    assert main(["all"]) == 130
    out = capsys.readouterr().out
    assert "| disk | 20 | 20 | - | nothing |" in out
    assert "| kills | 0 | 0 | - | interrupted |" in out
    assert last.seen == []


@pytest.mark.parametrize(
    ("error", "kept"),
    [(ValueError(), True), (KeyError("a bug"), True), (AssertionError(), True), (KeyboardInterrupt(), False)],
)
def test_logs_are_kept_after_any_error_and_not_after_ctrl_c(kinds, capsys, tmp_path, monkeypatch, error, kept):
    def run(options, folder, say):
        folder.mkdir()
        raise error

    monkeypatch.setattr(faults.tempfile, "tempdir", str(tmp_path))
    kinds(disk=SimpleNamespace(arguments=lambda parser: None, run=run))
    with contextlib.suppress(KeyError, AssertionError):
        main(["disk"])
    assert [path.name for path in tmp_path.glob("*/*")] == ["faults"] * kept
    assert ("logs, journals and recordings are kept in" in capsys.readouterr().err) == kept


def test_an_output_folder_that_exists_is_a_wrong_command_line(kinds, capsys, tmp_path):
    never = kind(Report([], tried=1, survived=1))
    kinds(disk=never)
    assert main(["disk", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: --out {tmp_path} exists already; choose a new folder\n"
    assert never.seen == []
    (tmp_path / "file").touch()
    assert main(["disk", "--out", str(tmp_path / "file" / "new")]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'file'}: is not a folder; choose another name\n"
    assert never.seen == []
    assert main(["disk", "--out", str(tmp_path / "new")]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["soak", "--vehicles", "21"], "--vehicles 21: mission.vehicles must be a whole number from 1 to 20, not 21"),
        (["soak", "--minutes", "1e9"], "--minutes 1e+09: mission.steps must be a whole number from 1 to"),
        (["day", "--vehicles", "99"], "--vehicles 99: mission.vehicles must be"),
        (["day", "--method", "nosuch"], "--method nosuch: planner.method must be one of"),
        (["day", "--hours", "1e9"], "--hours 1e+09: mission.steps must be"),
        (["field", "--loss", "2"], "argument --loss: '2' is not a number from 0 to below 1"),
        (["field", "--loss", "nan"], "argument --loss: 'nan' is not a number"),
        (["field", "--delay", "-1"], "argument --delay: '-1' is not a number of at least 0"),
        (["files", "nosuch"], "nosuch: there is no such file"),
    ],
)
def test_options_that_no_mission_can_have_are_wrong_command_lines(words, said, capsys):
    try:
        code = main(words)
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["soak", "--vehicles", "20", "--minutes", "0.1"],
        ["day", "--vehicles", "1", "--hours", "0.001", "--method", "lawnmower"],
        ["day"],
        ["soak"],
        ["field", "--loss", "0", "--delay", "0.5"],
        ["field", "--loss", "0.99", "--orders", "0"],
        ["files", __file__],
    ],
)
def test_unusual_options_are_accepted(words):
    options = faults.parser().parse_args(words)
    getattr(faults._kind(options.kind), "check", lambda options: None)(options)


def test_every_kind_accepts_its_small_size():
    small = faults._small()
    assert {"kills", "water"} <= set(small)
    for name, arguments in small.items():
        faults.parser().parse_args([name, *arguments])


@pytest.mark.parametrize("fault", water.FAULTS[5:], ids=lambda fault: fault.name)
def test_each_kind_of_water_and_clock_carries_packets(fault):
    fleet = water.RoughWater(Settings.load(None, {"mission.vehicles": 2, "mission.steps": 2}), fault, seed=1)
    for _ in range(20):
        fleet.tick()
    assert all(cores.bridge.counts["sent"] for cores in fleet.cores)


# ------------------------------------------------------------------ a day's schedule


@pytest.mark.parametrize(("vehicles", "kills", "reboots", "more"), [(3, 10, 2, 1000), (1, 10, 2, 0), (2, 1, 1, 0)])
def test_a_day_has_all_faults_each_at_a_step_of_its_own(vehicles, kills, reboots, more):
    legs = day.least_legs(vehicles, kills, reboots) + more
    for seed in range(50):
        faults_of = day.schedule(vehicles, legs, kills, reboots, np.random.default_rng(seed))
        assert faults_of == day.schedule(vehicles, legs, kills, reboots, np.random.default_rng(seed))
        every = [fault.step for own in faults_of.values() for fault in own]
        assert sorted(faults_of) == list(range(1, vehicles + 1))
        assert len(set(every)) == len(every) == vehicles * (kills + reboots)
        assert min(every) >= 1
        assert max(every) < legs - 1
        late = list(day.LATE[-min(kills, 2) :])
        for own in faults_of.values():
            assert [fault.step for fault in own] == sorted(fault.step for fault in own)
            assert sum(not fault.node for fault in own) == reboots
            assert [fault.node for fault in own if fault.late] == [fault.node for fault in own[-len(late) :]] == late
            assert all(a.node != b.node for a, b in pairwise(own) if a.node)


def test_the_vehicles_take_turns_and_the_last_restarts_come_after_the_day():
    faults_of = day.schedule(3, 1146, 10, 2, np.random.default_rng(1))
    owners = [k for _, k in sorted((fault.step, k) for k, own in faults_of.items() for fault in own)]
    assert owners == [1, 2, 3] * 12
    assert all(fault.step >= 1100 for own in faults_of.values() for fault in own if fault.late)


# ------------------------------------------------------------------ what counts as lost

SLOTS = TdmaConfig(slot_s=1.5, guard_s=0.05, send_duration_s=0.5, max_range_m=300.0)


@pytest.fixture
def ledger():
    return Ledger(2, Tdma(SLOTS, 2, 3), Tagger(bytes(16), 8, "dive"))


def test_a_leg_may_be_published_again_but_not_decided_again(ledger):
    for step in range(3):
        ledger.take_leg(step, (10.0 * step, 0.0))
        ledger.take_record(step)
    ledger.take_leg(2, (20.0, 0.0))  # by a restarted planner
    assert not ledger.broken
    ledger.take_leg(1, (10.0, 1.0))
    ledger.take_record(2)
    assert ledger.broken == [
        "the leg of step 1 was decided twice, with different ends",
        "step 2 decided after step 2",
    ]


def test_a_step_is_lost_without_leg_and_record(ledger):
    ledger.take_record(0)
    ledger.take_leg(2, (0.0, 0.0))  # its planner was killed before the record
    assert ledger.last_step == 2
    assert ledger.lost_steps(4) == [1, 3]
    ledger.new_dive()
    assert ledger.lost_steps(2) == [0, 1]


def test_a_map_that_has_fewer_soundings_than_before_has_lost_them(ledger):
    ledger.map_sizes += [10, 10, 25]
    assert ledger.lost_soundings() == []
    ledger.map_sizes += [20, 30, 29]
    assert ledger.lost_soundings() == [5, 1]
    ledger.new_dive()
    ledger.map_sizes += [1]
    assert ledger.lost_soundings() == []


def test_each_packet_has_a_counter_and_a_slot_of_its_own(ledger):
    sender = Tagger(bytes(16), 8, "dive")

    def sealed(slot_s, source=2):
        return sender.seal(bytes(PACKET_BYTES), source, slot_s)

    ledger.take_packet(6.1, sealed(6.0))  # slots of 1.5 s: vehicle 2 owns those at 1.5, 6.0, 10.5 s, ...
    ledger.take_packet(10.6, sealed(10.5))
    assert not ledger.broken
    assert len(ledger.slots) == 2
    ledger.take_packet(10.8, sealed(10.5))
    ledger.take_packet(7.6, sealed(6.0))
    ledger.take_packet(15.1, sealed(15.0, source=3))
    assert [text.split("(")[0].strip() for text in ledger.broken] == [
        "counter",
        "a packet at 7.60 s is outside of the vehicle's slots",
        "counter",
        "a packet's tag is that of no slot",
    ]


def test_a_restarted_node_reads_its_whole_journal_but_for_torn_lines(tmp_path):
    path = tmp_path / "journal"
    before = Journal(path, {})
    for number in range(5):
        before.write("step", number)
    before.close()
    whole = path.read_bytes()

    def problem(left, kills=1):
        path.write_bytes(left)
        after = Journal(path, {})
        found = journal_problem(whole, f"journal {path}: {after.status}\n" if after.records else "", kills)
        after.close()
        return found

    assert not problem(whole)
    assert not problem(whole + b"torn by the ki")
    assert problem(whole[:-30]) == "4 of the journal's 5 records read back"
    assert problem(whole.partition(b"\n")[0] + b"\n") == "0 of the journal's 5 records read back"
    assert problem(whole.replace(b"step", b"stop"), kills=4) == "0 of the journal's 5 records read back"
    assert problem(whole.replace(b"step", b"stop", 2)) == "2 lines of the journal damaged by 1 kill"
    assert not journal_problem(whole.partition(b"\n")[0] + b"\n", "", 1)  # nothing to read back


def test_a_center_is_lost_if_no_later_one_is_near():
    before = [[0.0, 0.0], [100.0, 0.0], [200.0, 0.0]]
    after = [[0.0, 3.0], [101.0, 0.0], [500.0, 0.0]]
    assert lost_positions(before, after, 10.0) == 1
    assert lost_positions(before, [], 10.0) == 3
    assert lost_positions([], after, 10.0) == 0


# ------------------------------------------------------------------ a vehicle's day


class FakeVehicle:
    """A vehicle of the bed whose nodes do what a test tells them."""

    def __init__(self, number, folder):
        self.number, self.out, self.program = number, folder, None
        self.killed, self.started = [], True
        (folder / "logs").mkdir(parents=True)
        (folder / "journal" / "1").mkdir(parents=True)
        for node in day.NODES:
            self.log(node, "ready after 1.00 s of processor time\n")
        self.centers = np.array([[0.0, 0.0], [50.0, 0.0]])
        self.state = RunState.RUNNING
        self.received = []
        self.witness = SimpleNamespace(
            vehicle=number,
            ledger=Ledger(number, Tdma(SLOTS, number, 3), Tagger(bytes(16), 8, "dive")),
            published_s={},
            heard_s={},
            problems=set(),
            since_s=0.0,
            is_in=lambda *states: self.state in states,
            centers_m=lambda: self.centers,
            receive=lambda source, payload: self.received.append((source, payload)),
        )

    def log(self, node, text):
        with (self.out / "logs" / f"auv{self.number}.{node}.log").open("a") as file:
            file.write(text)

    def kill(self, node):
        self.killed.append(node)
        self.witness.since_s += 100.0
        self.witness.published_s.clear()

    def has_started(self):
        return self.started


@pytest.fixture
def team(tmp_path):
    return {k: FakeVehicle(k, tmp_path / f"auv{k}") for k in (1, 2)}


def begun(team, *faults_of_1):
    bed = SimpleNamespace(vehicles=team)
    return day.VehicleDay(bed, team[1], faults_of_1, lambda text: None)


def come_back(team, node, step):
    """Vehicle 1 is back after a kill: its node, a decision, and packets both ways."""
    witness, now_s = team[1].witness, team[1].witness.since_s
    team[1].log(node, "ready after 0.10 s of processor time\n")
    witness.published_s |= {day.OUTPUTS[node]: now_s + 1.5, "modem/tx": now_s + 2.0}
    witness.heard_s[2] = now_s + 1.0
    team[2].witness.heard_s[1] = now_s + 2.5
    witness.ledger.take_record(step)


def test_a_recovery_is_over_when_the_node_the_mission_and_the_packets_are_back(team):
    own = begun(team, day.Fault(3, "gp_node"))
    witness = team[1].witness
    witness.ledger.take_record(2)
    assert not own.advance()
    assert not team[1].killed
    witness.ledger.take_record(3)
    own.advance()
    assert team[1].killed == ["gp_node"]
    team[2].witness.heard_s[1] = witness.since_s + 2.5
    own.advance()
    (strike,) = [own._now]
    assert strike.missing() == "an output of each node, a decision, mates' packets"
    come_back(team, "gp_node", 4)
    team[2].witness.heard_s[1] = witness.since_s + 1.9  # from before the vehicle's next packet
    own.advance()
    assert strike.missing() == "mates' packets"
    team[2].witness.heard_s[1] = witness.since_s + 2.5
    own.advance()
    assert own.strikes == [strike]
    assert strike.output_s == 1.5
    assert not strike.wrong
    team[1].state = RunState.ENDED
    assert own.advance()
    assert own.lost_at_end(5) == ["steps [0, 1] were not decided"]


def test_a_restarted_map_without_a_center_and_a_journal_that_is_not_read_are_losses(team):
    own = begun(team, day.Fault(0, "gp_node"))
    (team[1].out / "journal" / "1" / "auv1.gp_node.journal").write_bytes(b"{}\n1 a\n2 b\n")
    team[1].witness.ledger.take_record(0)
    own.advance()
    team[1].centers = team[1].centers[:1]
    come_back(team, "gp_node", 1)
    team[1].log("gp_node", "journal x: 1 record read back\n")
    own.advance()
    team[1].witness.ledger.map_sizes += [90, 80]
    assert own.strikes[0].wrong == [
        "gp_node: 1 of the journal's 2 records read back",
        "1 of 2 centers are not in the next map",
    ]
    assert own.lost_at_end(2) == [
        "its map lost 10 soundings",
        "1 centers of earlier maps are not in the last one",
    ]


def test_what_never_comes_back_is_a_loss_and_a_silent_planner_ends_the_day(team, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(day.time, "monotonic", lambda: clock[0])
    own = begun(team, day.Fault(0, "planner_node"))
    team[1].witness.ledger.take_record(0)
    own.advance()
    clock[0] = day.NEVER_S + 1.0
    own.advance()
    assert own.strikes[0].wrong == ["not back after 300 s: an output of each node, a decision, mates' packets"]
    assert math.isnan(own.strikes[0].output_s)
    clock[0] += day.NEVER_S + 1.0
    with pytest.raises(RuntimeError, match="auv1: nothing after step 0 for 300 s"):
        own.advance()


def test_the_water_carries_a_packet_to_all_mates(team, tmp_path):
    DiveBed(tmp_path, team, tmp_path / "key")
    team[2].witness.send(b"hello")
    assert team[1].received == [(2, b"hello")]
    assert not team[2].received


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["day", "--vehicles", "0"], "argument --vehicles: '0' is not a whole number of at least 1"),
        (["day", "--kills", "-1"], "argument --kills: '-1' is not a whole number of at least 0"),
        (["day", "--hours", "inf"], "argument --hours: 'inf' is not a number above 0"),
        (["day", "--speed-up", "fast"], "argument --speed-up: 'fast' is not a number above 0"),
        (["day", "--seed", "-1"], "argument --seed: '-1' is not a whole number of at least 0"),
        (["disk", "--moments", "0"], "argument --moments: '0' is not a whole number of at least 1"),
        (["reboot", "--moments", "0"], "argument --moments: '0' is not a whole number of at least 1"),
        (["flood", "--datagrams", "0"], "argument --datagrams: '0' is not a number above 0"),
        (["soak", "--minutes", "nan"], "argument --minutes: 'nan' is not a number above 0"),
        (["field", "--outage", "-5"], "argument --outage: '-5' is not a number above 0"),
        (["field", "--loss", "1"], "argument --loss: '1' is not a number from 0 to below 1"),
        (["field", "--loss", "30"], "argument --loss: '30' is not a number from 0 to below 1"),
        (["field", "--delay", "nan"], "argument --delay: 'nan' is not a number of at least 0"),
    ],
)
def test_an_impossible_drill_is_refused_by_name(arguments, words, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert words in capsys.readouterr().err


def test_links_without_loss_or_delay_can_be_asked_for():
    options = faults.parser().parse_args(["field", "--loss", "0", "--delay", "0"])
    assert (options.loss, options.delay) == (0.0, 0.0)


def test_a_recovery_after_the_last_leg_reads_like_one():
    strike = day.Strike(2, day.Fault(75, "gp_node"), 75, output_s=1.0, decided_s=math.inf, heard_s=4.52)
    assert strike.text == "output after 1.0 s, no leg left, mates after 4.5 s"
    alone = day.Strike(1, day.Fault(3, ""), 3, output_s=1.0, decided_s=2.0, heard_s=math.inf, wrong=["a", "b"])
    assert alone.text == "output after 1.0 s, decision after 2.0 s; a; b"


@pytest.mark.parametrize("end", [Vehicle.end, Vehicle.cut_power])
@pytest.mark.parametrize("deletes", [False, True], ids=["", "its folder is deleted"])
def test_an_ended_vehicle_leaves_no_state_in_memory(tmp_path, monkeypatch, end, deletes):
    memory = tmp_path / "memory"
    memory.mkdir()
    monkeypatch.setattr(state_memory, "MEMORY", memory)
    vehicle = Vehicle(0, SimpleNamespace(vehicle=1, forget=lambda: None, note_death=lambda: None))
    monkeypatch.setattr(vehicle, "pids", list)
    nodes = dict.fromkeys(day.NODES, 1)
    process = SimpleNamespace(poll=lambda: 0)
    vehicle.program = SimpleNamespace(process=process, wait=lambda seconds: None, text=[], nodes=nodes)
    vehicle.out = tmp_path / "dive"
    state = StateFile(vehicle.out / "journal" / "start" / "auv1.safety_node.state", {}, start="a")
    state.write({"step": 1})
    state.close()
    assert len(list(memory.iterdir())) == 1
    assert vehicle.has_started()
    if deletes:
        shutil.rmtree(vehicle.out)
    end(vehicle)
    assert not list(memory.iterdir())


def test_damaged_files_are_read_apart_and_what_breaks_a_reader_is_reported(tmp_path, monkeypatch):
    options = SimpleNamespace(originals=[], files=4, seed=1)
    report = files.run(options, tmp_path / "whole", lambda line: None)
    assert (report.tried, report.survived, report.lost) == (4, 4, [])

    def broken(path):
        raise KeyError("depth")

    monkeypatch.setattr(files, "_readers", lambda: [(broken, (ValueError,))])
    report = files.run(options, tmp_path / "broken", lambda line: None)
    assert report.survived == 0
    assert "KeyError: 'depth'" in report.lost[0]
    assert (tmp_path / "broken" / "damaged-0.geojson").is_file()


def test_the_end_of_a_terminal_ends_a_flood_in_one_word():
    """It sends SIGHUP to all processes, also to those of Python's own that count shared memory."""
    command = [sys.executable, "-m", "auv_lse_run", "faults", "flood", "--seconds", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        said = process.stderr.readline()
        assert "garbage: " in said  # the first flood is over
        os.killpg(process.pid, signal.SIGHUP)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (129, "interrupted\n")
