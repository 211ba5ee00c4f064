"""The section `record` of a mission file."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordConfig:
    """Section `record`: where and how the recorder writes."""

    folder: str = parameter("", help="the rosbag2 directory to make; it must not exist yet")
    flush_s: float = parameter(
        1.0, unit="s", above=0.0, help="a recorder that is killed loses at most this much of the run, and the last gap"
    )
    least_free_mb: float = parameter(
        200.0, unit="MB", low=0.0, help="with less space left on the disk the recording ends, not the mission"
    )
