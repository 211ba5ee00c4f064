"""Inputs that nobody should give: each is an error in words and an exit code, and nothing half written stays.

Mission files have a test of their own (test_malformed_files.py).
"""

from __future__ import annotations

import io
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from verb_main import verb_main

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_comms.packet.key import KeyFileError, read_key
from auv_lse_record.recording import STORAGES
from auv_lse_record.run_data import RunData
from auv_lse_record.run_reader import read_run
from auv_lse_record.run_writer import write_run
from auv_lse_shore.campaign.spec import CampaignSpec
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground

campaign = verb_main("campaign")
check = verb_main("check")
export = verb_main("export")
fit = verb_main("fit")
live = verb_main("live")
mission = verb_main("mission")
sim = verb_main("sim")
replay = verb_main("replay")

CAMPAIGN = """\
name: loss
set: {mission.steps: 5}
grid:
  planner.method: [plain, augmented]
  sim.channel.packet_loss: [0.0, 0.5]
list:
  - {label: a, mission.vehicles: 1}
  - {label: b, mission.vehicles: 2}
seeds: {first: 1, count: 3}
"""
SOUNDINGS = ["east_m,north_m,depth_m\n"]
SOUNDINGS += [f"{x},{y},{10 + 0.01 * x + 0.02 * y}\n" for x in range(0, 100, 20) for y in range(0, 100, 20)]
NAMES = [
    "../..",
    "..",
    ".",
    "a/b",
    "/tmp/x",
    ".hidden",
    "a\0b",
    "a\nb",
    "x" * 101,
    "",
    "[1]",
    "{a: 1}",
    "1.5",
    "-",
    "~x/",
]
CAMPAIGNS = {
    "empty": "",
    "a list": "- 1\n",
    "a number": "7\n",
    "no YAML": "name: [\n",
    "a date that cannot be": "name: 2020-99-99\n",
    "nested without end": "set: " + "[" * 1200 + "]" * 1200 + "\n",
    "an unknown key": "seed: 3\n",
    "seeds: none": "seeds: 0\n",
    "seeds: text": "seeds: many\n",
    "seeds: twice the same": "seeds: [1, 1]\n",
    "seeds: true": "seeds: true\n",
    "seeds: an endless list": "seeds: &a [*a]\n",
    "a grid that is a list": "grid: [1]\n",
    "a grid of one value": "grid: {mission.steps: 5}\n",
    "a grid of no values": "grid: {mission.steps: []}\n",
    "a grid of lists": "grid: {mission.steps: [[1]]}\n",
    "an unknown parameter": "set: {mission.step: 5}\n",
    "a value out of range": "set: {mission.steps: -5}\n",
    "a value of another type": "set: {mission.steps: many}\n",
    "a mission that is not there": "mission: no_such.yaml\n",
    "a mission that is a folder": "mission: .\n",
    "a mission that is a list": "mission: [a.yaml]\n",
    "an empty list": "list: []\n",
    "a list of numbers": "list: [1]\n",
    "two of one label": "list: [{label: a}, {label: a}]\n",
    "the seed as a parameter": "set: {mission.seed: 3}\n",
    "a survey that is not there": "set: {sim.bathymetry.file: no_such.csv}\n",
}
KEYS = [
    "",
    "00" * 15,
    "00" * 33,
    "xyz",
    "0x" + "00" * 32,
    "é" * 32,
    "00" * 32 + "\n" + "00",
    "00 " * 7,
    "\0" * 64,
    "-" * 64,
]


def words(capsys: pytest.CaptureFixture[str], code: int) -> str:
    """The one error that a command has said."""
    said = capsys.readouterr()
    assert code == 2, said
    assert said.err.startswith("error: "), said
    assert "Traceback" not in said.err
    return said.err


def mutations(data: bytes, number: int, seed: int) -> Iterator[bytes]:
    """Copies with one to four changes each: cut, bytes set, put in, taken out, doubled."""
    rng = random.Random(seed)
    for _ in range(number):
        copy = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            at, what = rng.randrange(len(copy) + 1), rng.randrange(5)
            if what == 0:
                del copy[max(at, 1) :]
            elif what == 1:
                copy[at : at + 1] = bytes([rng.randrange(256)])
            elif what == 2:
                copy[at:at] = bytes([rng.choice(b"\0\n\t'\":,;{}[]&*!\xff9")]) * rng.randrange(1, 20)
            elif what == 3:
                del copy[at : at + rng.randrange(1, 40)]
            else:
                copy[at:at] = copy[at : at + rng.randrange(1, 40)]
        yield bytes(copy)


