"""A thousand damaged states of a dive: after the reboot no vehicle travels, and nothing raises."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import DOUBT_VARIABLE, NODES, open_state
from auv_lse_common.vocabulary.mission_run import Command, RunState
from auv_lse_planner.safety import Safety
from auv_lse_run.vehicle.run_vehicle import open_dive

DEPTH_M = 5.0
#: What can happen to a dive before the power fails.
STORIES = ("aborted", "on hold", "under way")


@dataclass(frozen=True, kw_only=True)
class Dive:
    """A dive whose power has failed.

    Attributes:
        root: The folder of everything; the second copies are in another folder of it.
        out: As `--out`.
        files: State files and record, and their second copies.
        older: What each of them was a moment before.
    """

    root: Path
    out: Path | None
    files: tuple[Path, ...]
    older: dict[Path, bytes]


def start(root: Path, out: Path | None, number: int = 0) -> tuple[Any, dict[str, Any], Safety]:
    """Starts the vehicle's programs, as `auv_lse vehicle` does."""
    record, folder = open_dive("auv1", root / "vehicles.yaml", out, root / "card" / "dives", False)
    environment = record.begin(folder, f"auv1-1123-184534-{number:04x}")
    files = {}
    for node in NODES:
        path = Path(environment[FOLDER_VARIABLE]) / f"auv1.{node}.state"
        files[node] = open_state(path, {"node": node}, environment)
    parameters = yaml.safe_load((root / "vehicles.yaml").read_text())["/**"]["ros__parameters"]
    safety, state = Safety.of(parameters, "test", 1), files["safety_node"]
    safety.recover(state.values, state.lost, state.rebooted, environment[DOUBT_VARIABLE])
    state.write(safety.snapshot())
    return record, files, safety


def stop(files: dict[str, Any]) -> None:
    """The power fails: the copies in memory are lost."""
    for state in files.values():
        state.close()
        state._memory._path.unlink(missing_ok=True)


def dive(root: Path, story: str, explicit: bool) -> Dive:
    """A dive in a new folder, up to the power failure."""
    root.mkdir()
    out = root / "card" / "dive7" if explicit else None
    (root / "vehicles.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": {
        "mission": {"vehicles": 1},
        "area": {"polygon_m": [0.0, 0.0, 100.0, 0.0, 100.0, 100.0, 0.0, 100.0]},
        "vehicle": {"start": "at_once", "depth_m": DEPTH_M},
        "safety": {"after_reboot": "resume", "state_copies": str(root / "copies")},
    }}}))  # fmt: skip
    record, files, safety = start(root, out)
    travel(safety, DEPTH_M, 5.0)
    assert safety.run.status.state is RunState.RUNNING
    files["safety_node"].write(safety.snapshot())
    for node in ("planner_node", "modem_node"):
        for step in range(3):
            files[node].write({"step": step})
    written = (*(path for path in root.rglob("auv1.*") if path.suffix in (".state", ".dive")),)
    older = {path: path.read_bytes() for path in written}
    if story != "under way":
        safety.run.command(Command.ABORT if story == "aborted" else Command.HOLD, "test")
        files["safety_node"].write(safety.snapshot())
    for node in ("planner_node", "modem_node"):
        for step in range(3, 6):
            files[node].write({"step": step})
    stop(files)
    (record._path.parent / "bag" if explicit else record._path.parent / "2026-auv1" / "bag").mkdir(parents=True)
    assert len(written) == 8
    return Dive(root=root, out=out, files=written, older=older)


def travel(safety: Safety, depth_m: float, seconds: float) -> bool:
    """Moves the vehicle for a while; returns whether it is under way at any time of it."""
    travelled = False
    for tick in range(round(2 * seconds)):
        now_s = 1000.0 + 0.5 * tick
        safety.watch.odometry(now_s, 0.0, 50.0 + 0.1 * tick, 50.0, depth_m, 1.0)
        safety.step(now_s)
        travelled |= safety.run.status.stop is None
    return travelled


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    flipped = bytearray(data)
    for bit in rng.integers(8 * 40, size=3):  # in a head or at the start of a text
        location = int(rng.integers(2)) * len(data) // 2 + int(bit) // 8
        flipped[location % len(data)] ^= 1 << int(bit) % 8
    return bytes(flipped)


