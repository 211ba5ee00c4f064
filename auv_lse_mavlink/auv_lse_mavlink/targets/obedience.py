"""Checks from a vehicle's motion whether its autopilot follows the target.

A vehicle follows its target if it is there, comes nearer, or turns. A stop is a target at the position where it was
ordered: a vehicle that stands or circles there obeys. A vehicle that does none of these for `IGNORED_S` ignores its
target. One that heads for its target without coming nearer, as in a strong head current, is reported as slow, and
ignores its target only after `SLOW_S` more. A jump of the estimate, which GPS or a positioning system may cause, counts
neither for nor against it.

target                  there                               counts as following
on a leg, GO_TO         within `acceptance_m`               coming nearer, turning
HOLD                    within `acceptance_m`, slow         coming nearer, turning near the position
at the surface          shallower than `AFLOAT_M`           rising
back at depth           within `AT_DEPTH_M` of it           diving
"""

import dataclasses
import math

from auv_lse_common.vocabulary.frames import wrap_pi
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.targets.surfacing import AT_DEPTH_M

#: A target, a stop or a mission that has been refused or ignored for this long (s) is reported.
IGNORED_S = 5.0
#: A vehicle whose heading is this close (rad) to the direction of its target may be slow for this time (s).
HEADS_FOR_RAD, SLOW_S = math.radians(30.0), 30.0
#: A vehicle that comes nearer by less than this (m) in that time does not follow.
PROGRESS_M = 0.25
#: A vehicle turns if its heading changes by half of what its turn radius allows in that time, or by this (rad).
MOST_TURN_RAD = math.radians(20.0)
#: Changes below these (rad) are noise: of a moving vehicle, and of one that is slower than this (m/s).
NOISE_RAD, STANDING_NOISE_RAD, STANDING_MPS = math.radians(1.0), math.radians(5.0), 0.1
#: A vehicle that holds is slower than this (m/s), or circles within this many turn radii of its position.
HOLDING_MPS, HOLDING_RADII = 0.3, 4.0
#: A vehicle is at the surface up to this depth (m).
AFLOAT_M = 1.0


