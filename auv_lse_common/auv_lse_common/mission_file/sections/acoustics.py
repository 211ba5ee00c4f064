"""The `tdma` and `packet` sections of a mission file."""

from auv_lse_common.mission_file.parameters import configuration, parameter
from auv_lse_common.vocabulary.modem_rates import MINI_PACKET_S

#: Smallest and largest depth (m) that a sample of a packet can hold.
SAMPLE_DEPTHS_M = (-1e3, 12e3)

#: Time (s) in which a transmission may start: two periods of the node's timer.
WINDOW_S = 0.2
#: Time (s) in which a pinged modem starts its answer; an emulated modem needs a tick.
TURN_S = 1.0


@configuration
class TdmaConfig:
    """Time slots for transmissions (paper, section 5): a fixed order, anchored to a common epoch."""

    order: tuple[int, ...] = parameter(
        (),
        low=0,
        high=127,
        help="owner of each slot in a cycle; a vehicle may own several slots or none, 0 leaves a slot empty; empty"
        " list: one for each vehicle",
    )
    slot_s: float = parameter(10.0, unit="s", above=0.0, high=3600.0, help="length of a slot (the paper's window)")
    guard_s: float = parameter(
        0.5,
        unit="s",
        low=0.0,
        high=600.0,
        help="guard time at both ends of a slot: the largest clock error that causes no overlap",
    )
    epoch_s: float = parameter(0.0, unit="s", low=-1e10, high=1e10, help="start time of a cycle (in the field: UTC)")
    send_duration_s: float = parameter(
        2.2,
        unit="s",
        above=0.0,
        high=600.0,
        help="longest time from handing a packet to the modem to the end of its transmission: 2 s at rate 4, "
        "plus modem.start_timeout_s with a real modem",
    )
    max_range_m: float = parameter(
        1500.0,
        unit="m",
        low=0.0,
        high=100e3,
        help="largest distance between two vehicles; its travel time must fit into a slot",
    )
    sound_speed_mps: float = parameter(
        1500.0, unit="m/s", low=1300.0, high=1700.0, help="slowest expected speed of sound"
    )

    def __post_init__(self) -> None:
        """Checks that a transmission fits into a slot.

        Raises:
            ValueError: if it does not, with the required length.
        """
        if self.slot_s < self.needed_s + WINDOW_S:
            raise ValueError(
                f"slot_s: {self.slot_s:g} s is too short; use at least {self.needed_s + WINDOW_S:.3f} s: 2 x "
                f"guard_s ({self.guard_s:g} s), send_duration_s ({self.send_duration_s:g} s), travel over "
                f"max_range_m ({self.max_range_m:g} m at {self.sound_speed_mps:g} m/s), and {WINDOW_S:g} s to "
                "start"
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
        """Time (s) that one transmission needs in a slot."""
        return 2.0 * self.guard_s + self.send_duration_s + self.travel_s


@configuration
class PacketConfig:
    """Content of packets, and the checks of received packets."""

    navigation: bool | None = parameter(
        None,
        help="send the vehicle's dead-reckoned position and last fix, to correct the samples' "
        "positions. Left out: true, but false with the paper's methods",
    )
    tag: bool = parameter(
        False, help="authenticate packets with a keyed BLAKE2s tag; forged, altered and replayed packets are rejected"
    )
    tag_bytes: int = parameter(
        6, low=4, high=16, help="length of the tag; 6 bytes fit the spare bytes for 3 and 10 actions"
    )
    key_file: str = parameter(
        "", help="file with the team's key in hexadecimal (16 to 32 bytes), readable by its owner only"
    )
    session: str = parameter(
        "",
        help="name of the dive, part of the tag: packets of another dive are rejected even with the same key",
    )
    abort_without_tag: bool = parameter(
        False, help="obey abort calls in packets even without `tag`; any modem in the water can send them"
    )
    area_margin_m: float = parameter(
        100.0,
        unit="m",
        low=0.0,
        high=100e3,
        help="packets with a position farther outside the operating area's bounding box are rejected",
    )
    depth_min_m: float = parameter(
        -10.0, unit="m", low=SAMPLE_DEPTHS_M[0], high=SAMPLE_DEPTHS_M[1], help="smallest accepted water depth"
    )
    depth_max_m: float = parameter(
        1000.0, unit="m", low=SAMPLE_DEPTHS_M[0], high=SAMPLE_DEPTHS_M[1], help="largest accepted water depth"
    )

    def __post_init__(self) -> None:
        """Checks parameters against each other.

        Raises:
            ValueError: naming the parameters and what was expected.
        """
        if self.tag and not self.key_file:
            raise ValueError("key_file is empty, but tag: true needs the team's key; auv_lse key makes one")
        if self.tag and not self.session:
            raise ValueError(
                "session is empty, but tag: true needs the name of the dive, to reject packets of other dives. "
                "Set it to a name such as lake-2026-07-12-a, the same for every vehicle and new for each dive"
            )
        if len(self.session.encode()) > 64:
            raise ValueError(f"session: {self.session!r} is longer than 64 bytes")
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(
                f"depth_min_m is {self.depth_min_m:g} m, but must be below depth_max_m ({self.depth_max_m:g} m)"
            )

    @property
    def reserve(self) -> int:
        """Bytes at a packet's end for the tag."""
        return self.tag_bytes if self.tag else 0
