"""A node imports what it uses and no more: the start of a vehicle is little else than imports."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

import auv_lse_comms
import auv_lse_gp
import auv_lse_planner
import auv_lse_record

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = tuple(
    f"auv_lse_{name}" for name in ("common", "gp", "planner", "comms", "mavlink", "record", "sim", "shore")
)

#: What nobody needs to draw, fit or compile with on a vehicle.
NEVER = {"matplotlib", "pandas", "dask", "sklearn", "rasterio", "auv_lse_shore"}
COMMS = {"scipy", "numba", "rosbags", "contourpy", "auv_lse_gp", "auv_lse_planner", "auv_lse_sim"}
UNUSED = {
    "auv_lse_comms.modem_node": COMMS | {"serial", "auv_lse_mavlink"},
    "auv_lse_comms.micromodem.micromodem_node": COMMS | {"auv_lse_mavlink"},
    "auv_lse_mavlink.vehicle_link_node": COMMS | {"serial"},
    "auv_lse_gp.gp_node": {
        "numba",  # loaded when the first sounding comes
        "scipy.optimize",
        "scipy.interpolate",
        "rosbags",
        "auv_lse_comms",
        "auv_lse_planner",
        "auv_lse_sim",
    },
    "auv_lse_planner.planner_node": {"scipy.interpolate", "rosbags", "auv_lse_comms", "auv_lse_sim"},
    "auv_lse_sim.engine.sim_node": {"auv_lse_mavlink", "pymavlink"},
    "auv_lse_record.recorder_node": {"scipy.optimize", "scipy.interpolate", "numba", "auv_lse_comms"},
}

#: Each node is imported in a process forked for it, so that what all need is loaded once.
CODE = """
import importlib, json, os, sys
import numpy, rclpy
for name in sys.argv[1:]:
    sys.stdout.flush()
    if os.fork() == 0:
        importlib.import_module(name)
        print(json.dumps([name, sorted(sys.modules)]))
        sys.stdout.flush()
        os._exit(0)
    assert os.wait()[1] == 0, name
"""


def test_a_node_imports_nothing_that_it_does_not_use() -> None:
    command = [sys.executable, "-c", f"import sys; sys.path[:0] = {[str(ROOT / p) for p in PACKAGES]}\n{CODE}", *UNUSED]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for line in done.stdout.splitlines():
        node, modules = json.loads(line)
        assert not (UNUSED[node] | NEVER) & set(modules), node


@pytest.mark.parametrize("package", [auv_lse_comms, auv_lse_gp, auv_lse_planner, auv_lse_record])
def test_a_face_gives_every_name_that_it_offers_and_no_other(package: object) -> None:
    for name in package.__all__:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'no_such_name'"):
        package.no_such_name  # noqa: B018 (reading it is the test)