def _in_place(change: Callable[[bytes, np.random.Generator], bytes]) -> Callable[..., None]:
    def damage(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
        path.write_bytes(change(path.read_bytes(), rng))

    return damage


def _swap(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    others = [file for file in dive.files if file.parent == path.parent and file != path] or list(dive.files)
    shutil.copyfile(others[int(rng.integers(len(others)))], path)


def _foreign(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    name, is_copy = path.name, "copies" in path.parts
    (source,) = (file for file in other.files if file.name == name and ("copies" in file.parts) is is_copy)
    shutil.copyfile(source, path)


def _loop(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    path.unlink()
    path.symlink_to(path)


def _folder(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    path.unlink()
    path.mkdir()


def _remove_folder(path: Path, dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    shutil.rmtree([*path.parents][int(rng.integers(1 if "copies" in path.parts else 2))])


DAMAGE: dict[str, Callable[[Path, Dive, Dive, np.random.Generator], None]] = {
    "zeroed": _in_place(lambda data, rng: bytes(len(data))),
    "empty": _in_place(lambda data, rng: b""),
    "truncated": _in_place(lambda data, rng: data[: int(rng.integers(len(data)))]),
    "doubled": _in_place(lambda data, rng: data + data),
    "bits flipped": _in_place(_flip),
    "garbage": _in_place(lambda data, rng: rng.bytes(len(data))),
    "its newer half zeroed": _in_place(lambda data, rng: data[: len(data) // 2] + bytes(len(data) // 2)),
    "older": lambda path, dive, other, rng: path.write_bytes(dive.older[path]) and None,
    "missing": lambda path, dive, other, rng: path.unlink(),
    "another node's": _swap,
    "another dive's": _foreign,
    "a symbolic link to itself": _loop,
    "a folder": _folder,
    "without its folder": _remove_folder,
    "forbidden": lambda path, dive, other, rng: path.chmod(0),
}


def apply(kinds: tuple[str, ...], paths: tuple[Path, ...], dive: Dive, other: Dive, rng: np.random.Generator) -> None:
    for kind, path in zip(kinds, paths, strict=True):
        if path.is_file():  # else the first damage has removed it
            DAMAGE[kind](path, dive, other, rng)


def is_whole(dive: Dive, before: dict[Path, bytes]) -> bool:
    """Whether a damage has changed nothing that can be read."""
    return all(os.access(path, os.R_OK) and path.is_file() and path.read_bytes() == before[path] for path in before)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without waiting for the disk, and with the copies in memory of nobody else."""
    monkeypatch.setattr(os, "fsync", lambda file: None)
    monkeypatch.setattr(os, "fdatasync", lambda file: None)


@pytest.mark.parametrize("story", STORIES)
@pytest.mark.parametrize("explicit", [False, True], ids=["dives", "out"])
def test_no_vehicle_with_a_damaged_state_travels(tmp_path: Path, quick: None, story: str, explicit: bool) -> None:
    rng = np.random.default_rng(7)
    other = dive(tmp_path / "other", "under way", explicit)
    one = dive(tmp_path / "one", story, explicit)
    kept = tmp_path / "kept"
    one.root.rename(kept)
    cases = [((kind,), (number,)) for kind in DAMAGE for number in range(8)]
    names = sorted(DAMAGE)
    for _ in range(60):
        pair = tuple(names[int(k)] for k in rng.integers(len(names), size=2))
        cases.append((pair, tuple(int(n) for n in rng.permutation(8)[:2])))
    for number, (kinds, numbers) in enumerate(cases):
        shutil.copytree(kept, one.root)
        before = {path: path.read_bytes() for path in one.files}
        paths = tuple(one.files[n] for n in numbers)
        if kinds == ("older", "older") and paths[0].name == paths[1].name:
            continue  # both copies on both media: nothing is left that knows better
        apply(kinds, paths, one, other, rng)
        changed = not is_whole(one, before)
        _, files, safety = start(one.root, one.out, number + 1)
        depth_m = (0.2, DEPTH_M)[number % 2]
        travelled = travel(safety, depth_m, 5.0)
        what = f"{story}: {' and '.join(f'{p} {k}' for k, p in zip(kinds, paths, strict=True))}"
        if changed or story != "under way":
            assert not travelled, what
        assert not (changed and safety.run.status.state is RunState.WAITING), f"a new dive: {what}"
        stop(files)
        shutil.rmtree(one.root)


def test_an_older_state_file_forgets_no_abort(tmp_path: Path, quick: None) -> None:
    one = dive(tmp_path / "one", "aborted", False)
    (path,) = (file for file in one.files if file.name == "auv1.safety_node.state" and "copies" not in file.parts)
    path.write_bytes(one.older[path])
    _, files, safety = start(one.root, one.out, 1)
    assert "is older than its second copy, by 1 states" in files["safety_node"].lost
    assert not travel(safety, DEPTH_M, 5.0)
    assert safety.run.command(Command.GO, "test"), "refused: it waits for RESET"
    stop(files)
