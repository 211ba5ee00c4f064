"""The verbs of this package."""

from auv_lse_common.support.verb import Verb

VERBS = (
    Verb("autopilot-check", "vehicle", "check an autopilot, or a simulated one, before the dive",
         "auv_lse_mavlink.check_command"),
)  # fmt: skip
