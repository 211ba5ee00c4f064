"""The nodes of a vehicle start without what only simulation, campaigns and reports need; what is missing is named."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys

import pytest

from auv_lse_common.support.missing_packages import MissingPackageError, missing

#: What a vehicle does without: not installed by apt for it, or not by apt at all.
ABSENT = (
    "numba", "llvmlite", "matplotlib", "mcap", "mcap_ros2", "pymavlink", "rosbags", "dask", "distributed", "pyarrow",
    "rasterio", "rich", "shapely", "sklearn", "contourpy", "pyproj",
)  # fmt: skip

BLOCKER = f"""
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        return None if name.split(".")[0] in {ABSENT!r} else self.finder.find_spec(name, path, target)
sys.meta_path[:] = map(Without, sys.meta_path)
"""

#: What a vehicle has: from Ubuntu's apt, from ROS's own packages, and from pip what pymavlink brings with it.
PRESENT = (
    "numpy", "scipy", "cython_runtime", "yaml", "serial",
    "rclpy", "ament_index_python", "rosidl_parser", "rosidl_pycommon", "rpyutils", "lark",
    "pymavlink", "lxml", "fastcrc",
)  # fmt: skip

NODES = (
    "auv_lse_gp.gp_node", "auv_lse_planner.planner_node", "auv_lse_comms.modem_node",
    "auv_lse_comms.micromodem.micromodem_node", "auv_lse_planner.safety_node", "auv_lse_record.recorder_node",
    "auv_lse_run.vehicle.run_vehicle",
)  # fmt: skip
LINK = "auv_lse_mavlink.vehicle_link_node"  # the one that pymavlink is for


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BLOCKER + code], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.ros
def test_a_vehicles_nodes_start_without_them() -> None:
    if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
        pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)")
    process = python("\n".join(f"import {name}" for name in NODES))
    assert process.returncode == 0, process.stderr


@pytest.mark.ros
def test_a_vehicles_nodes_load_what_apt_has_and_pymavlink_alone() -> None:
    if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
        pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)")
    imports = "\n".join(f"import {name}" for name in (*NODES, LINK))
    code = f"import sys\nbefore = set(sys.modules)\n{imports}\nprint(*(set(sys.modules) - before))"
    environment = {**os.environ, "AUV_LSE_NUMBA": "0"}
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False, env=environment
    )
    assert process.returncode == 0, process.stderr
    loaded = {name.split(".")[0] for name in process.stdout.split()} - {*sys.stdlib_module_names, *PRESENT}
    own = ("auv_lse_", "_")  # "_": parts of compiled packages
    assert {n for n in loaded if not n.startswith(own) and not n.endswith(("_msgs", "_interfaces"))} == set()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (
            "import auv_lse_mavlink.messages.wire",
            "MAVLink links (vehicle_link_node, emulated autopilots) need the Python package pymavlink, which is not "
            "installed: pip install pymavlink",
        ),
        (
            "import auv_lse_shore.campaign.rows",
            "campaigns need the Python package pyarrow, which is not installed: pip",
        ),
        (
            "from auv_lse_record.bag_writer import message_types; message_types([])",
            "recording needs the Python package rosbags, which is not installed: pip install rosbags",
        ),
    ],
)
def test_a_missing_package_is_named_with_the_command_that_installs_it(code: str, words: str) -> None:
    process = python(code)
    assert process.returncode == 1
    assert words in process.stderr


def test_a_package_without_a_command_of_its_own() -> None:
    error = missing(ModuleNotFoundError("No module named 'x.y'", name="x.y"), "charts")
    assert isinstance(error, MissingPackageError)
    assert str(error) == "charts need the Python package x, which is not installed: pip install x"
