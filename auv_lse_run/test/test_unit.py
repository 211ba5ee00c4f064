"""The systemd unit: what systemd says of it, and its command in the unit's environment, for each way to set up."""

from __future__ import annotations

import configparser
import importlib.util
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from auv_lse_run.shipped_files import shipped_file

ROOT = Path(__file__).resolve().parents[2]
UNIT = shipped_file("auv_lse@.service")
#: What systemd sets for a service with User=, here without a home.
SYSTEMD = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/nonexistent",
    "USER": "auv",
}
PARAMETERS = """\
/**:
  ros__parameters:
    mission: {vehicles: 2, steps: 20}
/auv2/**:
  ros__parameters:
    vehicle: {start: at_once}
"""


class _Unit(configparser.ConfigParser):
    def optionxform(self, optionstr: str) -> str:
        return optionstr


def service() -> tuple[list[str], dict[str, str]]:
    """ExecStart for auv2, and the environment, as systemd makes them of the unit."""
    text = "".join(line for line in UNIT.read_text().splitlines(True) if not line.startswith("#"))
    unit = _Unit(interpolation=None, delimiters=("=",), strict=False)
    unit.read_string(text.replace("\\\n", " "))
    words = shlex.split(unit["Service"]["ExecStart"].replace("%i", "auv2"))
    variables = dict(word.split("=", 1) for word in unit["Service"]["Environment"].split())
    return [word.replace("$$", "$") for word in words], SYSTEMD | variables


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_finds_nothing_wrong(tmp_path: Path) -> None:
    copy = tmp_path / "auv_lse@auv2.service"
    shutil.copy(UNIT, copy)
    done = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_unit_starts_no_set_up() -> None:
    for script in ("auv_lse", "vehicle"):
        text = (ROOT / "scripts" / script).read_text() if (ROOT / "scripts" / script).exists() else ""
        assert "use_environment " not in text
        assert "run_module" not in text
    words, _ = service()
    assert "scripts/setup" not in words[2].replace("(made by scripts/setup)", "")


def test_an_empty_folder_is_one_line(tmp_path: Path) -> None:
    words, environment = service()
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2, "which the unit does not restart"
    assert (
        done.stderr
        == f"error: {tmp_path} has neither .venv (made by scripts/setup) nor install/setup.bash (made by colcon)\n"
    )


def checkout(folder: Path) -> Path:
    """A checkout that shares all files with this one, with a .venv of its own that shares Python's."""
    for path in ROOT.iterdir():
        if path.name in ("scripts", "config", "ros_ws") or path.name.startswith("auv_lse_"):
            (folder / path.name).symlink_to(path)
    (folder / "scripts").unlink()
    shutil.copytree(ROOT / "scripts", folder / "scripts")
    (folder / ".venv").mkdir()
    for path in Path(sys.prefix).iterdir():
        if path.suffix != ".done":
            (folder / ".venv" / path.name).symlink_to(path)
    return folder


def with_sourced_ros(folder: Path) -> Path:
    """The same, set up where a ROS 2 was sourced: its setup.bash is in the chain of the workspace's."""
    checkout(folder)
    (folder / ".venv" / "pyvenv.cfg").unlink()
    text = (Path(sys.prefix) / "pyvenv.cfg").read_text()
    (folder / ".venv" / "pyvenv.cfg").write_text(text.replace("packages = false", "packages = true"))
    (folder / "ros_ws").unlink()
    (folder / "ros_ws" / "install").mkdir(parents=True)
    install, ros = ROOT / "ros_ws" / "install", f"export ROS_DISTRO=jazzy AMENT_PREFIX_PATH={sys.prefix}\n"
    (folder / "ros_ws" / "install" / "local_setup.bash").write_text(f". {install / 'local_setup.bash'}\n")
    (folder / "ros_ws" / "install" / "setup.bash").write_text(f"{ros}. {install / 'local_setup.bash'}\n")
    return folder


def built_by_colcon(folder: Path) -> Path:
    """An installed workspace alone; the environment of the ROS 2 below it is that of these wheels."""
    (folder / "install").mkdir()
    install = ROOT / "ros_ws" / "install"
    ros = f"export ROS_DISTRO=jazzy AMENT_PREFIX_PATH={sys.prefix} PATH={sys.prefix}/bin:$PATH\n"
    (folder / "install" / "setup.bash").write_text(f"{ros}. {install / 'setup.bash'}\n")
    return folder


@pytest.mark.ros
@pytest.mark.skipif(
    importlib.util.find_spec("rclpy") is None or not (ROOT / "ros_ws" / "install").is_dir(),
    reason="needs rclpy and the built workspace (scripts/test sets both up)",
)
@pytest.mark.parametrize("set_up", [checkout, with_sourced_ros, built_by_colcon])
def test_the_unit_starts_a_vehicle_that_waits(set_up, tmp_path: Path) -> None:
    home = tmp_path / "opt"
    home.mkdir()
    set_up(home)
    file = tmp_path / "vehicles.yaml"
    file.write_text(PARAMETERS)
    words, environment = service()
    words[words.index("/etc/auv_lse/vehicles.yaml")] = str(file)
    log = tmp_path / "log"
    with own_domain(VEHICLE_DOMAINS) as domain, log.open("w") as output:
        environment |= {"ROS_DOMAIN_ID": str(domain), "AUV_LSE_ROOT": str(home), "STATE_DIRECTORY": str(tmp_path)}
        process = subprocess.Popen(
            words, cwd=home, env=environment, stdout=output, stderr=output, start_new_session=True
        )
        try:
            state, until = "", time.monotonic() + 60.0
            ask = [sys.executable, "-m", "auv_lse_run", "state", "--domain", str(domain)]
            while "auv2" not in state:
                assert process.poll() is None, log.read_text()
                assert time.monotonic() < until, log.read_text() + state
                state = subprocess.run(ask, capture_output=True, text=True, check=False).stdout
            process.send_signal(signal.SIGTERM)
            assert process.wait(30.0) == 0, log.read_text()
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    text = log.read_text()
    assert "WAITING" in state, "the file says at_once"
    assert "setup:" not in text, "nothing is set up at boot"
    assert (home / "dives").is_dir()