class Obedience:
    """Compares a vehicle's estimates with its target.

    Attributes:
        ignored_s: Time (s) for which the vehicle has not followed its target; 0 while it follows.
        problem: Text on what it does instead; "" while it follows or for less than `IGNORED_S`.
        slow: Text on a vehicle that heads for its target and has not come nearer for `IGNORED_S`; "" otherwise.
    """

    def __init__(self, acceptance_m: float, turn_radius_m: float) -> None:
        """Args: acceptance_m: distance at which a target counts as reached. turn_radius_m: the planned turn radius."""
        self._acceptance_m, self._radius_m = acceptance_m, turn_radius_m
        self.excuse()

    def excuse(self) -> None:
        """Restarts the check: there is no target, or the autopilot cannot follow it at present."""
        self.ignored_s = 0.0
        self.problem = self.slow = ""
        self._target: Target | None = None
        self._headed_s = math.nan  # when it last headed for its target without coming nearer, up to SLOW_S
        self._since_s = math.nan  # when it last followed its target,
        self._heading_rad = math.nan  # its heading then,
        self._turned_rad = (0.0, 0.0)  # how far it has turned since then to port and to starboard,
        self._least_m = math.inf  # and what remained to go
        self._shift_m: tuple[float, float] | None = None  # the estimate's jumps so far

    def update(self, now_s: float, target: Target, stopped: bool, diving: bool, position: AutopilotEstimate) -> None:
        """Adds an estimate of the vehicle's state.

        Args:
            now_s: Time (s).
            target: The target that was sent last.
            stopped: Whether it is the position of a HOLD.
            diving: Whether the vehicle returns from the surface to the target's depth.
        """
        vertical = diving or target.at_surface
        remains_m = self._remains_m(target, diving, position)
        self._least_m += remains_m - self._remains_m(target, diving, self._without_jump(position))
        if self._is_new(target):
            self._follows(now_s, remains_m, position)
        self._target = target
        there = remains_m <= 0.0 and (not stopped or position.speed_mps < HOLDING_MPS)
        circles = not stopped or remains_m <= HOLDING_RADII * self._radius_m
        turns = not vertical and circles and self._has_turned(position)
        if there or turns or remains_m <= self._least_m - PROGRESS_M:
            self._follows(now_s, remains_m, position)
        still_s = now_s - self._since_s
        heads = not (vertical or stopped) and _heads_for(target, position)
        if heads and still_s < SLOW_S:
            self._headed_s = now_s
        self.ignored_s = now_s - self._headed_s
        is_slow = heads and still_s >= IGNORED_S
        self.slow = f"no progress towards the target for {still_s:.0f} s: it heads there (head current?)" * is_slow
        self.problem = "" if self.ignored_s < IGNORED_S else self._describe(target, stopped, diving, position)

    def _follows(self, now_s: float, remains_m: float, position: AutopilotEstimate) -> None:
        self._since_s = self._headed_s = now_s
        self._least_m = remains_m
        self._heading_rad, self._turned_rad = position.heading_rad, (0.0, 0.0)

    def _without_jump(self, position: AutopilotEstimate) -> AutopilotEstimate:
        """The estimate as it would be without a jump since the last one."""
        if math.isnan(position.raw_north_m):
            return position
        last_m = self._shift_m
        self._shift_m = position.north_m - position.raw_north_m, position.east_m - position.raw_east_m
        if last_m is None:
            return position
        north_m, east_m = position.raw_north_m + last_m[0], position.raw_east_m + last_m[1]
        return dataclasses.replace(position, north_m=north_m, east_m=east_m)

    def _is_new(self, target: Target) -> bool:
        """Whether a target leads elsewhere; position corrections move a target by less."""
        last = self._target
        if last is None or last.at_surface != target.at_surface:
            return True
        return math.dist((last.north_m, last.east_m), (target.north_m, target.east_m)) > self._acceptance_m

    def _remains_m(self, target: Target, diving: bool, position: AutopilotEstimate) -> float:
        """Distance (m) that the vehicle has left to its target; 0 or less if it is there."""
        if target.at_surface:
            return position.depth_m - AFLOAT_M
        if diving:
            return target.depth_m - AT_DEPTH_M - position.depth_m
        return _apart_m(target, position) - self._acceptance_m

    def _has_turned(self, position: AutopilotEstimate) -> bool:
        possible_rad = IGNORED_S * position.speed_mps / self._radius_m
        noise_rad = STANDING_NOISE_RAD if position.speed_mps < STANDING_MPS else NOISE_RAD
        enough_rad = min(max(0.5 * possible_rad, noise_rad), MOST_TURN_RAD)
        turned_rad = float(wrap_pi(position.heading_rad - self._heading_rad))
        port_rad, starboard_rad = min(self._turned_rad[0], turned_rad), max(self._turned_rad[1], turned_rad)
        self._turned_rad = port_rad, starboard_rad
        return starboard_rad - port_rad >= enough_rad

    def _describe(self, target: Target, stopped: bool, diving: bool, position: AutopilotEstimate) -> str:
        apart_m, for_s = _apart_m(target, position), f"for {self.ignored_s:.0f} s"
        if target.at_surface:
            return f"the autopilot does not surface: at {position.depth_m:.1f} m and not rising {for_s}"
        if diving:
            return f"the autopilot does not dive to its target: at {position.depth_m:.1f} m and not sinking {for_s}"
        if stopped:
            return (
                f"the autopilot ignores the stop {for_s}: {position.speed_mps:.1f} m/s, {apart_m:.0f} m from the "
                "position to hold"
            )
        return f"the autopilot ignores its target {for_s}: {apart_m:.0f} m away and not coming nearer"


def _heads_for(target: Target, position: AutopilotEstimate) -> bool:
    bearing_rad = math.atan2(target.east_m - position.east_m, target.north_m - position.north_m)
    return abs(float(wrap_pi(position.heading_rad - bearing_rad))) <= HEADS_FOR_RAD


def _apart_m(target: Target, position: AutopilotEstimate) -> float:
    return math.hypot(target.north_m - position.north_m, target.east_m - position.east_m)
