"""Recordings: written on the vehicle, read back and recovered anywhere.

The names below are the library's interface. They need no ROS.
"""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_record.recording import RecordedTopic, RecordedValue, Recording, RecordingError
    from auv_lse_record.run_reader import read_bag, read_run

__all__ = [
    "RecordedTopic",
    "RecordedValue",
    "Recording",
    "RecordingError",
    "read_bag",
    "read_run",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "recording": ("RecordedTopic", "RecordedValue", "Recording", "RecordingError"),
        "run_reader": ("read_bag", "read_run"),
    },
)
