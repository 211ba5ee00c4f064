"""Simulated acoustic channel between the vehicles' modems (docs/design/comms.md).

A transmission of source level SL reaches a receiver at range R after R / c, at the level SL - TL(R) with

    TL = k 10 log10(R / 1 m) + alpha R / 1000        (dB; k = 2 spherical, 1.5 practical; alpha (dB/km) after Thorp)

against ambient noise NL + 10 log10(B) and all overlapping arrivals. The curve of the modem's
rate converts the ratio to the probability of a frame error. A sending vehicle cannot receive; land or scheduled outages
block some links; some packets are lost at random. Each effect has a parameter that makes it ideal.

All times are simulation times. All random numbers come from the Generator passed in, in an order that depends only on
the transmissions, so that a run repeats from its seed.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.support.arrays import Array

Position = tuple[float, float, float]
#: Whether land lies between two positions (north, east, depth (m)).
Blocked = Callable[[Position, Position], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """One packet rate of the Micromodem.

    Attributes:
        frames: Frames in a packet.
        bit_rate_bps: Nominal bits per second.
        curve: Points (SNR (dB), frame error rate) of a piecewise linear curve, 1 before the first and 0 after the last.
    """

    frames: int
    frame_bytes: int
    bit_rate_bps: float
    curve: tuple[tuple[float, float], ...]


#: Rates by number. The curves of 1, 3 and 5 are those of WHOI's simulator. Between them (2, 4) SNR is interpolated
#: over the logarithm of the bit rate at equal error; rate 0, more robust than 1, takes the curve of 1.
RATES = {
    0: Rate(frames=1, frame_bytes=32, bit_rate_bps=80.0, curve=((-7.96, 1.0), (-6.01, 0.0))),
    1: Rate(frames=3, frame_bytes=64, bit_rate_bps=250.0, curve=((-7.96, 1.0), (-6.01, 0.0))),
    2: Rate(frames=3, frame_bytes=64, bit_rate_bps=500.0, curve=((-5.73, 1.0), (-3.32, 0.0))),
    3: Rate(frames=2, frame_bytes=256, bit_rate_bps=1200.0, curve=((-2.92, 1.0), (0.0, 0.025), (0.075, 0.0))),
    4: Rate(frames=2, frame_bytes=256, bit_rate_bps=1300.0, curve=((-2.60, 1.0), (0.32, 0.025), (0.39, 0.0))),
    5: Rate(frames=8, frame_bytes=256, bit_rate_bps=5300.0, curve=((3.1, 1.0), (6.0, 0.0))),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """One transmission at one receiver, readable or not.

    Attributes:
        receiver: Number of the receiving vehicle.
        source: Number of the sender.
        sent_s: When the sender began to send (s).
        start_s: When the first sound arrives (s).
        arrival_s: When the last sound has arrived and the packet is read (s).
        snr_db: Ratio of its level to noise and interference (dB), -inf if the link is blocked.
        range_m: Distance between the two at the transmission (m).
        ok: Whether the packet was read.
        why: Reason if not: "blackout", "land", "half_duplex", "interference", "noise", "random"; "" if it was.
        travel_s: One-way travel time as the two modems measure it (`ranging.py`), NaN if they cannot.
    """

    receiver: int
    source: int
    payload: bytes
    sent_s: float
    start_s: float
    arrival_s: float
    snr_db: float
    range_m: float
    ok: bool
    why: str
    travel_s: float = math.nan

    @property
    def heard_s(self) -> float:
        """Start of reception by the receiver's clock, where the sender's clock shows `sent_s` when it sends (s)."""
        return self.sent_s + self.travel_s

    @property
    def audible(self) -> bool:
        """Whether the receiver's modem notices it at all: no sound comes through land, and a sender hears nothing."""
        return self.why not in ("blackout", "land", "half_duplex")


def thorp_db_per_km(frequency_khz: float) -> float:
    """Thorp's absorption of sound in the sea (dB/km), with its low-frequency term (Urick 1983, eq. 5-3)."""
    f2 = frequency_khz**2
    return 0.11 * f2 / (1.0 + f2) + 44.0 * f2 / (4100.0 + f2) + 2.75e-4 * f2 + 0.003


def fresh_db_per_km(frequency_khz: float) -> float:
    """Absorption in fresh water (dB/km): Thorp's term of pure water, without those of boric acid and magnesium."""
    return float(2.75e-4 * frequency_khz**2)


