"""The id of a dive or a simulation, by which nodes know the messages of their own mission.

An entry point begins a dive and names it in the environment of its nodes, "auv2-1123-184534-3f2a" for a vehicle's and
"sim-1123-184534-3f2a" for a simulation's. Nodes prefix the frame in the header of each message with it, as the frames
of several robots are prefixed: "sim-1123-184534-3f2a/map". Nodes that were started by hand have the id "".
"""

from __future__ import annotations

import os
import re
import secrets
from datetime import datetime

#: The environment variable that carries the id to a mission's nodes.
DIVE_VARIABLE = "AUV_LSE_DIVE"
#: Kind of the id of a simulation.
SIMULATION = "sim"
_ID = re.compile(r"(sim|auv\d+)-\d{4}-\d{6}-[0-9a-f]{4}")


def new_dive(kind: str) -> str:
    """A new id.

    Args:
        kind: `SIMULATION`, or the vehicle's name, "auv2".
    """
    return f"{kind}-{datetime.now():%m%d-%H%M%S}-{secrets.token_hex(2)}"


def own_dive() -> str:
    """The id of this process's dive; "" if its entry point named none."""
    return os.environ.get(DIVE_VARIABLE, "")


def tagged_frame(dive: str, frame: str) -> str:
    """The name of a frame in a header, with the id of the dive.

    Args:
        dive: The id; "": the frame stays as it is.
        frame: The frame, such as "map".
    """
    return f"{dive}/{frame}" if dive else frame


def dive_of(frame_id: str) -> str:
    """The id of the dive in a header's frame; "" if it has none."""
    prefix, separator, _ = frame_id.partition("/")
    return prefix if separator and _ID.fullmatch(prefix) else ""


def is_simulation(dive: str) -> bool:
    """Whether an id is that of a simulation."""
    return dive.startswith(f"{SIMULATION}-")
