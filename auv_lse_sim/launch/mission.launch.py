"""ros2 launch auv_lse_sim mission.launch.py params_file:=MISSION.yaml: the processes of a mission.

Sets ROS_DOMAIN_ID for the nodes: to a free domain, unless the environment names one from 1 to 80.

The same list that auv_lse mission starts (auv_lse_sim.engine.processes). Every node gets the whole file, with every
default filled in, as mission.yaml in the run folder `out`; the recording goes there too, wherever params_file has it.
"""

import atexit
import importlib.util
import sys
from contextlib import ExitStack
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, LogInfo, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.support.confinement import confined, watch_variables
from auv_lse_common.support.installed_copy import COPY_VARIABLE, note_software, own_copy
from auv_lse_run.process.domain import ONE_THREAD, dive_on, simulation_domain, wanted_domain
from auv_lse_run.process.processes import LAST_STOP_S
from auv_lse_sim.engine.hardware import hardware_of
from auv_lse_sim.engine.processes import mission_processes
from auv_lse_sim.ground.ground_source import shared_ground

#: Launch argument, the parameter that it sets where it is not empty, and how its text becomes the value.
_OVERRIDES = (("vehicles", "mission.vehicles", int), ("steps", "mission.steps", int), ("seed", "mission.seed", int))

#: Time (s) for the report of a long mission of many vehicles.
_REPORT_S = 900

#: The reserved ROS domain, until the launch ends.
_RESERVED = ExitStack()
atexit.register(_RESERVED.close)


def _nodes(context):
    def value(name):
        return LaunchConfiguration(name).perform(context)

    path, folder = Path(value("params_file")).resolve(), Path(value("out")).resolve()
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"out:={folder} is not empty, and was left as it is. Choose a new or empty folder")
    record = _truth("record", value("record"))
    wanted = {name: kind(value(argument)) for argument, name, kind in _OVERRIDES if value(argument)}
    if value("real_time_factor"):
        wanted |= {"sim.real_time_factor": float(value("real_time_factor")), "sim.lockstep": False}
    wanted |= {"sim.shutdown_at_end": True, "record.folder": str(folder / "bag") if record else ""}
    settings = Settings.load(path, wanted)
    modem, link = value("modem"), value("vehicle_link")
    settings = settings.with_overrides(hardware_of(modem, link, settings, folder))
    domain = _RESERVED.enter_context(simulation_domain(wanted_domain(None), folder))
    variables = confined(domain) | {DIVE_VARIABLE: dive_on(domain), COPY_VARIABLE: own_copy(), **ONE_THREAD}
    variables |= _RESERVED.enter_context(shared_ground())
    print(f"to watch from another terminal: export {watch_variables(domain)}")
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    note_software(folder)
    complete = folder / "mission.yaml"
    complete.write_text(settings.to_parameter_file())
    nodes = [
        Node(
            package=process.package,
            executable=process.executable,
            namespace=process.namespace,
            parameters=[str(complete), {"use_sim_time": process.executable != "sim_node"}],
            output="screen",
            additional_env=variables,
            **({"sigterm_timeout": str(LAST_STOP_S)} if process.last else {}),
            # The simulator ends the mission; without one of its nodes a mission cannot go on.
            on_exit=[EmitEvent(event=Shutdown(reason=f"{process.name} ended"))],
        )
        for process in mission_processes(settings.mission.vehicles, modem, link, record)
    ]
    return [*nodes, _report_of(folder, variables)]


def _report_of(folder, variables):
    """The process that shows the progress and, at the end, makes the report."""
    if importlib.util.find_spec("auv_lse_shore") is None:
        return LogInfo(msg="no progress and no report: the package auv_lse_shore, which makes them, is not installed")
    command = [sys.executable, "-m", "auv_lse_shore.mission.launched", str(folder)]
    # Shutdown sends SIGINT, upon which the report is made. It ends before that when the simulator stops the mission.
    return ExecuteProcess(
        cmd=command,
        name="mission",
        output="screen",
        additional_env=variables,
        sigterm_timeout=str(_REPORT_S),
        on_exit=[EmitEvent(event=Shutdown(reason="the mission's display ended"))],
    )


def _truth(name, text):
    if text.lower() not in ("true", "false"):
        raise ValueError(f"{name} must be true or false, not {text}")
    return text.lower() == "true"


def generate_launch_description():
    """The launch description."""
    default = Path(get_package_share_directory("auv_lse_sim")) / "missions" / "default.yaml"
    arguments = {
        "params_file": (str(default), "mission file (ROS 2 parameter file)"),
        "out": ("run", "run folder to make: recording and complete mission file"),
        "vehicles": ("", "number of vehicles, 1 to 20; empty: as in the mission file"),
        "steps": ("", "number of legs per vehicle; empty: as in the mission file"),
        "seed": ("", "seed of every random stream; empty: as in the mission file"),
        "real_time_factor": ("", "speed in multiples of real time; empty: lockstep, as fast as possible"),
        "record": ("true", "true: record in the run folder; false: no recording"),
        "modem": ("direct", "direct, or emulated: through serial ports, drivers and Micromodem-2 sentences"),
        "vehicle_link": ("direct", "direct, or mavlink: through simulated MAVLink autopilots"),
    }
    declared = [
        DeclareLaunchArgument(name, default_value=text, description=meaning)
        for name, (text, meaning) in arguments.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])