def read_all(file: Path, data: bytes, number: int, read: Callable[[Path], object], error: type[Exception]) -> int:
    """Reads mutated files; returns how many were refused, all by `error` with words in it."""
    refused = 0
    for mutated in mutations(data, number, seed=len(data)):
        file.write_bytes(mutated)
        try:
            read(file)
        except error:
            refused += 1
    return refused


# Campaigns ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_campaign_whose_name_is_no_folders_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.setenv("AUV_LSE_ROOT", str(tmp_path / "a project"))
    file = tmp_path / "c.yaml"
    file.write_text('name: "' + name.replace("\0", "\\0").replace("\n", "\\n") + '"\n' if name else "name: [1]\n")
    if name in ("[1]", "{a: 1}", "1.5", "-"):
        file.write_text(f"name: {name}\n" if name != "-" else "name: {}x\n")
    said = words(capsys, campaign([str(file), "--list"]))
    assert "cannot name a folder" in said or "not valid YAML" in said
    assert [path.name for path in tmp_path.iterdir()] == ["c.yaml"]


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_a_file_that_cannot_be_a_campaign_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    file = tmp_path / "größer als.yaml"
    file.write_text(CAMPAIGNS[name])
    words(capsys, campaign([str(file), "--list", "--out", str(tmp_path / "out")]))
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_mutated_campaigns_are_read_or_refused(tmp_path: Path) -> None:
    def read(file: Path) -> None:
        CampaignSpec.load(file).jobs()

    assert read_all(tmp_path / "c.yaml", CAMPAIGN.encode(), 120, read, ParameterError) > 60


# Grounds and keys -----------------------------------------------------------------------------------------------------


def test_mutated_tables_of_soundings_are_read_or_refused(tmp_path: Path) -> None:
    def read(file: Path) -> None:
        load_ground(str(file), BathymetryConfig())

    assert read_all(tmp_path / "g.csv", "".join(SOUNDINGS).encode(), 150, read, GroundError) > 60


def test_mutated_grids_are_read_or_refused(tmp_path: Path) -> None:
    grid = io.BytesIO()
    np.savez(grid, north_m=np.arange(5.0) * 10, east_m=np.arange(6.0) * 10, depth_m=np.full((5, 6), 12.0))

    def read(file: Path) -> None:
        load_ground(str(file), BathymetryConfig())

    assert read_all(tmp_path / "g.npz", grid.getvalue(), 100, read, GroundError) > 60


@pytest.mark.parametrize("text", KEYS)
def test_a_key_that_is_none_is_refused_and_not_shown(tmp_path: Path, text: str) -> None:
    file = tmp_path / "key of é"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"name a file|a key has") as error:
        read_key(file)
    assert len(text) < 4 or text not in str(error.value)


def test_random_bytes_are_no_key(tmp_path: Path) -> None:
    file, rng = tmp_path / "key", random.Random(1)
    for _ in range(50):
        file.write_bytes(rng.randbytes(rng.randrange(100)))
        file.chmod(0o600)
        with pytest.raises(KeyFileError, match=r"name a file|a key has"):
            read_key(file)


# Recordings -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(synthetic_run: Callable[..., RunData], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "lake é 1"
    write_run(synthetic_run(steps=4), folder)
    return folder


