"""Packages that only some of the stack needs: how a missing one is named, with the command that installs it."""

from __future__ import annotations

#: The command for each, where ROS 2 is installed on Ubuntu; elsewhere `scripts/setup` installs them all.
COMMANDS = {
    "contourpy": "sudo apt install python3-contourpy",
    "dask": "pip install dask",
    "distributed": "pip install distributed",
    "jinja2": "sudo apt install python3-jinja2",
    "matplotlib": "sudo apt install python3-matplotlib",
    "pyarrow": "pip install pyarrow",
    "pymavlink": "pip install pymavlink",
    "pyproj": "sudo apt install python3-pyproj",
    "rasterio": "sudo apt install python3-rasterio",
    "rclpy": "source /opt/ros/jazzy/setup.bash, or scripts/setup",
    "rich": "sudo apt install python3-rich",
    "rosbags": "pip install rosbags",
    "serial": "sudo apt install python3-serial",
    "shapely": "sudo apt install python3-shapely",
}


class MissingPackageError(ImportError):
    """A package that is not installed: which, what needs it, and the command that installs it."""


def missing(error: ImportError, purpose: str) -> MissingPackageError:
    """The error to raise where a package that `purpose` needs could not be imported.

    Args:
        error: What the import raised.
        purpose: What needs the package, as the subject of a sentence: "figures".
    """
    name = (error.name or str(error)).split(".")[0]
    command = COMMANDS.get(name, f"pip install {name}")
    return MissingPackageError(
        f"{purpose} need the Python package {name}, which is not installed: {command}", name=name
    )
