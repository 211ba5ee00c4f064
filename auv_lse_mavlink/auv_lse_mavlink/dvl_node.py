"""Heights of a Doppler velocity log (DVL) that another node drives: `marine_acoustic_msgs/Dvl` on the topic `dvl`.

The message package is not on PyPI; where it is not installed, nothing is subscribed to. The DVL's velocity is not used:
an autopilot with a DVL has it in its estimate.
"""

import importlib
import math
from collections.abc import Callable
from typing import Any

from auv_lse_common.topics.quality import NEWEST
from auv_lse_common.topics.records import Altitude

_PACKAGE = "marine_acoustic_msgs.msg"
#: A height needs as many good beams.
LEAST_BEAMS = 3


def altitude_of(message: Any) -> Altitude:
    """The height over ground of a `Dvl` message; NaN while it tracks water, or sees the ground with too few beams."""
    sees_ground = message.velocity_mode != message.DVL_MODE_WATER and message.num_good_beams >= LEAST_BEAMS
    valid = sees_ground and math.isfinite(message.altitude) and message.altitude > 0.0
    return Altitude(
        stamp_s=message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec,
        altitude_m=float(message.altitude) if valid else math.nan,
        min_m=0.0,
        max_m=math.inf,
    )


def listen_to_dvl(node: Any, take: Callable[[Altitude], None]) -> bool:
    """Calls `take` with the height in each message on `dvl`; returns whether the message package is installed."""
    try:
        kind = importlib.import_module(_PACKAGE).Dvl
    except ImportError:
        return False
    node.create_subscription(kind, "dvl", lambda message: take(altitude_of(message)), NEWEST)
    return True
