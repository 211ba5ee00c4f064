"""The way to the surface and back down: straight above or below the vehicle.

ArduSub flies a straight line in space to its target. A vehicle that has drifted would rise along a slant, to where it
was when the target was chosen.
"""

import dataclasses

from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate


class VerticalWay:
    """Where the vehicle was when its vertical target was sent last."""

    def __init__(self) -> None:
        self._from: AutopilotEstimate | None = None
        self._depth_m = 0.0

    def target(self, target: Target, here: AutopilotEstimate | None, renewed: bool) -> Target:
        """A target straight above or below the vehicle, with its heading.

        Args:
            target: Gives the depth.
            here: The vehicle's position; None: unknown.
            renewed: Whether it is sent now, for the first time or again.
        """
        if here is not None and (renewed or self._from is None or target.depth_m != self._depth_m):
            self._from, self._depth_m = here, target.depth_m
        at = self._from
        if at is None:
            return target
        return dataclasses.replace(target, north_m=at.north_m, east_m=at.east_m, heading_rad=at.heading_rad)
