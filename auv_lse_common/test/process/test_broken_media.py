"""The keeper starts its processes although the folder of their log files is read-only, deleted or full."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from auv_lse_common.process.keeper import ProcessKeeper, Task, node_task
from auv_lse_common.process.processes import Process

SAFETY = Process(package="auv_lse_planner", executable="safety_node", namespace="/auv1")
GP = Process(package="auv_lse_gp", executable="gp_node", namespace="/auv1")


@pytest.fixture
def medium(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own."""
    folder = tmp_path / "medium"
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(folder)], capture_output=True, text=True
    )
    if done.returncode:
        pytest.skip(f"this process may mount nothing: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def break_medium(folder: Path, fault: str) -> None:
    (folder / "logs").mkdir()
    if fault == "read-only":
        subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
    elif fault == "deleted":
        shutil.rmtree(folder / "logs")
    else:
        for size in (4096, 1):
            with contextlib.suppress(OSError), (folder / "filling").open("ab", buffering=0) as file:
                while file.write(bytes(size)):
                    pass


@pytest.mark.parametrize("fault", ["read-only", "deleted", "full"])
def test_a_program_is_restarted_and_the_medium_reported_once(medium: Path, fault: str) -> None:
    break_medium(medium, fault)
    said: list[str] = []
    task = Task(name="auv1.x", command=lambda number: [sys.executable, "-c", "print('runs')"])
    keeper = ProcessKeeper([task], medium / "logs", os.environ, said.append)
    try:
        until = time.monotonic() + 30.0
        while keeper.starts["auv1.x"] < 3:
            keeper.tick(time.monotonic())
            assert time.monotonic() < until, said
            time.sleep(0.02)
    finally:
        keeper.stop()
    assert sum("log files cannot be written" in text for text in said) == (fault != "deleted")


@pytest.mark.ros
@pytest.mark.parametrize("fault", ["read-only", "deleted", "full"])
def test_safety_node_starts_first(medium: Path, tmp_path: Path, fault: str) -> None:
    break_medium(medium, fault)
    file = tmp_path / "p.yaml"
    polygon = "[-50.0, -50.0, 350.0, -50.0, 350.0, 350.0, -50.0, 350.0]"
    file.write_text(f"/**: {{ros__parameters: {{mission: {{vehicles: 1}}, area: {{polygon_m: {polygon}}}}}}}")
    environment = {**os.environ, "ROS_DOMAIN_ID": "104", "AUV_LSE_JOURNAL": str(medium / "journal")}
    environment.pop("HOME", None)
    said: list[str] = []
    keeper = ProcessKeeper([node_task(SAFETY, file), node_task(GP, file)], medium / "logs", environment, said.append)
    try:
        until = time.monotonic() + 120.0
        while len(keeper.running) < 2:
            assert not keeper.tick(time.monotonic()), said
            assert time.monotonic() < until, said
            time.sleep(0.02)
        steady = time.monotonic() + 3.0
        while time.monotonic() < steady:
            assert not keeper.tick(time.monotonic()), said
            time.sleep(0.02)
    finally:
        keeper.stop()
    started = [text for text in said if " started, process " in text]
    assert [text.split()[0] for text in started] == ["auv1.safety_node", "auv1.gp_node"]
