"""auv_lse fleet over real ssh and sshd on this machine."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_run.command.main import main
from auv_lse_shore.remote.ledger_file import LedgerFile
from benchmarks.field.relay import Relay
from benchmarks.field.side import EXECUTED
from benchmarks.field.sshd import ROOT, Computer, Field, free_port, lacks_sshd, side_command

pytestmark = pytest.mark.skipif(bool(lacks_sshd()), reason=lacks_sshd())


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Field, Computer]]:
    made = Field(tmp_path_factory.mktemp("field"))
    with made.computer("auv1") as computer:
        made.trust("auv1", computer.port)
        yield made, computer


def test_an_order_reaches_the_vehicle_in_reach_and_stays_pending_for_the_other(
    field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str]
) -> None:
    made, computer = field
    (computer.folder / EXECUTED).unlink(missing_ok=True)
    noting = {"port": computer.port, "folder": str(computer.folder), "command": side_command("benchmarks.field.side")}
    file = str(made.fleet_file({"auv1": noting, "auv2": {"port": free_port()}}, "orders.yaml"))
    assert main(["fleet", file, "go", "--anyway", "--wait", "0.1"]) == 1
    text = capsys.readouterr().out
    assert "auv1: GO acted" in text
    assert "auv2: GO is pending (Its computer answers, but SSH does not run there" in text
    assert main(["fleet", file, "pending", "--cancel", "--wait", "0.1"]) == 0
    assert "auv2: GO is cancelled; it was never sent" in capsys.readouterr().out
    assert [line.split()[1] for line in (computer.folder / EXECUTED).read_text().splitlines()] == ["go"]


def test_a_second_laptop_commands_only_after_taking_over_and_the_first_reads_that(
    field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    made, computer = field
    noting = {"port": computer.port, "folder": str(tmp_path), "command": side_command("benchmarks.field.side")}
    first, second = (str(made.fleet_file({"auv1": noting}, f"{name}.yaml")) for name in ("first", "second"))
    assert main(["fleet", first, "hold"]) == 0
    assert main(["fleet", second, "surface"]) == 1
    assert "SURFACE refused: " in capsys.readouterr().out
    assert main(["fleet", second, "surface", "--take-over"]) == 0
    assert "auv1: taken over from " in capsys.readouterr().out
    assert main(["fleet", first, "hold"]) == 1
    assert "has commanded this vehicle since" in capsys.readouterr().out
    assert [line.split()[1] for line in (tmp_path / EXECUTED).read_text().splitlines()] == ["hold", "surface"]


def test_go_that_reached_only_some_is_held_with_one_key(
    field: tuple[Field, Computer],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, computer = field
    noting = {"port": computer.port, "folder": str(tmp_path), "command": side_command("benchmarks.field.side")}
    file = str(made.fleet_file({"auv1": noting, "auv2": {"port": free_port()}}, "some.yaml"))
    asked: list[str] = []
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda text: asked.append(text) or "h")
    assert main(["fleet", file, "go", "--anyway", "--wait", "0.1"]) == 1
    assert "[h]old auv1, and cancel the rest" in asked[0]
    assert "auv1: HOLD acted" in capsys.readouterr().out
    assert [line.split()[1] for line in (tmp_path / EXECUTED).read_text().splitlines()] == ["go", "hold"]
    assert LedgerFile(made.folder / "some.yaml").read().open("auv2") == []


def test_check_names_each_reason_why_a_vehicle_does_not_answer(
    field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    made, computer = field
    at, old = {"port": computer.port, "folder": str(computer.folder)}, tmp_path / "old"
    old.write_text("#!/bin/sh\necho 'error: auv_lse has no verb vehicle-side. List the verbs' >&2\nexit 2\n")
    chatty = tmp_path / "chatty"
    chatty.write_text(f'#!/bin/sh\necho Welcome\nexec {side_command()} "$@"\n')
    for script in (old, chatty):
        script.chmod(0o755)
    entries = {
        "auv1": {**at, "command": str(chatty)},
        "auv2": {**at, "host": "localhost"},
        "auv3": {**at, "command": "no_such_auv_lse"},
        "auv4": {**at, "command": str(old)},
        "auv5": {**at, "user": "nobody"},
        "auv6": {**at, "folder": "/nowhere"},
    }
    assert main(["fleet", str(made.fleet_file(entries, "check.yaml")), "check", "--quick"]) == 1
    text = capsys.readouterr().out
    lines = {line.partition(":")[0]: line for line in reversed(text.splitlines()) if line.startswith("auv")}
    assert "it has no mission file" in lines["auv1"]
    assert "Its host key is not known on this laptop" in lines["auv2"]
    assert "Set 'command' of auv3" in lines["auv3"]
    assert "old version" in lines["auv4"]
    assert "ssh-copy-id" in lines["auv5"]
    assert "mkdir -p /nowhere" in lines["auv6"]


def test_another_host_key_is_refused(field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str]) -> None:
    made, computer = field
    file = str(made.fleet_file({"auv1": {"port": computer.port, "folder": str(computer.folder)}}, "changed.yaml"))
    known = made.known_hosts.read_text()
    with made.computer("auv9"):
        made.known_hosts.write_text("")
        made.trust("auv9", computer.port)
    assert main(["fleet", file, "check", "--quick"]) == 1
    made.known_hosts.write_text(known)
    assert "It shows another host key than before" in capsys.readouterr().out


def test_init_writes_a_file_that_can_be_read_and_replaces_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.yaml"
    assert main(["fleet", str(file), "init", "auv@auv1.local", "auv2:2222"]) == 0
    assert main(["fleet", str(file), "init"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["fleet", str(file), "check", "auv3"]) == 2
    assert "auv3 is not in" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicles: {}\n", "'vehicles' is missing"),
        ("vehicles: {auv1: {host: a, prot: 22}}\n", "'prot' is not known"),
        ("vehicles: {boat: {host: a}}\n", "not a vehicle's name"),
        ("vehicles: {auv1: {host: a, port: x}}\n", "write a whole number"),
        ("vehicles: {auv1: {host: -oProxyCommand=x}}\n", "begins with a dash"),
        ("vehicles: {auv1: {host: a}, auv1: {host: b}}\n", "appears twice"),
        ("hosts: 1\nvehicles: {auv1: {host: a}}\n", "'hosts' is not known"),
    ],
)
def test_a_wrong_fleet_file_is_refused(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fleet.yaml").write_text(text)
    assert main(["fleet", str(tmp_path / "fleet.yaml"), "check"]) == 2
    assert words in capsys.readouterr().err


MISSION = """\
/**:
  ros__parameters:
    mission: {vehicles: 2}
    packet: {tag: true, key_file: team.key, session: lake}
    area: {file: lake.geojson}
"""


def write_mission(folder: Path) -> Path:
    shutil.copy(ROOT / "config" / "missions" / "lake.geojson", folder)
    (folder / "team.key").write_text("ab" * 32)
    (folder / "team.key").chmod(0o600)
    file = folder / "vehicles.yaml"
    file.write_text(MISSION)
    return file


def test_send_gives_the_same_files_to_all_or_to_none(
    field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    made, computer = field
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
    at = [{"port": computer.port, "folder": str(folder)} for folder in folders]
    mission = str(write_mission(tmp_path))
    file = str(made.fleet_file({"auv1": at[0], "auv2": {"port": free_port()}}, "send.yaml"))
    assert main(["fleet", file, "send", mission, "--wait", "0.1"]) == 1
    assert "Nothing was changed" in capsys.readouterr().err
    assert not (folders[0] / "mission.yaml").exists()
    file = str(made.fleet_file({"auv1": at[0], "auv2": at[1]}, "send.yaml"))
    assert main(["fleet", file, "send", mission]) == 0
    texts = {(folder / "mission.yaml").read_text() for folder in folders}
    assert len(texts) == 1
    sent = Settings.load(folders[0] / "mission.yaml")  # without a reader of area files
    assert len(sent.area.polygon_m) >= 6
    assert (folders[1] / "team.key").read_text() == "ab" * 32
    assert main(["fleet", file, "check", "--quick", "auv1"]) == 0, capsys.readouterr().out
    (folders[1] / "mission.yaml").write_text("/**:\n  ros__parameters:\n    mission: {vehicles: 2, steps: 7}\n")
    (folders[0] / "team.key").unlink()
    assert main(["fleet", file, "check", "--quick"]) == 1
    text = capsys.readouterr().out
    assert "auv1: the file of packet.key_file is missing there" in text
    assert "auv2: its mission file" in text
    swapped = str(made.fleet_file({"auv1": at[1], "auv2": at[1]}, "send.yaml"))
    assert main(["fleet", swapped, "check", "--quick"]) == 1
    text = capsys.readouterr().out
    assert "auv1: its folder is that of auv2" in text
    assert "auv1 and auv2 are one folder on one computer" in text


def test_fetch_continues_after_cuts_verifies_and_deletes_only_then(
    field: tuple[Field, Computer], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    made, computer = field
    bag = tmp_path / "vehicle" / "dives" / "2026-07-01-auv1" / "bag"
    bag.mkdir(parents=True)
    data = random.Random(1).randbytes(2_000_000)
    (bag / "bag.mcap").write_bytes(data)
    (bag.parent / "logs").mkdir()
    (bag.parent / "logs" / "a.log").write_text("")
    with Relay(computer.port, seed=5, cut_rate=1.0) as relay:
        relay.cut_within = 1_500_000
        made.trust("auv1", relay.port)
        file = str(made.fleet_file({"auv1": {"port": relay.port, "folder": str(tmp_path / "vehicle")}}, "fetch.yaml"))
        arguments = ["fleet", file, "fetch", "--copy-only", "--wait", "20", "--out", str(tmp_path / "out")]
        assert main(arguments) == 0, capsys.readouterr()
        copied = tmp_path / "out" / "auv1" / "2026-07-01-auv1"
        assert (copied / "bag" / "bag.mcap").read_bytes() == data
        assert (copied / "logs" / "a.log").read_text() == ""
        assert "continued" in capsys.readouterr().out
        assert relay.counts["cut"] >= 2
        (copied / "bag" / "bag.mcap").write_bytes(b"damaged here")
        relay.cut_rate = 0.0
        assert main([*arguments, "--delete"]) == 0
    assert (copied / "bag" / "bag.mcap").read_bytes() == data
    assert not (tmp_path / "vehicle" / "dives" / "2026-07-01-auv1").exists()
