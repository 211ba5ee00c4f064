"""An autopilot's clock: its time since boot, converted to UTC with its SYSTEM_TIME."""

#: The autopilot's UTC is used if it is within this of the host's clock (s).
MAX_CLOCK_OFFSET_S = 2.0
#: A time since boot that falls by more than this (ms) means a reboot; by less, a reordered datagram.
REBOOT_MS = 1000


class AutopilotClock:
    """Stamps of one autopilot; times of receipt while its UTC is unknown or implausible."""

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._boot_ms = 0  # the latest time since boot

    def forget_utc(self) -> None:
        """Discards the UTC: the autopilot may have another clock now, or the host's clock was set."""
        self._offset_s = None

    def detect_reboot(self, boot_ms: int) -> bool:
        """Records a time since boot; returns whether the autopilot has rebooted since the last one."""
        back = boot_ms < self._boot_ms - REBOOT_MS
        self._boot_ms = boot_ms if back else max(self._boot_ms, boot_ms)
        return back

    def set_utc(self, now_s: float, utc_us: int, boot_ms: int) -> bool:
        """Records a SYSTEM_TIME; returns whether its UTC is plausible (0: unknown)."""
        utc_s = utc_us * 1e-6
        plausible = utc_us != 0 and abs(utc_s - now_s) <= MAX_CLOCK_OFFSET_S
        self._offset_s = utc_s - boot_ms / 1000.0 if plausible else None
        return plausible

    def stamp_s(self, now_s: float, boot_ms: int) -> float:
        """UTC of a message with a time since boot that was received at `now_s`."""
        return now_s if self._offset_s is None else boot_ms / 1000.0 + self._offset_s

    def boot_ms_at(self, now_s: float) -> int:
        """Time since boot (ms) at `now_s`."""
        return max(0, int((now_s - (self._offset_s or 0.0)) * 1000.0))
