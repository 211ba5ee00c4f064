"""The `tdma` and `packet` sections of a mission file."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import parameter
from auv_lse_common.vocabulary.modem_rates import MINI_PACKET_S

#: Smallest and largest depth (m) that a sample of a packet can hold.
SAMPLE_DEPTHS_M = (-1e3, 12e3)

#: Nodes look for their slot ten times a second: the time in which a transmission may start lasts at least two looks.
WINDOW_S = 0.2
#: A pinged modem has begun to answer so long (s) after it has heard the ping, an emulated one with its next tick.
TURN_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TdmaConfig:
    """When each vehicle may send (section 5): slots in a fixed order, anchored to a common epoch."""

    order: tuple[int, ...] = parameter(
        (),
        low=0,
        high=127,
        help="vehicle that owns each slot of the cycle, in order; a vehicle may own several or none, 0 leaves a slot "
        "to nobody; empty: one slot for each vehicle of the mission, by number",
    )
    slot_s: float = parameter(10.0, unit="s", above=0.0, high=3600.0, help="length of a slot (the paper's window)")
    guard_s: float = parameter(
        0.5,
        unit="s",
        low=0.0,
        high=600.0,
        help="kept free at both ends of a slot: the largest error of a vehicle's clock that causes no overlap",
    )
    epoch_s: float = parameter(
        0.0, unit="s", low=-1e10, high=1e10, help="time at which a cycle starts (for field use: in UTC)"
    )
    send_duration_s: float = parameter(
        2.2,
        unit="s",
        above=0.0,
        high=600.0,
        help="longest time from handing a packet to the modem until it is sent: 2 s at rate 4; with a real modem at "
        "least modem.start_timeout_s more, or modem_node refuses it",
    )
    max_range_m: float = parameter(
        1500.0,
        unit="m",
        low=0.0,
        high=100e3,
        help="largest distance of two vehicles, whose travel time must fit a slot",
    )
    sound_speed_mps: float = parameter(
        1500.0, unit="m/s", low=1300.0, high=1700.0, help="slowest sound speed to expect"
    )

    def __post_init__(self) -> None:
        """Checks that one transmission fits a slot.

        Raises:
            ValueError: if it does not, with the length that would do.
        """
        if self.slot_s < self.needed_s + WINDOW_S:
            raise ValueError(
                f"slot_s = {self.slot_s:g} s: expected at least {self.needed_s + WINDOW_S:.3f} s, which is 2 x guard_s "
                f"({self.guard_s:g}) + send_duration_s ({self.send_duration_s:g}) + travel over max_range_m "
                f"({self.max_range_m:g} m at {self.sound_speed_mps:g} m/s) + {WINDOW_S:g} s to begin in"
            )

    @property
    def travel_s(self) -> float:
        """Travel time (s) to the farthest member."""
        return self.max_range_m / self.sound_speed_mps

    @property
    def ping_s(self) -> float:
        """Longest time (s) that a ping and its answer take."""
        return 2.0 * (MINI_PACKET_S + self.travel_s) + TURN_S

    @property
    def needed_s(self) -> float:
        """What one transmission takes of a slot (s)."""
        return 2.0 * self.guard_s + self.send_duration_s + self.travel_s


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketConfig:
    """What goes into a packet, and which received packets are refused."""

    selection: str = parameter(
        "every_nth",
        choices=("every_nth", "useful"),
        help="which unsent samples to send: every n-th in time order (the paper's), or those whose expected drop of "
        "the receivers' Bayes risk is largest",
    )
    expected_loss: float = parameter(
        0.2, low=0.0, high=1.0, help="chance that a packet is lost; selection 'useful' starts from it and estimates on"
    )
    min_spacing_m: float = parameter(
        0.0,
        unit="m",
        low=0.0,
        high=1000.0,
        help="a sounding closer than this to the last one queued is not queued for sending (0: all are)",
    )
    navigation: bool | None = parameter(
        None,
        help="whether a packet tells its sender's raw place and last fix, with its samples in the raw frame, so that "
        "receivers can correct their places; left out: yes, but not with the paper's methods (planner.method "
        "augmented, exponential_quadratic, plain)",
    )
    tag: bool = parameter(
        False, help="end each packet with a keyed BLAKE2s tag; forged, altered and replayed packets are refused"
    )
    tag_bytes: int = parameter(6, low=4, high=16, help="length of the tag; 6 fit the spare bytes for 3 and 10 actions")
    key_file: str = parameter(
        "", help="file with the team's key in hexadecimal (16 to 32 bytes), readable by its owner only"
    )
    session: str = parameter(
        "",
        help="name of the dive, mixed into the tag, which needs one: packets of another dive are refused even with the "
        "same key",
    )
    abort_without_tag: bool = parameter(
        False, help="obey a call to abort by acoustic packet without `tag`, which anybody on the water can send"
    )
    check_limits: bool = parameter(
        True, help="refuse packets whose places lie outside the operating area's box widened by area_margin_m"
    )
    area_margin_m: float = parameter(
        100.0, unit="m", low=0.0, high=100e3, help="how far outside the operating area's box a place may lie"
    )
    depth_min_m: float = parameter(
        -10.0, unit="m", low=SAMPLE_DEPTHS_M[0], high=SAMPLE_DEPTHS_M[1], help="smallest water depth accepted"
    )
    depth_max_m: float = parameter(
        1000.0, unit="m", low=SAMPLE_DEPTHS_M[0], high=SAMPLE_DEPTHS_M[1], help="largest water depth accepted"
    )

    def __post_init__(self) -> None:
        """Checks what depends on two parameters.

        Raises:
            ValueError: naming the parameters and what was expected.
        """
        if self.tag and not self.key_file:
            raise ValueError("tag = true: expected key_file to name the file with the key")
        if self.tag and not self.session:
            raise ValueError(
                "tag = true, session = '': expected the name of the dive, so that packets of another one with the same "
                "key are refused; fix: session: lake-2026-07-12-a, the same for every vehicle, another for each dive"
            )
        if len(self.session.encode()) > 64:
            raise ValueError(f"session = {self.session!r}: expected at most 64 bytes")
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(f"depth_min_m = {self.depth_min_m:g}: expected less than depth_max_m {self.depth_max_m:g}")

    @property
    def reserve(self) -> int:
        """Bytes at a packet's end that the tag takes."""
        return self.tag_bytes if self.tag else 0