def transmission_loss_db(range_m: ArrayLike, config: ChannelConfig) -> Array:
    """Loss of level from 1 m to each range (dB); a range below 1 m counts as 1 m."""
    far_m = np.maximum(np.asarray(range_m, dtype=float), 1.0)
    spreading = {"spherical": 20.0, "practical": 15.0, "none": 0.0}[config.spreading]
    absorption = {"thorp": thorp_db_per_km, "fresh": fresh_db_per_km}.get(config.absorption)
    per_km = 0.0 if absorption is None else absorption(config.frequency_khz)
    return np.asarray(spreading * np.log10(far_m) + per_km * far_m / 1000.0)


def snr_db(range_m: ArrayLike, config: ChannelConfig) -> Array:
    """Mean ratio of a lone transmission to the ambient noise at each range (dB), without fading."""
    noise = config.noise_level_db + 10.0 * math.log10(config.bandwidth_khz * 1000.0)
    return np.asarray(config.source_level_db - transmission_loss_db(range_m, config) - noise)


def frame_error_rate(ratio_db: ArrayLike, rate: int) -> Array:
    """Probability of a frame error at each ratio (dB)."""
    levels, errors = zip(*RATES[rate].curve, strict=True)
    return np.asarray(np.interp(np.asarray(ratio_db, dtype=float), levels, errors))


#: Maximum distance (m) between the points at which a link is checked for land.
LINK_SPACING_M = 5.0


def land_between(depth_m: Callable[[Array, Array], Array]) -> Blocked:
    """Creates a `Blocked` from the ground; unknown depth (NaN) or depth of at most 0 is land.

    Args:
        depth_m: Water depth (m) at north, east (m), arrays of one shape.
    """

    def blocked(a: Position, b: Position) -> bool:
        n = max(2, math.ceil(math.hypot(b[0] - a[0], b[1] - a[1]) / LINK_SPACING_M) + 1)
        depth = np.asarray(depth_m(np.linspace(a[0], b[0], n), np.linspace(a[1], b[1], n)))
        return not bool((depth > 0.0).all())

    return blocked


@dataclass(slots=True)
class _Sound:
    """One transmission on its way to one receiver, before reception."""

    receiver: int
    source: int
    payload: bytes
    sent_s: float
    start_s: float
    end_s: float
    range_m: float
    level_db: float
    obstacle: str  # why the link is blocked, or ""
    lost: bool
    luck: float


