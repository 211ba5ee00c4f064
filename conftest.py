"""Imports the packages before pytest does: in importlib mode it would take the folders of the same names for them."""

import auv_lse_common
import auv_lse_comms
import auv_lse_gp
import auv_lse_mavlink
import auv_lse_planner
import auv_lse_record
import auv_lse_shore
import auv_lse_sim

__all__ = [
    "auv_lse_common",
    "auv_lse_comms",
    "auv_lse_gp",
    "auv_lse_mavlink",
    "auv_lse_planner",
    "auv_lse_record",
    "auv_lse_shore",
    "auv_lse_sim",
]
