"""ros2 launch auv_lse_sim mission.launch.py params_file:=MISSION.yaml: the processes of a mission.

The same list that scripts/mission starts (auv_lse_sim.engine.processes). Every node gets the whole file, with every
default filled in, as mission.yaml in the run folder `out`; the recording goes there too, wherever params_file has it.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from auv_lse_sim.engine.hardware import hardware_of
from auv_lse_sim.engine.processes import mission_processes
from auv_lse_sim.settings import Settings


def _nodes(context):
    path = Path(LaunchConfiguration("params_file").perform(context)).resolve()
    folder = Path(LaunchConfiguration("out").perform(context)).resolve()
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"out:={folder}: exists and is not empty; expected a new or empty folder (nothing was changed)"
        )
    settings = Settings.load(path, {"sim.shutdown_at_end": True, "record.folder": str(folder / "bag")})
    modem = LaunchConfiguration("modem").perform(context)
    link = LaunchConfiguration("vehicle_link").perform(context)
    settings = settings.with_overrides(hardware_of(modem, link, settings.mission.vehicles, folder))
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    complete = folder / "mission.yaml"
    complete.write_text(settings.to_parameter_file())
    return [
        Node(
            package=process.package,
            executable=process.executable,
            namespace=process.namespace,
            parameters=[str(complete), {"use_sim_time": process.executable != "sim_node"}],
            output="screen",
            # The simulator ends the mission; one node lost is the mission lost.
            on_exit=[EmitEvent(event=Shutdown(reason=f"{process.name} ended"))],
        )
        for process in mission_processes(settings.mission.vehicles, modem, link)
    ]


def generate_launch_description():
    """The launch description."""
    default = Path(get_package_share_directory("auv_lse_sim")) / "missions" / "default.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=str(default), description="mission file (ROS 2 parameter file)"
            ),
            DeclareLaunchArgument(
                "out", default_value="run", description="run folder to make: recording and complete mission file"
            ),
            DeclareLaunchArgument("modem", default_value="direct", description="direct or emulated"),
            DeclareLaunchArgument("vehicle_link", default_value="direct", description="direct or mavlink"),
            OpaqueFunction(function=_nodes),
        ]
    )
