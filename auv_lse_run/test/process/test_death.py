"""Why processes die, in words."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from auv_lse_run.command.main import main
from auv_lse_run.process import death
from auv_lse_run.process.death import cause

_FILL = """
import mmap, os, sys
file = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT)
os.ftruncate(file, 8 * 2**20)
mapped = mmap.mmap(file, 8 * 2**20)
for page in range(0, 8 * 2**20, 4096):
    mapped[page] = 1
"""


def test_a_bus_error_on_a_full_file_system_in_memory_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(tmp_path)], capture_output=True, text=True
    )
    if done.returncode:
        pytest.skip(f"this process may mount nothing: {done.stderr.strip()}")
    monkeypatch.setattr(death, "_SHARED", tmp_path)
    try:
        code = subprocess.run([sys.executable, "-c", _FILL, str(tmp_path / "segment")]).returncode
        assert code == -signal.SIGBUS
        full = f"{tmp_path}, which DDS needs, is full (0 kB of 1 MB free); remove files there, or make it larger"
        assert cause(code) == f"SIGBUS: {full}"
        main(["abort", "auv1", "--domain", "x"])
        assert capsys.readouterr().err.startswith(f"warning: {full}\n"), "loading ROS may end this process"
        (tmp_path / "segment").unlink()
        assert "became shorter" in cause(code)
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_killed_process(monkeypatch: pytest.MonkeyPatch) -> None:
    assert cause(-9, hung=True) == "SIGKILL: the watchdog killed it"
    monkeypatch.setattr(death, "_memory", lambda: {"MemTotal": 4_000_000, "MemAvailable": 80_000})
    assert cause(-9) == "SIGKILL: the computer has no memory left (78 of 3906 MB)"
    monkeypatch.setattr(death, "_memory", dict)
    assert "another program" in cause(-9)


@pytest.mark.parametrize("number", signal.Signals)
def test_every_signal_has_its_name(number: signal.Signals) -> None:
    assert cause(-number.value).startswith(number.name)


def test_codes() -> None:
    assert cause(3) == "exit code 3"
    assert cause(2) == "exit code 2: it rejects its parameters"
    assert cause(-40) == "signal 40"
    assert shutil.disk_usage(death._SHARED).total, "a folder of this computer"
