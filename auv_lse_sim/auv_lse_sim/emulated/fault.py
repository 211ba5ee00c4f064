"""How a simulated autopilot misbehaves."""

import enum


class Fault(enum.Enum):
    """How a simulated autopilot fails to carry out what it is sent."""

    NONE = "none"
    REFUSES = "refuses every mission and command, and follows no position target"
    IGNORES = "accepts everything and follows nothing new"
    NEVER_STOPS = "follows its targets, except for stops"
