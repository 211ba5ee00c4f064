"""ros2 launch auv_lse_run vehicle.launch.py name:=auv2 params_file:=vehicles.yaml: the nodes of one vehicle.

The same nodes that auv_lse vehicle keeps running (auv_lse_run.vehicle.run_vehicle). A node that dies is restarted
after two seconds. The vehicle's ROS domain is that of ROS_DOMAIN_ID, else 0.
"""

import atexit
from contextlib import ExitStack
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from auv_lse_common.support.confinement import confined
from auv_lse_run.process.processes import LAST_STOP_S, RECORDER
from auv_lse_run.vehicle.run_vehicle import begin_dive, open_dive, vehicle_processes

#: The reserved ROS domain, until the launch ends.
_RESERVED = ExitStack()
atexit.register(_RESERVED.close)


def _nodes(context):
    def value(name):
        return LaunchConfiguration(name).perform(context)

    if not value("name") or not value("params_file"):
        raise ValueError("expected name:=auv2 params_file:=vehicles.yaml (ros2 launch ... --show-args lists them)")
    file, simulated = Path(value("params_file")).resolve(), _truth("simulated", value("simulated"))
    wanted_out = Path(value("out")) if value("out") else None
    record, out = open_dive(value("name"), file, wanted_out, Path("dives"), simulated)
    recorded = None if not value("record") else _truth("record", value("record"))
    processes = vehicle_processes(value("name"), file, out, simulated, recorded)
    common = {"output": "screen", "respawn": not processes.lockstep, "respawn_delay": 2.0}
    domain, dive = _RESERVED.enter_context(begin_dive(processes, None, file, out, record))
    dive = confined(domain) | dive
    nodes = [
        Node(
            package=process.package,
            executable=process.executable,
            namespace=process.namespace,
            parameters=[str(processes.file), {"use_sim_time": processes.simulated}],
            additional_env=dive,
            **common,
        )
        for process in processes.nodes
    ]
    if processes.recording is not None:
        out.mkdir(parents=True, exist_ok=True)
        recorder = {"package": RECORDER.package, "executable": RECORDER.executable, **common}
        files = [str(processes.file), {"record.folder": str(processes.recording)}]
        nodes.insert(0, Node(**recorder, parameters=files, additional_env=dive, sigterm_timeout=str(LAST_STOP_S)))
    return nodes


def _truth(name, text):
    if text.lower() not in ("true", "false"):
        raise ValueError(f"{name} must be true or false, not {text}")
    return text.lower() == "true"


def generate_launch_description():
    """The launch description."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("name", default_value="", description="the vehicle, such as auv2"),
            DeclareLaunchArgument("params_file", default_value="", description="the mission's parameter file"),
            DeclareLaunchArgument(
                "out", default_value="", description="folder of the recording; empty: dives/DATE-TIME-NAME"
            ),
            DeclareLaunchArgument(
                "record",
                default_value="",
                description="true or false; empty: if the file sets record.folder and no simulator records",
            ),
            DeclareLaunchArgument(
                "simulated", default_value="false", description="true: follow a simulator even without a section sim"
            ),
            OpaqueFunction(function=_nodes),
        ]
    )
