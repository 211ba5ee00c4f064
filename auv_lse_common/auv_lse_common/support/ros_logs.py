"""ROS's own log files: rclpy.init fails if their folder cannot be written, as on a read-only or full disk."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path


def init_arguments(arguments: Sequence[str] = (), environment: Mapping[str, str] | None = None) -> list[str]:
    """Arguments of `rclpy.init`: without ROS's log files if they cannot be written. The terminal has the same lines.

    Args:
        environment: Where the folder is named; None: this process's.
    """
    own, variables = list(arguments), os.environ if environment is None else environment
    is_known = any(variables.get(name) for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME"))  # rcl looks nowhere else
    if is_known and _can_write(log_folder(variables)):
        return own
    return [*own, "--ros-args", "--disable-external-lib-logs"]


def log_folder(environment: Mapping[str, str] | None = None) -> Path:
    """The folder of ROS's log files, as rcl chooses it."""
    variables = os.environ if environment is None else environment
    if folder := variables.get("ROS_LOG_DIR"):
        return Path(os.path.expanduser(folder))
    return Path(os.path.expanduser(variables.get("ROS_HOME") or "~/.ros")) / "log"


def _can_write(folder: Path) -> bool:
    """Whether files with content can be made in a folder, which is made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(b"x")
    except (OSError, RuntimeError):
        return False
    return True
