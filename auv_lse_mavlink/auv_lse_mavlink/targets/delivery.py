"""Decides when an autopilot needs its position target again.

ArduPilot restarts a trajectory from rest with each position target, even if nothing in it has changed. ArduSub at 1 m/s
that gets its target five times a second travels at 0.02 m/s, and every 5 s at 0.84 m/s. So ArduPilot gets each target
once. It gets it again in these cases:

cause                                                                    when
it was armed, changed its mode, rebooted, was lost, or moved its origin  at once (`forget`)
the target has moved by `MOVED_M`, `SUNK_M` or `TURNED_RAD`              at once, but at most every `FIRST_WAIT_S`
wp_dist of NAV_CONTROLLER_OUTPUT is not the distance to the target       after `FIRST_WAIT_S`, then ever more rarely
the vehicle does not come nearer (`obedience.py`), and wp_dist does not
show that the autopilot knows its target                                 the same

Waits double up to `LONGEST_WAIT_S`, until wp_dist confirms the target: a vehicle that is merely slow is not stopped.
ArduPilot does not echo the targets that it accepts.

Other autopilots get their target every `link.target_period_s`. PX4 leaves Offboard without it.
"""

import math

from auv_lse_common.vocabulary.frames import wrap_pi
from auv_lse_mavlink.messages.conversion import Target

#: A target that has moved by less than these is the same (m, m, rad).
MOVED_M, SUNK_M, TURNED_RAD = 0.5, 0.2, 0.2
#: First and longest wait (s) before a target is sent again on suspicion.
FIRST_WAIT_S, LONGEST_WAIT_S = 5.0, 60.0
#: wp_dist agrees with the distance to the target within this (m), plus the way in this time (s): it is a whole number,
#: and as old as its stream is slow.
AGREES_M, AGREES_S = 3.0, 2.0
#: For this time (s) after a target was sent, wp_dist may still be that of the last one.
SETTLED_S = 2.0
#: This many differing values of wp_dist in a row mean that the target is forgotten.
DIFFERING = 3
#: wp_dist is too old to confirm anything after this (s).
STALE_S = 5.0


class Delivery:
    """The position target that an autopilot was sent last, and whether it needs another.

    Attributes:
        once: Whether each target is sent once (ArduPilot), or repeated.
        may_follow: Whether the autopilot follows targets now; without that ArduPilot gets none.
    """

    def __init__(self, period_s: float) -> None:
        """Repeats targets every `period_s` (s), unless `once`."""
        self.once, self.may_follow = False, True
        self._period_s = period_s
        self._sent: Target | None = None  # in the autopilot's frame
        self._sent_s = -math.inf
        self._wait_s = FIRST_WAIT_S
        self._is_doubtful = False
        self._differing = 0
        self._agreed_s = -math.inf  # when wp_dist last agreed with the distance to a target

    def forget(self) -> None:
        """The autopilot has forgotten its target."""
        self._sent, self._is_doubtful, self._differing = None, False, 0
        self._agreed_s = -math.inf

    def doubt(self, now_s: float) -> None:
        """The vehicle does not follow; ignored while wp_dist shows that the autopilot knows its target."""
        self._is_doubtful = self._is_doubtful or now_s - self._agreed_s > STALE_S

    def feedback(self, now_s: float, wp_dist_m: float, apart_m: float, speed_mps: float) -> None:
        """Adds a wp_dist (m), while the vehicle is `apart_m` from its target; `speed_mps` is the vehicle's."""
        if self._sent is None or now_s - self._sent_s < SETTLED_S:
            return
        allowed_m = AGREES_M + AGREES_S * speed_mps
        if abs(wp_dist_m - apart_m) > allowed_m:
            self._differing += 1
            self._is_doubtful = self._is_doubtful or self._differing >= DIFFERING
            return
        self._differing = 0
        if apart_m > allowed_m:  # nearer than that, a position where it was made to stop would agree too
            self._agreed_s, self._is_doubtful, self._wait_s = now_s, False, FIRST_WAIT_S

    def is_due(self, now_s: float, wanted: Target, is_new: bool) -> bool:
        """Whether a target (in the autopilot's frame) must be sent now; `is_new`: another target was chosen."""
        if not self.once:
            return is_new or now_s - self._sent_s >= self._period_s
        if not self.may_follow:
            return False
        if self._sent is None:
            return True
        waited_s = now_s - self._sent_s
        if _differ(wanted, self._sent):
            return is_new or waited_s >= FIRST_WAIT_S
        return self._is_doubtful and waited_s >= self._wait_s

    @property
    def is_doubtful(self) -> bool:
        """Whether the autopilot has evidently forgotten its target."""
        return self._is_doubtful

    def sent(self, now_s: float, target: Target) -> None:
        """Records that a target (in the autopilot's frame) was sent."""
        if self._is_doubtful:
            self._wait_s = min(2.0 * self._wait_s, LONGEST_WAIT_S)
        elif self._sent is None or _differ(target, self._sent):
            self._wait_s = FIRST_WAIT_S
        self._sent, self._sent_s = target, now_s
        self._is_doubtful, self._differing, self._agreed_s = False, 0, -math.inf


def _differ(one: Target, other: Target) -> bool:
    apart_m = math.dist((one.north_m, one.east_m), (other.north_m, other.east_m))
    turned_rad = abs(float(wrap_pi(one.heading_rad - other.heading_rad)))
    return apart_m > MOVED_M or abs(one.depth_m - other.depth_m) > SUNK_M or turned_rad > TURNED_RAD
