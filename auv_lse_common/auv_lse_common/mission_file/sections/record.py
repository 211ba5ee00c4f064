"""The section `record` of a mission file."""

from auv_lse_common.mission_file.parameters import configuration, parameter


@configuration
class RecordConfig:
    """The recording of a mission."""

    folder: str = parameter("", help="rosbag2 folder to create; empty: no recording. It must not exist yet")
    flush_s: float = parameter(
        1.0,
        unit="s",
        above=0.0,
        high=3600.0,
        help="longest part of the recording that is lost if the recorder is killed",
    )
    map_bytes_per_s: float = parameter(
        14000.0,
        unit="B/s",
        low=0.0,
        high=1e9,
        help="bytes of maps recorded each second, for each vehicle, before compression; 0: every map, from which "
        "the decisions of a paced mission can be recomputed",
    )
    topics: tuple[str, ...] = parameter(
        (), help="full names of further topics to record; * stands for any text: [/imu, /camera/*]"
    )
    topics_mb: float = parameter(
        500.0,
        unit="MB",
        low=0.0,
        high=1e9,
        help="size of the messages of `topics`, before compression, beyond which they are not recorded, with a "
        "warning; 0: no limit",
    )
    least_free_mb: float = parameter(
        200.0,
        unit="MB",
        low=0.0,
        high=1e9,
        help="recording stops when the disk has less free space; the mission continues",
    )