class Channel:
    """The acoustic channel of one mission: turns transmissions into receptions.

    Call `transmit` and `arrivals` in order of time. One tick of an engine, ending at `now_s`:

        for arrival in channel.arrivals(now_s): hand it to its receiver if arrival.ok
        ... the vehicles decide ...
        channel.transmit(now_s, source, payload, positions)
    """

    def __init__(self, config: ChannelConfig, rng: np.random.Generator, blocked: Blocked | None = None) -> None:
        """Starts without transmissions.

        Args:
            rng: Source of the channel's random numbers.
            blocked: Returns whether land lies between two positions; None: never.
        """
        config = config.in_force
        self.config = config
        self._rng = rng
        self._blocked = blocked if config.land_blocks else None
        self._pending: list[_Sound] = []
        self._received: list[_Sound] = []  # received, but may still overlap pending ones
        self._sending: list[tuple[int, float, float]] = []  # vehicle, from, until
        self._until_s = -math.inf
        self._noise_db = config.noise_level_db + 10.0 * math.log10(config.bandwidth_khz * 1000.0)

    def duration_s(self, n_bytes: int) -> float:
        """Duration of a transmission of this many bytes (s).

        Raises:
            ValueError: if they do not fit into one packet of the rate.
        """
        rate = self.config.rate
        table = RATES[rate]
        if not 0 <= n_bytes <= table.frames * table.frame_bytes:
            raise ValueError(
                f"{n_bytes} bytes do not fit a packet of rate {rate}, {table.frames} x {table.frame_bytes}; send "
                "less, or use another rate"
            )
        return self.config.overhead_s + 8.0 * n_bytes / table.bit_rate_bps

    def transmit(
        self,
        now_s: float,
        source: int,
        payload: bytes,
        positions: Mapping[int, Position],
    ) -> float:
        """Starts a vehicle's transmission.

        Args:
            now_s: Its start (s), not before the time of the last `arrivals`.
            source: Its number.
            positions: Every vehicle's position now, by number: north, east, depth (m).

        Returns:
            When the transmission ends at the sender (s).

        Raises:
            ValueError: if the time precedes the last `arrivals`, the vehicle is still sending or has no position, or
                the payload does not fit into a packet.
        """
        end = now_s + self.duration_s(len(payload))
        if not now_s >= self._until_s:
            raise ValueError(f"transmission at {now_s} s: arrivals until {self._until_s} s were given already")
        if source not in positions:
            raise ValueError(f"transmission of vehicle {source}: its position is not among {sorted(positions)}")
        if any(vehicle == source and until > now_s for vehicle, _, until in self._sending):
            raise ValueError(f"transmission of vehicle {source} at {now_s} s: it is still sending")
        self._sending.append((source, now_s, end))
        here = positions[source]
        for receiver in sorted(positions):
            if receiver == source:
                continue
            there = positions[receiver]
            fading, lost, luck = self._rng.standard_normal(), self._rng.random(), self._rng.random()
            distance = math.dist(here, there)
            start = now_s + (distance / self.config.sound_speed_mps if self.config.delay else 0.0)
            level = self.config.source_level_db - float(transmission_loss_db(distance, self.config))
            self._pending.append(
                _Sound(
                    receiver=receiver,
                    source=source,
                    payload=bytes(payload),
                    sent_s=now_s,
                    start_s=start,
                    end_s=start + (end - now_s),
                    range_m=distance,
                    level_db=level + self.config.fading_db * float(fading),
                    obstacle=self._obstacle(now_s, source, receiver, here, there),
                    lost=float(lost) < self.config.packet_loss,
                    luck=float(luck),
                )
            )
        return end

    def _obstacle(self, now_s: float, source: int, receiver: int, here: Position, there: Position) -> str:
        link = {source, receiver}
        for a, b, start, end in self.config.outages:
            named = {int(a), int(b)} - {0}
            if named <= link and start <= now_s < end:
                return "blackout"
        if self._blocked is not None and self._blocked(here, there):
            return "land"
        return ""

    def arrivals(self, until_s: float) -> list[Arrival]:
        """The transmissions whose last sound has arrived since the last call, until `until_s` (s).

        Returns:
            Sorted by arrival, receiver and source; includes unreadable ones.

        Raises:
            ValueError: if `until_s` lies before that of an earlier call.
        """
        if not until_s >= self._until_s:
            raise ValueError(f"arrivals until {until_s} s: {self._until_s} s were given already")
        self._until_s = until_s
        due = [sound for sound in self._pending if sound.end_s <= until_s]
        due.sort(key=lambda sound: (sound.end_s, sound.receiver, sound.source))
        around = self._pending + self._received
        result = [self._receive(sound, around) for sound in due]
        self._pending = [sound for sound in self._pending if sound.end_s > until_s]
        # later arrivals start after the oldest pending one, or after now
        horizon = min([sound.start_s for sound in self._pending], default=until_s)
        self._received = [sound for sound in self._received + due if sound.end_s > horizon]
        self._sending = [entry for entry in self._sending if entry[2] > horizon]
        return result

    def _receive(self, sound: _Sound, around: list[_Sound]) -> Arrival:
        overlapping = [
            other.level_db
            for other in around
            if other is not sound
            and other.receiver == sound.receiver
            and not other.obstacle
            and other.start_s < sound.end_s
            and sound.start_s < other.end_s
        ]
        ambient = 10.0 ** (self._noise_db / 10.0)
        others = sum(10.0 ** (level / 10.0) for level in overlapping) if self.config.interference else 0.0
        alone_db = sound.level_db - self._noise_db
        ratio_db = sound.level_db - 10.0 * math.log10(ambient + others)
        sending = self.config.half_duplex and any(
            vehicle == sound.receiver and start < sound.end_s and sound.start_s < end
            for vehicle, start, end in self._sending
        )
        if sound.obstacle:
            why, ratio_db = sound.obstacle, -math.inf
        elif sending:
            why = "half_duplex"
        elif self.config.frame_errors and sound.luck < float(frame_error_rate(ratio_db, self.config.rate)):
            alone_ok = sound.luck >= float(frame_error_rate(alone_db, self.config.rate))
            why = "interference" if alone_ok else "noise"
        else:
            why = "random" if sound.lost else ""
        return Arrival(
            receiver=sound.receiver,
            source=sound.source,
            payload=sound.payload,
            sent_s=sound.sent_s,
            start_s=sound.start_s,
            arrival_s=sound.end_s,
            snr_db=ratio_db,
            range_m=sound.range_m,
            ok=not why,
            why=why,
        )
