"""auv_lse fleet starts, commands and ends the nodes of a vehicle, over SSH; its laptop sees their state."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from auv_lse_run.command.main import main
from auv_lse_run.process.domain import own_domain
from auv_lse_shore.remote.checking import utc_s
from auv_lse_shore.remote.ledger_file import LedgerFile
from benchmarks.field.sshd import Field, lacks_sshd, side_command

pytestmark = [pytest.mark.ros, pytest.mark.mission, pytest.mark.skipif(bool(lacks_sshd()), reason=lacks_sshd())]

#: Neither modem nor autopilot: four nodes.
MISSION = """\
/**:
  ros__parameters:
    mission: {vehicles: 1, steps: 4}
    modem: {kind: direct}
    link: {kind: direct}
    vehicle: {start: on_call}
"""


def test_a_dive_from_start_to_stop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = Field(tmp_path / "field")
    (tmp_path / "vehicles.yaml").write_text(MISSION)
    with made.computer("auv1") as computer:
        made.trust("auv1", computer.port)
        command = f"XDG_STATE_HOME={tmp_path} {side_command()}"  # its own second copies of the mission's state
        with own_domain(range(202, 225)) as free:  # let go at once: the vehicle takes it
            vehicle = {"port": computer.port, "folder": str(computer.folder), "command": command, "domain": free}

        def fleet(*words: str) -> tuple[int, str]:
            code = main(["fleet", str(made.fleet_file({"auv1": vehicle})), *words])
            return code, "".join(capsys.readouterr())

        (tmp_path / "rejected.yaml").write_text(MISSION + "    gp: {noise_std_m: -3.0}\n")
        (computer.folder / "mission.yaml").write_bytes((tmp_path / "rejected.yaml").read_bytes())
        code, text = fleet("start")
        assert code == 1
        assert "did not start: error: " in text
        assert "gp.noise_std_m must be a number above 0" in text
        assert fleet("send", str(tmp_path / "vehicles.yaml"))[0] == 0
        code, text = fleet("go", "--anyway")
        assert code == 1
        assert "GO refused" in text
        assert "its nodes do not run" in text
        try:
            assert fleet("start")[0] == 0
            assert "run already" in fleet("start")[1]
            end_s = time.monotonic() + 60.0
            while "WAITING" not in fleet("watch", "--once")[1]:
                assert time.monotonic() < end_s, "the nodes have not started"
            code, text = fleet("send", str(tmp_path / "vehicles.yaml"))
            assert code == 1
            assert "a dive is running" in text
            with LedgerFile(made.fleet_file({"auv1": vehicle})).changed() as ledger:  # out of reach
                ledger.give("auv1", "go", utc_s())
            assert main(["hold", "1", "--domain", str(free)]) == 0
            code, text = fleet("pending")
            assert "GO refused" in text
            assert "HOLD was given after it" in text
            assert "HOLD acted" in fleet("hold")[1]
            assert "ABORT acted" in fleet("abort")[1]
            code, text = fleet("go", "--anyway")
            assert "RESET first" in text
            assert "ABORTED" in fleet("watch", "--once")[1]
        finally:
            assert fleet("stop")[0] == 0
        assert "nodes do not run" in fleet("watch", "--once")[1]
