"""Work run_in_background other work: its result, its error, its end."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from auv_lse_run.process import background as module
from auv_lse_run.process.background import run_in_background


@pytest.mark.parametrize("cores", [1, 2])
def test_result_is_returned(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.os, "cpu_count", lambda: cores)
    rest = run_in_background(lambda: (os.getpid(), list(range(100_000))))
    pid, numbers = rest()
    assert numbers == list(range(100_000)), "more than a pipe holds"
    assert (pid == os.getpid()) == (cores == 1)


def test_error_is_raised_when_the_result_is_requested(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.os, "cpu_count", lambda: 2)
    rest = run_in_background(lambda: (tmp_path / "no" / "such").write_text("x"))
    with pytest.raises(FileNotFoundError, match="such"):
        rest()


def test_killed_process_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.os, "cpu_count", lambda: 2)
    rest = run_in_background(lambda: os.kill(os.getpid(), signal.SIGKILL))
    with pytest.raises(RuntimeError, match="ended with exit code -9 and without a result"):
        rest()
