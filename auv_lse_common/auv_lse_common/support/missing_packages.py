"""Errors about optional packages that are missing, with the install command."""

import importlib.metadata
import importlib.util

from auv_lse_common.support.installed_copy import copy_of

#: Install commands for ROS 2 on Ubuntu; elsewhere `scripts/setup` installs all packages.
COMMANDS = {
    "PIL": "pip install pillow",
    "contourpy": "sudo apt install python3-contourpy",
    "cv2": "pip install opencv-python-headless",
    "dask": "pip install dask",
    "dateutil": "pip install python-dateutil",
    "distributed": "pip install distributed",
    "jinja2": "sudo apt install python3-jinja2",
    "matplotlib": "sudo apt install python3-matplotlib",
    "pyarrow": "pip install 'pyarrow<26'",
    "pymavlink": "pip install pymavlink",
    "pyproj": "sudo apt install python3-pyproj",
    "rasterio": "sudo apt install python3-rasterio",
    "rclpy": "source /opt/ros/jazzy/setup.bash, or scripts/setup",
    "rich": "sudo apt install python3-rich",
    "rosbags": "pip install rosbags",
    "serial": "sudo apt install python3-serial",
    "shapely": "sudo apt install python3-shapely",
    "yaml": "sudo apt install python3-yaml",
}
#: How to add a package of the stack, by the kind of the copy that runs.
_STACK = {
    "checkout": "link {} into ros_ws/src, then scripts/setup",
    "colcon": "copy {} into the workspace's src, then colcon build",
    "pip": "pip install {} (wheels: scripts/auv_lse wheels in a checkout); auv_lse_msgs comes with colcon build",
}


def is_installed(package: str) -> bool:
    """Whether a package can be imported; a folder of its name in the working directory does not count."""
    spec = importlib.util.find_spec(package)
    return spec is not None and (spec.origin is not None or _has_distribution(package))


def _has_distribution(package: str) -> bool:
    """Whether a package without a file of its own, such as rosbags, was installed by that name."""
    try:
        importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


class MissingPackageError(ImportError):
    """A package is not installed, or does not load; names its use and what is wrong, or the install command."""


def missing(error: ImportError, purpose: str) -> MissingPackageError:
    """The error to raise for a failed import.

    Args:
        purpose: Subject of the sentence "... need the Python package": "figures".
    """
    if not isinstance(error, ModuleNotFoundError):
        return MissingPackageError(f"{purpose} need a Python package that cannot be loaded: {error}", name=error.name)
    name = (error.name or str(error)).split(".")[0]
    return MissingPackageError(
        f"{purpose} need the Python package {name}, which is not installed: {install_command(name)}", name=name
    )


def install_command(package: str) -> str:
    """The command that installs a Python package; for one of the stack, by how the others were installed."""
    if package.startswith("auv_lse_"):
        copy = copy_of("auv_lse_common")
        return _STACK[copy.kind if copy is not None else "checkout"].format(package)
    return COMMANDS.get(package, f"pip install {package}")
