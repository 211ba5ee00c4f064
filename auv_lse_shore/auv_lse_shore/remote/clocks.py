"""Compares the clocks of vehicles and laptop, each with the uncertainty of its round trip."""

from collections.abc import Mapping
from dataclasses import dataclass

from auv_lse_common.support.plurals import counted


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """A vehicle's clock minus the laptop's.

    Attributes:
        offset_s: The difference (s).
        error_s: Half the round trip (s): the largest error of the difference.
    """

    offset_s: float
    error_s: float

    @property
    def text(self) -> str:
        """As people read it: "+0.02 s, known to 0.01 s"."""
        return f"{self.offset_s:+z.2f} s ± {max(self.error_s, 0.005):.2f}"


def clock_offset(sent_s: float, vehicle_s: float, received_s: float) -> ClockOffset:
    """The offset from one question and answer.

    Args:
        sent_s: When the laptop asked, by its clock.
        vehicle_s: The vehicle's clock when it answered.
        received_s: When the laptop had the answer, by its clock.
    """
    return ClockOffset(vehicle_s - (sent_s + received_s) / 2.0, max((received_s - sent_s) / 2.0, 0.0))


def wrong_clocks(offsets: Mapping[str, ClockOffset], guard_s: float) -> dict[str, tuple[str, str]]:
    """The clocks that are wrong, or may be: level and text by vehicle, "laptop" for the laptop.

    The clocks that agree with most others count as right. With as many on each side, the laptop's decides.

    Args:
        offsets: By vehicle.
        guard_s: Largest difference that the slots tolerate.
    """
    if not offsets:
        return {}
    clocks = {**offsets, "laptop": ClockOffset(0.0, 0.0)}

    def agreeing(name: str) -> list[str]:
        return [other for other in clocks if abs(clocks[other].offset_s - clocks[name].offset_s) <= guard_s]

    best = max(clocks, key=lambda name: (len(agreeing(name)), "laptop" in agreeing(name), name == "laptop"))
    right, reference = agreeing(best), clocks[best]
    who = (
        "the laptop"
        if best == "laptop"
        else f"{counted(len([n for n in right if n != 'laptop']), 'vehicle')} that agree"
    )
    found = {}
    for name, clock in clocks.items():
        off_s = clock.offset_s - reference.offset_s
        doubt_s = clock.error_s + (reference.error_s if name != best else 0.0)
        if abs(off_s) <= guard_s and (abs(off_s) + doubt_s <= guard_s or name in ("laptop", best)):
            continue
        is_wrong = abs(off_s) > guard_s
        level = "error" if is_wrong and name != "laptop" else "warning"
        if is_wrong and name == "laptop":
            text = f"the laptop's clock is {off_s:+z.1f} s off the vehicles', which agree. Set the laptop's clock."
        elif is_wrong:
            text = (
                f"its clock is {off_s:+z.2f} s (± {doubt_s:.2f}) off {who}; slots tolerate {guard_s:g} s. "
                "Set it from GPS or NTP: sudo chronyc makestep"
            )
        else:
            text = (
                f"its clock may be off by more than {guard_s:g} s: the link is too slow to tell ({off_s:+z.2f} s ± "
                f"{doubt_s:.2f}). Check again closer to it."
            )
        found[name] = (level, text)
    return found
