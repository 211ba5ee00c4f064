"""The process beside a mission of `ros2 launch`, with a stand-in for the mission's topics."""

from __future__ import annotations

import importlib.util
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.ending_signals import SIGNALS
from auv_lse_run.mission import conductor
from auv_lse_shore.mission import launched

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    before = {sign: signal.getsignal(sign) for sign in SIGNALS}
    yield
    for sign, handler in before.items():
        signal.signal(sign, handler)


def _run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, states: list[str], record: bool = True
) -> tuple[int, list[Any]]:
    """Exit code and reports of a mission that has these states in turn; "SIGINT" comes with one."""
    bag = tmp_path / "bag"
    wanted = {"record.folder": str(bag) if record else ""}
    settings = Settings.load(ROOT / "config" / "missions" / "default.yaml", wanted)
    (tmp_path / "mission.yaml").write_text(settings.to_parameter_file())
    (tmp_path / "logs").mkdir()
    reports: list[Any] = []

    class Watch:
        def __init__(self, progress: Any, environment: dict[str, str]) -> None:
            self._states = iter(states)

        def __enter__(self) -> Watch:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def wait(self, seconds: float) -> tuple[str, str]:
            state = next(self._states)
            if state.startswith("SIGINT"):
                os.kill(os.getpid(), signal.SIGINT)
                state = state.partition(" ")[2] or "running"
            return state, "tick 1: no answer for 60 s" if state == "failed" else ""

    def sleep(seconds: float) -> None:
        """The simulator ends, `ros2 launch` stops the others, and the recorder completes its folder."""
        assert not (bag / "metadata.yaml").exists()
        os.kill(os.getpid(), signal.SIGINT)
        bag.mkdir()
        (bag / "metadata.yaml").touch()

    def report(folder: Path, *_: Any, is_complete: bool) -> int:
        assert (folder / "logs" / "times.json").exists()
        assert (bag / "metadata.yaml").exists()
        with pytest.raises(KeyboardInterrupt):  # Ctrl-C interrupts the report
            signal.raise_signal(signal.SIGINT)
        reports.append(is_complete)
        return 0 if is_complete else 130

    monkeypatch.setattr(conductor, "MissionWatch", Watch)
    monkeypatch.setattr(launched, "report_mission", report)
    monkeypatch.setattr(launched.time, "sleep", sleep)
    return launched.main([str(tmp_path)]), reports


@pytest.mark.parametrize(
    ("states", "code", "reports"),
    [
        (["waiting", "running", "finished"], 0, [True]),
        (["waiting", "running", "SIGINT"], 130, [False]),
        (["waiting", "running", "SIGINT failed"], 130, [False]),  # all processes are ended at once, as in a shutdown
        (["waiting", "running", "SIGINT finished"], 0, [True]),
        (["waiting", "running", "failed"], 1, []),
    ],
)
def test_a_launched_mission_ends_with_a_report_of_what_was_recorded(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    states: list[str],
    code: int,
    reports: list[bool],
) -> None:
    assert _run(tmp_path, monkeypatch, states) == (code, reports)
    stopped = "error: the simulator stopped the mission: tick 1: no answer for 60 s"
    assert (stopped in capsys.readouterr().out) == (code == 1)


def test_without_a_recording_there_is_no_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(tmp_path, monkeypatch, ["running", "finished"], record=False) == (0, [])
    printed = capsys.readouterr().out
    assert "legs - of 100" in printed, "the progress"
    assert "record:=true" in printed
