"""What the process of a node's executable does before anything else."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

pytestmark = pytest.mark.ros

_NODE = """\
import sys
from importlib import import_module

started = import_module("auv_lse_common.node.executable")
print("importing", flush=True)
from auv_lse_planner.safety_node import main

sys.exit(main())
"""


def test_sigint_during_the_start_leaves_no_traceback(tmp_path: Path) -> None:
    """What `ros2 run auv_lse_planner safety_node` starts is interrupted ever later: within imports, and after them."""
    script = tmp_path / "safety_node"
    script.write_text(_NODE)
    command = [sys.executable, str(script), "--ros-args", "-r", "__ns:=/auv1", "-p", "mission.vehicles:=1"]
    environment = {**os.environ, "ROS_DOMAIN_ID": "80"}
    started = []
    for _ in range(5):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        started.append(subprocess.Popen(command, env=environment, **pipes))
    for process, delay_s in zip(started, (0.0, 0.1, 0.2, 0.4, 0.4), strict=True):
        assert process.stdout is not None
        assert process.stdout.readline() == "importing\n"
        time.sleep(delay_s)
        process.send_signal(signal.SIGINT)
    for process in started:
        output, _ = process.communicate(timeout=30)
        assert process.returncode == 0, output
        assert "Traceback" not in output


@pytest.mark.parametrize(
    ("polygon", "code", "shown"),
    [
        ("[0, 0, 600.5, 0, 600, 700]", 0, "ready after"),
        ("[0, 0, 600.5, 0, 600, 700", 2, "error: {file}: not valid YAML: line 4"),
        ("[0, 0, true, 0, 600, 700]", 2, "--params-file {file}'"),
    ],
)
def test_a_parameter_file_that_ros_cannot_read_is_rewritten_or_refused(
    tmp_path: Path, polygon: str, code: int, shown: str
) -> None:
    """ROS's YAML parser takes no list of whole numbers and decimals."""
    script, file = tmp_path / "safety_node", tmp_path / "vehicles.yaml"
    script.write_text(_NODE)
    file.write_text(f"/**:\n  ros__parameters:\n    mission: {{vehicles: 1}}\n    area: {{polygon_m: {polygon}}}\n")
    command = [sys.executable, str(script), "--ros-args", "--params-file", str(file), "-r", "__ns:=/auv1"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    process = subprocess.Popen(command, env={**os.environ, "ROS_DOMAIN_ID": "80"}, **pipes)
    assert process.stdout is not None
    wanted = shown.format(file=file)
    watchdog = threading.Timer(60.0, process.kill)
    watchdog.start()
    lines = []
    for line in process.stdout:
        lines.append(line)
        if wanted in line:
            process.send_signal(signal.SIGINT)
            break
    process.communicate(timeout=30)
    watchdog.cancel()
    assert wanted in "".join(lines)
    assert process.returncode == code


@pytest.mark.parametrize(("name", "given", "threads"), [("a_node", None, "1"), ("a_node", "2", "2"), ("x", None, None)])
def test_a_nodes_linear_algebra_runs_on_one_thread(
    tmp_path: Path, name: str, given: str | None, threads: str | None
) -> None:
    script = tmp_path / name
    script.write_text(
        "import os\nimport auv_lse_common.node.executable\n"
        "print([os.environ.get(f'{library}_NUM_THREADS') for library in ('OMP', 'OPENBLAS')])\n"
    )
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    environment = {key: value for key, value in os.environ.items() if key not in names}
    environment |= dict.fromkeys(names, given) if given else {}
    shown = subprocess.run([sys.executable, str(script)], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == str([threads, threads])


@pytest.mark.parametrize(("name", "shown", "code"), [("a_node", "before\n", 3), ("x", "before\nafter\n", 0)])
def test_an_executable_leaves_without_taking_python_down(tmp_path: Path, name: str, shown: str, code: int) -> None:
    script = tmp_path / name
    script.write_text(
        "from auv_lse_common.node.executable import leave\nimport atexit\natexit.register(print, 'after')\n"
        "print('before')\nleave(3)\n"
    )
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.returncode) == (shown, code)


def test_every_node_imports_it_first() -> None:
    root = Path(__file__).resolve().parents[3]
    modules = [path for path in root.glob("auv_lse_*/auv_lse_*/**/*_node.py") if "\nmain = Main(" in path.read_text()]
    assert len(modules) >= 8
    for path in modules:
        imports = [line for line in path.read_text().splitlines() if line.startswith(("import ", "from "))]
        first = next(line for line in imports if not line.startswith("from __future__"))
        assert first.startswith("import auv_lse_common.node.executable  #"), path
