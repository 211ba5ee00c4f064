"""Communication: speed of codec and bridge, and delivery against range and team size.

`auv_lse bench comms` prints the rows, `python -m benchmarks.comms figure` draws docs/figures/channel.png.
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.packet.codec import Limits, Packet, decode, encode
from auv_lse_comms.packet.tag import Tagger
from auv_lse_sim.water.channel import Channel, Position, snr_db
from benchmarks.command import end_with, parser_of
from benchmarks.navigation.channel_loss import loss_at_range
from benchmarks.rows import Row, row

Array = NDArray[np.float64]

LIMITS = Limits(
    steps=100,
    n_actions=11,
    north_m=(-150.0, 850.0),
    east_m=(-150.0, 750.0),
    depth_m=(-10.0, 1000.0),
)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """Sizes of the measurements.

    Attributes:
        calls: Calls of the codec that are timed together.
        repeats: How often they are timed.
        seconds: Mission time of the team of twenty, and of the smaller teams.
        packets: Packets sent at each range.
        teams: Numbers of vehicles.
    """

    calls: int = 200
    repeats: int = 50
    seconds: tuple[int, int] = (3600, 1600)
    packets: int = 2000
    teams: tuple[int, ...] = (2, 3, 5, 8, 12, 20)


FULL = Sizes()
SMOKE = Sizes(calls=2, repeats=2, seconds=(60, 130), packets=5, teams=(2,))

PLAN = Plan(step=7, heading_rad=0.3, north_m=120.0, east_m=80.0, actions=(5, 3, 9), naive_path=0xF1)
NORTH_M, EAST_M = 700.0, 600.0


def best_of(call: Callable[[], object], number: int, repeats: int) -> float:
    """Seconds per call: the fastest of some repeats, the one with the least disturbance."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        for _ in range(number):
            call()
        times.append((time.process_time() - start) / number)
    return min(times)


def codec(sizes: Sizes = FULL) -> list[Row]:
    """Time of encoding and decoding a full packet."""
    rng = np.random.default_rng(0)
    packet = Packet(PLAN, rng.uniform(0.0, 500.0, (19, 3)))
    both = best_of(lambda: decode(encode(packet, LIMITS), LIMITS), sizes.calls, sizes.repeats)
    tagger, data = Tagger(bytes(32), 6, "bench"), encode(packet, reserve=6)
    slots = iter(range(10**9))

    def tagged() -> None:
        slot_s = 10.0 * next(slots)
        tagger.accept(tagger.seal(data, 1, slot_s), 1, (slot_s,))

    tag = best_of(tagged, sizes.calls, sizes.repeats)
    return [
        row("encode + decode, 19 samples", both * 1e6, "us", goal="< 100", holds=both < 100e-6),
        row("tag and its check", tag * 1e6, "us"),
    ]


class Wanderers:
    """Vehicles at 1.5 m/s that turn round at the area's border; same paths for the same seed."""

    def __init__(self, vehicles: int, seed: int) -> None:
        """Positions them at random."""
        self._rng = stream(seed, "paths")
        self.positions = self._rng.uniform((100.0, 100.0), (NORTH_M - 100.0, EAST_M - 100.0), (vehicles, 2))
        self._heading = self._rng.uniform(-np.pi, np.pi, vehicles)
        self._turn = np.zeros(vehicles)

    def step(self) -> Array:
        """Positions (K, 2) a second later."""
        ahead = self.positions + 30.0 * np.column_stack([np.cos(self._heading), np.sin(self._heading)])
        out = ((ahead < 0.0) | (ahead > (NORTH_M, EAST_M))).any(axis=1)
        change = self._rng.random(len(self._turn)) < 1.0 / 60.0
        self._turn = np.where(change, self._rng.uniform(-0.02, 0.02, len(self._turn)), self._turn)
        self._heading = self._heading + np.where(out, 0.1, self._turn)
        self.positions = self.positions + 1.5 * np.column_stack([np.cos(self._heading), np.sin(self._heading)])
        self.positions = np.clip(self.positions, 0.0, (NORTH_M, EAST_M))
        return self.positions


@dataclasses.dataclass(slots=True)
class Traffic:
    """How many of a team's packets arrived in an hour."""

    sent: int
    outcomes: Counter[str]
    bridge_s: float
    channel_s: float
    soundings: int
    samples_received: int
    plan_age_s: float

    @property
    def delivered(self) -> float:
        """Delivered share of all possible receptions."""
        return self.outcomes[""] / max(sum(self.outcomes.values()), 1)


