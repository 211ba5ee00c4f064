"""ROS's log files are left out where they cannot be written."""

from __future__ import annotations

from pathlib import Path

import pytest

from auv_lse_common.support import ros_logs
from auv_lse_common.support.ros_logs import init_arguments, log_folder

WITHOUT = ["--ros-args", "--disable-external-lib-logs"]


def test_the_folder_is_that_of_rcl(tmp_path: Path) -> None:
    assert log_folder({"ROS_LOG_DIR": "/a", "ROS_HOME": "/b"}) == Path("/a")
    assert log_folder({"ROS_HOME": "/b"}) == Path("/b/log")
    assert log_folder({}) == Path("~/.ros/log").expanduser()


def test_log_files_are_left_out_where_they_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good = {"ROS_LOG_DIR": str(tmp_path / "new" / "log")}
    assert init_arguments(["node", "--ros-args"], good) == ["node", "--ros-args"]
    (tmp_path / "file").touch()
    assert init_arguments(["node"], {"ROS_LOG_DIR": str(tmp_path / "file")}) == ["node", *WITHOUT]

    def full(**words: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ros_logs.tempfile, "TemporaryFile", full)
    assert init_arguments([], good) == WITHOUT
