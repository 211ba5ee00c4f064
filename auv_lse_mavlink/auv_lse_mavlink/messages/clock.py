"""An autopilot's clock: its time since boot, converted to UTC with its SYSTEM_TIME. The host's clock may be set."""

import math
from collections.abc import Callable

from auv_lse_common.safety.watch import LONGEST_STEP_S

#: The autopilot's UTC is used if it is within this of the host's clock (s).
MAX_CLOCK_OFFSET_S = 2.0
#: A time since boot that falls by more than this (ms) means a reboot; by less, a reordered datagram.
REBOOT_MS = 1000
#: A time since boot begins again at 0 after this (ms, 49.7 days); not for a gap longer than `WRAP_GAP_MS`: a reboot.
WRAP_MS, WRAP_GAP_MS = 2**32, 60_000
#: A host's clock that differs from a steady one by more than this (s) since the last call was set.
CLOCK_SET_S = 0.5


class HostClock:
    """A time for waits, which does not jump when the host's clock is set.

    Attributes:
        now_s: The host's clock (s) at the first call, and the time that has passed since.
    """

    def __init__(self, steady: Callable[[], float] | None) -> None:
        """Uses `steady`, a clock that is never set; None: a step back, or beyond `LONGEST_STEP_S`, is a set clock."""
        self.now_s = self._utc_s = self._steady_s = -math.inf
        self._steady = steady

    def advance(self, utc_s: float) -> bool:
        """Advances to `utc_s` of the host's clock; returns whether that was set."""
        step_s, before_s = utc_s - self._utc_s, self._steady_s
        self._utc_s, self._steady_s = utc_s, self._steady() if self._steady else utc_s
        passed_s = self._steady_s - before_s
        if self._steady is None and not 0.0 <= step_s <= LONGEST_STEP_S:
            passed_s = 0.0
        if math.isinf(self.now_s):
            self.now_s = utc_s
            return False
        self.now_s += passed_s
        return abs(step_s - passed_s) > CLOCK_SET_S


class AutopilotClock:
    """Stamps of one autopilot; times of receipt while its UTC is unknown or implausible."""

    def __init__(self) -> None:
        self._utc: tuple[float, int] | None = None  # UTC (s) at a time since boot (ms)
        self._boot_ms = 0  # the latest time since boot

    def forget_utc(self) -> None:
        """Discards the UTC: the autopilot may have another clock now, or the host's clock was set."""
        self._utc = None

    def detect_reboot(self, boot_ms: int) -> bool:
        """Records a time since boot; returns whether the autopilot has rebooted since the last one."""
        wraps = (boot_ms - self._boot_ms) % WRAP_MS <= WRAP_GAP_MS
        back = not wraps and boot_ms < self._boot_ms - REBOOT_MS
        self._boot_ms = boot_ms if back or wraps else max(self._boot_ms, boot_ms)
        return back

    def set_utc(self, now_s: float, utc_us: int, boot_ms: int) -> bool:
        """Records a SYSTEM_TIME; returns whether its UTC is plausible (0: unknown)."""
        utc_s = utc_us * 1e-6
        plausible = utc_us != 0 and abs(utc_s - now_s) <= MAX_CLOCK_OFFSET_S
        self._utc = (utc_s, boot_ms) if plausible else None
        return plausible

    def stamp_s(self, now_s: float, boot_ms: int) -> float:
        """UTC of a message with a time since boot that was received at `now_s`."""
        if self._utc is None:
            return now_s
        utc_s, then_ms = self._utc
        half = WRAP_MS // 2
        return utc_s + ((boot_ms - then_ms + half) % WRAP_MS - half) / 1000.0

    def boot_ms_at(self, now_s: float) -> int:
        """Time since boot (ms) at `now_s`."""
        utc_s, then_ms = self._utc or (0.0, 0)
        return max(0, then_ms + int((now_s - utc_s) * 1000.0))