def traffic(vehicles: int, seconds: int, config: ChannelConfig, seed: int = 1, per_second: int = 1) -> Traffic:
    """Bridges of a team over the channel; every vehicle takes soundings and has a plan."""
    tdma = TdmaConfig()
    team = [ModemBridge(tdma, PacketConfig(), a, vehicles, limits=LIMITS) for a in range(1, vehicles + 1)]
    channel = Channel(config, stream(seed, "channel"))
    paths = Wanderers(vehicles, seed)
    outcomes: Counter[str] = Counter()
    sent = soundings = 0
    bridge_s = channel_s = 0.0
    heard = np.full((vehicles, vehicles), np.nan)
    ages: list[float] = []
    for t in range(1, seconds + 1):
        tracks = paths.step()
        positions: dict[int, Position] = {i + 1: (float(p[0]), float(p[1]), 3.0) for i, p in enumerate(tracks)}
        start = time.process_time()
        arrivals = channel.arrivals(float(t))
        channel_s += time.process_time() - start
        outcomes.update(a.why for a in arrivals)
        start = time.process_time()
        for a in arrivals:
            if a.ok and team[a.receiver - 1].receive(a.arrival_s, a.source, a.payload) is not None:
                heard[a.receiver - 1, a.source - 1] = a.sent_s
        payloads = []
        for bridge, position in zip(team, tracks, strict=True):
            stamps = t - 1.0 + np.arange(1, per_second + 1) / per_second
            rows = np.column_stack([stamps, np.tile([*position, 15.0], (per_second, 1))])
            soundings += bridge.add_soundings(rows)
            if t % 16 == 1:
                bridge.set_plan(dataclasses.replace(PLAN, step=min(t // 16, 100)))
            payload = bridge.poll(float(t))
            if payload is not None:
                payloads.append((bridge.address, payload))
        bridge_s += time.process_time() - start
        start = time.process_time()
        for source, payload in payloads:
            channel.transmit(float(t), source, payload, positions)
            sent += 1
        channel_s += time.process_time() - start
        if vehicles > 1 and t > 40 * vehicles:
            age = t - heard[~np.eye(vehicles, dtype=bool)]
            ages.append(float(np.nanmean(age)))
    received = sum(b.counts["samples.received"] for b in team)
    age_s = float(np.mean(ages)) if ages else float("nan")
    return Traffic(sent, outcomes, bridge_s, channel_s, soundings, received, age_s)


def twenty_vehicles(sizes: Sizes = FULL) -> list[Row]:
    """An hour of twenty vehicles with ten soundings a second each, in one process."""
    seconds = sizes.seconds[0]
    slots = seconds // 10
    run = traffic(20, seconds, ChannelConfig(), per_second=10)
    spent = run.bridge_s / seconds
    collided = run.outcomes["half_duplex"] + run.outcomes["interference"]
    return [
        row(
            "20 bridges, 10 soundings/s each: time per second of mission", spent * 1e3, "ms", against="real time",
            ratio=1.0 / spent, goal="ratio > 100", holds=spent < 0.01,
        ),
        row("channel of 20 vehicles: time per second of mission", run.channel_s / seconds * 1e3, "ms"),
        row(
            f"slots used by 20 vehicles in {seconds} s", run.sent, f"of {slots}", goal=str(slots),
            holds=run.sent == slots,
        ),
        row("receptions lost to overlap, 20 vehicles", collided, "", goal="0", holds=collided == 0),
    ]  # fmt: skip


def delivery_at_range(range_m: float, config: ChannelConfig, packets: int = 2000, seed: int = 1) -> float:
    """Share of packets decoded at a range without interference, by sending them."""
    channel = Channel(config, stream(seed, "range", int(range_m)))
    positions: dict[int, Position] = {1: (0.0, 0.0, 3.0), 2: (range_m, 0.0, 3.0)}
    read = 0
    for i in range(packets):
        channel.transmit(20.0 * i, 1, b"\x00" * 252, positions)
        read += sum(a.ok for a in channel.arrivals(20.0 * i + 19.0))
    return read / packets


def ranges(sizes: Sizes = FULL) -> list[Row]:
    """Delivery ratio against range, sent against computed."""
    rows = []
    for range_m in (500.0, 1000.0, 2000.0, 3000.0, 3500.0, 4000.0, 5000.0):
        got, expected = (
            delivery_at_range(range_m, ChannelConfig(), sizes.packets),
            1.0 - float(loss_at_range(range_m, ChannelConfig())),
        )
        near = abs(got - expected) < 4.0 * np.sqrt(max(expected * (1.0 - expected), 1e-4) / sizes.packets)
        rows.append(
            row(
                f"delivery ratio at {range_m:g} m", got, "", against=f"{expected:.3f} from curve and fading",
                goal="within 4 sigma", holds=bool(near),
            )
        )  # fmt: skip
    return rows


def teams(sizes: Sizes = FULL) -> list[Row]:
    """Delivery ratio, age of the last received plan, and samples, against the number of vehicles."""
    rows = []
    seconds = sizes.seconds[1]
    for vehicles in sizes.teams:
        for loss in (0.0, 0.3):
            run = traffic(vehicles, seconds, ChannelConfig(packet_loss=loss))
            name = f"K = {vehicles}, random loss {loss:g}"
            off = abs(run.delivered - (1.0 - loss))
            sigma = np.sqrt(max(loss * (1.0 - loss), 1e-3) / max(sum(run.outcomes.values()), 1))
            rows.append(
                row(
                    f"delivery ratio, {name}", run.delivered, "", against=f"{1.0 - loss:g}",
                    ratio=run.delivered / (1.0 - loss), goal="within 4 sigma", holds=bool(off < 4.0 * sigma),
                )
            )  # fmt: skip
            rows.append(row(f"mean age of what is known of a team mate, {name}", run.plan_age_s, "s"))
            rows.append(
                row(
                    f"samples heard per vehicle and minute, {name}",
                    run.samples_received / vehicles / (seconds / 60), "", against="60 soundings made by each",
                )
            )  # fmt: skip
    return rows


def channel_figure(path: Path, packets: int = 250) -> None:
    """Draws frame error against range, for spreading laws, noise and fading, with points that were sent."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    far = np.linspace(50.0, 10000.0, 400)
    cases = {
        "default": ChannelConfig(),
        "no fading": ChannelConfig(fading_db=0.0),
        "spherical spreading": ChannelConfig(spreading="spherical"),
        "noise 80 dB/Hz": ChannelConfig(noise_level_db=80.0),
        "rate 5": ChannelConfig(rate=5),
        "10 % random loss": ChannelConfig(packet_loss=0.1),
    }
    for i, (name, config) in enumerate(cases.items()):
        left.plot(far / 1000.0, loss_at_range(far, config), color=f"C{i}", label=name, linewidth=1.4)
        points = np.arange(500.0, 10000.0, 750.0) + 60.0 * i
        sent = [1.0 - delivery_at_range(p, config, packets) for p in points.tolist()]
        left.plot(points / 1000.0, sent, ".", color=f"C{i}", markersize=4)
        if name not in ("no fading", "rate 5", "10 % random loss"):
            right.plot(far / 1000.0, snr_db(far, config), color=f"C{i}", label=name, linewidth=1.4)
    left.set(xlabel="range (km)", ylabel="frame error", ylim=(-0.03, 1.03), xlim=(0.0, 10.0))
    left.set_title(f"lines: computed; dots: {packets} packets sent", fontsize=9)
    left.legend(fontsize=7, loc="center right")
    fresh = ChannelConfig(absorption="fresh")
    right.plot(far / 1000.0, snr_db(far, fresh), color="C7", label="fresh water", linewidth=1.4)
    right.axhspan(-2.6, 0.39, color="0.85", label="rate 4: errors from 1 to 0")
    right.set(xlabel="range (km)", ylabel="mean SNR (dB)", xlim=(0.0, 10.0), ylim=(-25.0, 60.0))
    right.legend(fontsize=7)
    figure.savefig(path, dpi=120)


def run(*, smoke: bool = False) -> list[Row]:
    """All rows of `auv_lse bench comms`; `smoke`: at the smallest sizes, in seconds."""
    sizes = SMOKE if smoke else FULL
    return [*codec(sizes), *twenty_vehicles(sizes), *ranges(sizes), *teams(sizes)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws the figure."""
    parser = parser_of("benchmarks.comms", __doc__)
    parser.add_argument("what", choices=("figure",), help="see above")
    parser.parse_args(arguments)
    channel_figure(Path(__file__).resolve().parents[1] / "docs" / "figures" / "channel.png")


if __name__ == "__main__":
    end_with(main)