def test_commands_take_mutated_recordings_or_refuse_them(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = tmp_path / "run", tmp_path / "out of é"
    shutil.copytree(recorded, run)
    messages = next(file for file in (run / "bag").iterdir() if file.suffix in STORAGES)
    commands = (
        lambda: replay([str(run), "--recompute", "planner", "--csv", str(out)]),
        lambda: replay([str(run), "--report", "--out", str(out)]),
        lambda: live([str(run), "--write", str(out)]),
    )
    refused = 0
    for file in (messages, run / "bag" / "metadata.yaml", run / "mission.yaml"):
        whole = file.read_bytes()
        for number, mutated in enumerate(mutations(whole, 6, seed=3)):
            file.write_bytes(mutated)
            code = commands[number % 3]()
            said = capsys.readouterr()
            assert code in (0, 1, 2), said
            assert "Traceback" not in said.err + said.out
            assert code != 2 or (said.err.startswith("error: ") and not out.exists()), said
            refused += code == 2
            if out.exists():
                shutil.rmtree(out) if out.is_dir() else out.unlink()
        file.write_bytes(whole)
    assert refused > 6


def test_mutated_recordings_are_read_or_refused(recorded: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(recorded, run)
    messages = next(file for file in (run / "bag").iterdir() if file.suffix in STORAGES)
    for file, number in ((messages, 10), (run / "bag" / "metadata.yaml", 10)):
        whole = file.read_bytes()
        refused = read_all(file, whole, number, lambda _: read_run(run), ValueError)
        file.write_bytes(whole)
        assert refused > number // 5, file
    read_run(run)


@pytest.mark.parametrize("gone", ["bag", "bag/metadata.yaml", "everything", "the folder"])
def test_an_incomplete_run_is_refused(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], gone: str
) -> None:
    run = tmp_path / "run"
    shutil.copytree(recorded, run)
    if gone in ("everything", "the folder"):
        shutil.rmtree(run)
        if gone == "everything":
            run.mkdir()
    elif gone == "bag":
        shutil.rmtree(run / gone)
    else:
        (run / gone).unlink()
    code = export([str(run), "--out", str(tmp_path / "to")])
    if gone == "bag/metadata.yaml" and code == 0:
        return  # its one file of messages is enough
    words(capsys, code)
    assert not (tmp_path / "to").exists() or not list((tmp_path / "to").iterdir())


# Disks ----------------------------------------------------------------------------------------------------------------


def test_a_full_disk_is_told(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "soundings of é.csv"
    table.write_text("".join(SOUNDINGS))
    with full_disk(150):
        code = export([str(recorded), "--out", str(tmp_path / "to")])
        fitted = fit([str(table), "--restarts", "1", "--out", str(tmp_path / "gp.yaml")])
    said = capsys.readouterr()
    assert (code, fitted) == (2, 2), said
    assert said.err.count("File too large") == 2, said
    assert "Traceback" not in said.err


@pytest.mark.parametrize(
    "command",
    [
        lambda folder: replay([str(folder / "run"), "--recompute", "planner", "--csv", str(folder / "to")]),
        lambda folder: replay([str(folder / "run"), "--report", "--out", str(folder / "to")]),
        lambda folder: live([str(folder / "run"), "--write", str(folder / "to")]),
        lambda folder: mission(["--steps", "2", "--out", str(folder / "to")]),
        lambda folder: mission(["--set", "modem.port=/dev/ttyUSB0", "--for-vehicles", str(folder / "to")]),
        lambda folder: sim(["--steps", "2", "--apart", "--domain", "77", "--out", str(folder / "to")]),
    ],
    ids=["replay --csv", "replay --report", "live --write", "mission --out", "mission --for-vehicles", "sim --out"],
)
def test_on_a_full_disk_nothing_half_written_stays(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: Callable[[Path], int]
) -> None:
    shutil.copytree(recorded, tmp_path / "run")
    with full_disk(150):
        code = command(tmp_path)
    said = capsys.readouterr()
    assert code == 2, said
    assert "Traceback" not in said.err + said.out
    assert str(tmp_path / "to") in (said.err + said.out).replace("\n", ""), said
    assert "File too large" in said.err + said.out
    assert [path.name for path in tmp_path.iterdir() if not path.is_dir() or any(path.iterdir())] == ["run"]


@pytest.mark.parametrize(
    "command",
    [
        lambda folder: campaign([str(folder / "c.yaml"), "--out", str(folder / "file" / "out")]),
        lambda folder: export([str(folder / "run"), "--out", str(folder / "file" / "to")]),
        lambda folder: check([str(folder / "file" / "m.yaml")]),
        lambda folder: mission(["--out", str(folder / "file" / "run")]),
        lambda folder: mission(["--out", str(folder / "file" / ("x" * 300))]),
        lambda folder: mission(["--set", "modem.port=/dev/x", "--for-vehicles", str(folder / "file" / "v.yaml")]),
        lambda folder: replay([str(folder / "run"), "--report", "--out", str(folder / "file")]),
        lambda folder: replay([str(folder / "run"), "--recompute", "planner", "--csv", str(folder / "file" / "x.csv")]),
        lambda folder: replay([str(folder / "file"), "--report"]),
        lambda folder: live([str(folder / "run"), "--write", str(folder / "file" / "x.html")]),
        lambda folder: live([str(folder / "file" / ("x" * 300)), "--write", str(folder / "x.html")]),
        lambda folder: live([str(folder / "file")]),
    ],
)
def test_a_position_that_cannot_be_written_is_told(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: Callable[[Path], int]
) -> None:
    """As on a read-only disk, for root as well: a folder is asked for below a file."""
    (tmp_path / "c.yaml").write_text(CAMPAIGN)
    (tmp_path / "file").write_text("")
    shutil.copytree(recorded, tmp_path / "run")
    code = command(tmp_path)
    said = capsys.readouterr()
    assert code != 0
    assert "Traceback" not in said.err + said.out
    assert str(tmp_path / "file") in said.err + said.out
