"""Communication: speed of the bridge, and delivery against range and team size.

`auv_lse bench comms` prints the rows, `python -m benchmarks.comms figure` draws docs/figures/channel.png.
"""

import dataclasses
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.packet.codec import Limits
from auv_lse_sim.water.channel import Channel, Position, snr_db
from benchmarks.command import end_with, parser_of
from benchmarks.navigation.channel_loss import loss_at_range
from benchmarks.rows import Row, row

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
        seconds: Mission time (s).
        packets: Packets sent at each range.
        teams: Numbers of vehicles.
    """

    seconds: int = 3600
    packets: int = 2000
    teams: tuple[int, ...] = (2, 3, 5, 8, 12, 20)


FULL = Sizes()
SMOKE = Sizes(seconds=130, packets=5, teams=(2,))

PLAN = Plan(step=7, heading_rad=0.3, north_m=120.0, east_m=80.0, actions=(5, 3, 9), naive_path=0xF1)
NORTH_M, EAST_M = 700.0, 600.0
SEED = 1


def traffic(vehicles: int, seconds: int, config: ChannelConfig) -> tuple[Counter[str], float]:
    """Bridges of a team over the channel; every vehicle has a plan and takes ten soundings a second.

    Returns:
        The outcome of each possible reception ("": read), and the processor time (s) of all bridges.
    """
    team = [ModemBridge(TdmaConfig(), PacketConfig(), a, vehicles, limits=LIMITS) for a in range(1, vehicles + 1)]
    channel = Channel(config, stream(SEED, "channel"))
    places = stream(SEED, "paths").uniform((0.0, 0.0), (NORTH_M, EAST_M), (vehicles, 2))
    positions: dict[int, Position] = {i + 1: (float(p[0]), float(p[1]), 3.0) for i, p in enumerate(places)}
    outcomes: Counter[str] = Counter()
    bridge_s = 0.0
    for t in range(1, seconds + 1):
        arrivals = channel.arrivals(float(t))
        outcomes.update(a.why for a in arrivals)
        start = time.process_time()
        for a in arrivals:
            if a.ok:
                team[a.receiver - 1].receive(a.arrival_s, a.source, a.payload)
        payloads = []
        for bridge, place in zip(team, places, strict=True):
            bridge.add_soundings(np.column_stack([t - 1.0 + 0.1 * np.arange(1, 11), np.tile([*place, 15.0], (10, 1))]))
            if t % 16 == 1:
                bridge.set_plan(dataclasses.replace(PLAN, step=min(t // 16, 100)))
            payload = bridge.poll(float(t))
            if payload is not None:
                payloads.append((bridge.address, payload))
        bridge_s += time.process_time() - start
        for source, payload in payloads:
            channel.transmit(float(t), source, payload, positions)
    return outcomes, bridge_s


def delivery_at_range(range_m: float, config: ChannelConfig, packets: int) -> float:
    """Share of packets decoded at a range without interference, by sending them."""
    channel = Channel(config, stream(SEED, "range", int(range_m)))
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
        read = delivery_at_range(range_m, ChannelConfig(), sizes.packets)
        expected = 1.0 - float(loss_at_range(range_m, ChannelConfig()))
        against = f"{expected:.3f} from curve and fading"
        goals = _within(read, expected, 1e-4, sizes.packets)
        rows.append(row(f"delivery ratio at {range_m:g} m", read, "", against, None, *goals))
    return rows


def _within(share: float, expected: float, least: float, count: int) -> tuple[str, bool]:
    """The goal that a measured share differs from the expected one only by chance, and whether it is met.

    Args:
        least: Minimum variance of one trial.
        count: Number of trials.
    """
    sigma = np.sqrt(max(expected * (1.0 - expected), least) / max(count, 1))
    return "within 4 sigma", bool(abs(share - expected) < 4.0 * sigma)


def teams(sizes: Sizes = FULL) -> list[Row]:
    """Delivery ratio against the number of vehicles, receptions lost to overlap, and the bridges' time."""
    rows = []
    for vehicles in sizes.teams:
        for loss in (0.0, 0.3):
            outcomes, bridge_s = traffic(vehicles, sizes.seconds, ChannelConfig(packet_loss=loss))
            name, count = f"{vehicles} vehicles, random loss {loss:g}", sum(outcomes.values())
            delivered, collided = outcomes[""] / max(count, 1), outcomes["half_duplex"] + outcomes["interference"]
            rows += [
                row(f"delivery ratio, {name}", delivered, "", f"{1.0 - loss:g}", delivered / (1.0 - loss),
                    *_within(delivered, 1.0 - loss, 1e-3, count)),
                row(f"receptions lost to overlap, {name}", collided, goal="0", holds=collided == 0),
                row(f"time of all bridges per second of mission, {name}", 1e3 * bridge_s / sizes.seconds, "ms"),
            ]  # fmt: skip
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
    return [*ranges(sizes), *teams(sizes)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws the figure."""
    parser = parser_of("benchmarks.comms", __doc__)
    parser.add_argument("what", choices=("figure",), help="see above")
    parser.parse_args(arguments)
    channel_figure(Path(__file__).resolve().parents[1] / "docs" / "figures" / "channel.png")


if __name__ == "__main__":
    end_with(main)
