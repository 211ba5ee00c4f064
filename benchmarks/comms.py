"""Communication: speed of codec and bridge, delivery against range and team size, and gain of selecting samples by
their value to the receivers.

    scripts/bench comms
    python -m benchmarks.comms figure        draws docs/figures/channel.png
    python -m benchmarks.comms selections    compares all ways to choose samples in all scenes (half an hour)
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.packet.codec import Limits, Packet, decode, encode
from auv_lse_comms.packet.tag import Tagger
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.receivers_risk import ReceiverMap, ReceiversRisk
from auv_lse_sim.ground.lake import SyntheticLake
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
        selection_s: Mission time of the comparison of selections.
        lakes: Lakes of that comparison.
    """

    calls: int = 200
    repeats: int = 50
    seconds: tuple[int, int] = (3600, 1600)
    packets: int = 2000
    teams: tuple[int, ...] = (2, 3, 5, 8, 12, 20)
    selection_s: int = 1600
    lakes: int = 2


FULL = Sizes()
SMOKE = Sizes(calls=2, repeats=2, seconds=(60, 130), packets=5, teams=(2,), selection_s=110, lakes=1)

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
        """Places them at random."""
        self._rng = stream(seed, "paths")
        self.places = self._rng.uniform((100.0, 100.0), (NORTH_M - 100.0, EAST_M - 100.0), (vehicles, 2))
        self._heading = self._rng.uniform(-np.pi, np.pi, vehicles)
        self._turn = np.zeros(vehicles)

    def step(self) -> Array:
        """Places (K, 2) a second later."""
        ahead = self.places + 30.0 * np.column_stack([np.cos(self._heading), np.sin(self._heading)])
        out = ((ahead < 0.0) | (ahead > (NORTH_M, EAST_M))).any(axis=1)
        change = self._rng.random(len(self._turn)) < 1.0 / 60.0
        self._turn = np.where(change, self._rng.uniform(-0.02, 0.02, len(self._turn)), self._turn)
        self._heading = self._heading + np.where(out, 0.1, self._turn)
        self.places = self.places + 1.5 * np.column_stack([np.cos(self._heading), np.sin(self._heading)])
        self.places = np.clip(self.places, 0.0, (NORTH_M, EAST_M))
        return self.places


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
        places = paths.step()
        positions: dict[int, Position] = {i + 1: (float(p[0]), float(p[1]), 3.0) for i, p in enumerate(places)}
        start = time.process_time()
        arrivals = channel.arrivals(float(t))
        channel_s += time.process_time() - start
        outcomes.update(a.why for a in arrivals)
        start = time.process_time()
        for a in arrivals:
            if a.ok and team[a.receiver - 1].receive(a.arrival_s, a.source, a.payload) is not None:
                heard[a.receiver - 1, a.source - 1] = a.sent_s
        payloads = []
        for bridge, place in zip(team, places, strict=True):
            stamps = t - 1.0 + np.arange(1, per_second + 1) / per_second
            rows = np.column_stack([stamps, np.tile([*place, 15.0], (per_second, 1))])
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
    places: dict[int, Position] = {1: (0.0, 0.0, 3.0), 2: (range_m, 0.0, 3.0)}
    read = 0
    for i in range(packets):
        channel.transmit(20.0 * i, 1, b"\x00" * 252, places)
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


@dataclasses.dataclass(slots=True)
class Outcome:
    """Excess cost of the vehicles' maps over a map of all data (the paper's local-map error)."""

    excess: float  # Bayes risk of a vehicle's map less that of all data, mean over the mission, vehicles and places
    regret: float  # what the vehicle's classes cost, by all data, more than the best ones; the same mean; never < 0
    select_s: float  # processor time of choosing, per packet


def regret(local: ReceiverMap, everything: ReceiverMap, level: LevelSet) -> float:
    """Expected cost, by all data, of a vehicle's classes over that of the best ones, mean over the places."""
    safe = level.p_safe(*everything.predict())
    cost = np.where(level.safe(*local.predict()), level.cost_false_safe * (1.0 - safe), level.cost_false_unsafe * safe)
    return float(cost.mean()) - everything.risk


def survey(
    packet: PacketConfig,
    vehicles: int,
    seed: int,
    seconds: int = 1600,
    loss: float = 0.2,
    silent_s: float = 0.0,
    rate_hz: int = 1,
) -> Outcome:
    """Moves a team over a synthetic lake and compares each vehicle's map with one of all data.

    Args:
        packet: How samples are chosen.
        vehicles: Number of vehicles.
        seed: Of lake, paths and losses.
        seconds: Length of the mission.
        loss: Share of the receptions lost at random.
        silent_s: No vehicle receives a packet before this time (a gap in communication), and nothing is compared.
        rate_hz: Soundings per second.
    """
    lake = SyntheticLake(mission_seed=seed)
    gp, level = GpConfig(min_spacing_m=8.0), LevelSet()
    extent = lake.extent
    corner = np.array([extent.north_min_m, extent.east_min_m]) + 50.0
    n1, e1 = corner[0] + NORTH_M, corner[1] + EAST_M
    area = OperatingArea(AreaConfig(polygon_m=(corner[0], corner[1], n1, corner[1], n1, e1, corner[0], e1)))

    def belief(address: int) -> ReceiversRisk | None:
        if packet.selection != "useful":
            return None
        return ReceiversRisk(gp, level, area, stream(seed, "receivers", address), 25.0)

    team = [ModemBridge(TdmaConfig(), packet, a, vehicles, receivers=belief(a)) for a in range(1, vehicles + 1)]
    own, everything = [ReceiverMap(gp, level, area, 25.0) for _ in team], ReceiverMap(gp, level, area, 25.0)
    paths, luck = Wanderers(vehicles, seed), stream(seed, "loss")
    noise = stream(seed, "noise")
    excess: list[float] = []
    regrets: list[float] = []
    select_s, packets = 0.0, 0
    share = np.arange(1, rate_hz + 1)[:, None] / rate_hz
    for t in range(1, seconds + 1):
        before = paths.places.copy()
        after = paths.step()
        lost = luck.random((vehicles, vehicles)) < loss
        for i, bridge in enumerate(team):
            places = corner + before[i] + share * (after[i] - before[i])
            depth = lake.depth_m(places[:, 0], places[:, 1]) + noise.normal(0.0, 0.1, rate_hz)
            rows = np.column_stack([t - 1.0 + share[:, 0], places, depth])[np.isfinite(depth)]
            if t % 4 == 0:
                own[i].add(rows[-1:, 1:])
                everything.add(rows[-1:, 1:])
            bridge.add_soundings(rows)
            bridge.set_plan(PLAN)
        for sender, bridge in enumerate(team):
            start = time.process_time()
            payload = bridge.poll(float(t))
            if payload is None:
                continue
            select_s += time.process_time() - start
            packets += 1
            for i, other in enumerate(team):
                if other is bridge or lost[i, sender] or t < silent_s:
                    continue
                received = other.receive(t + 3.0, bridge.address, payload)
                if received is not None:
                    own[i].add(received.packet.samples)
        if t % 50 == 0 and t > silent_s:
            excess.append(float(np.mean([k.risk for k in own])) - everything.risk)
            regrets.append(float(np.mean([regret(k, everything, level) for k in own])))
    return Outcome(float(np.mean(excess)), float(np.mean(regrets)), select_s / max(packets, 1))


#: The compared selections, each against the first: the paper's rule on every sounding.
CHOICES = {
    "every n-th": PacketConfig(),
    "every n-th, 5 m apart": PacketConfig(min_spacing_m=5.0),
    "useful": PacketConfig(selection="useful"),
    "useful, 3 m apart": PacketConfig(selection="useful", min_spacing_m=3.0),
}
SCENES: dict[str, dict[str, Any]] = {
    "K = 3": {"vehicles": 3},
    "K = 3, no loss": {"vehicles": 3, "loss": 0.0},
    "K = 3, 10 soundings/s": {"vehicles": 3, "rate_hz": 10},
    "K = 3, silent for 10 min": {"vehicles": 3, "silent_s": 600.0},
    "K = 8": {"vehicles": 8},
}


def selections(
    scenes: Iterable[str] = SCENES, choices: Iterable[str] = CHOICES, seeds: int = 3, seconds: int = 1600
) -> list[Row]:
    """Gain from the choice of samples: excess cost of local maps over the map of all data, mean over the mission.

    Args:
        scenes: Of `SCENES`.
        choices: Of `CHOICES`, the first one the one that the others are compared with.
        seeds: Number of lakes.
        seconds: Length of each mission.
    """
    rows = []
    for scene in scenes:
        settings = SCENES[scene]
        base: list[Outcome] = []
        for choice in choices:
            config = CHOICES[choice]
            runs = [survey(config, seed=seed, seconds=seconds, **settings) for seed in range(1, seeds + 1)]
            first = not base
            base = base or runs
            for kind in ("regret", "excess"):
                mean = float(np.mean([getattr(r, kind) for r in runs]))
                ratio = mean / float(np.mean([getattr(r, kind) for r in base]))
                goal = "ratio < 1" if kind == "regret" and choice == "useful" else ""
                rows.append(
                    row(
                        f"local-map {kind}, {scene}: {choice}", mean, "cost per place", against="every n-th",
                        ratio=ratio, goal=goal, holds=ratio < 1.0 if goal else None,
                    )
                )  # fmt: skip
            if not first:
                better = sum(r.regret < b.regret for r, b in zip(runs, base, strict=True))
                rows.append(row(f"  lakes with less regret, {scene}: {choice}", better, f"of {seeds}"))
            if config.selection == "useful":
                spent = float(np.mean([r.select_s for r in runs]))
                rows.append(row(f"  processor time per packet, {scene}: {choice}", spent * 1e3, "ms"))
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
    """All rows of `scripts/bench comms`; `smoke`: at the smallest sizes, in seconds."""
    sizes = SMOKE if smoke else FULL
    scenes = ("K = 3",) if smoke else ("K = 3", "K = 3, silent for 10 min")
    chosen = selections(scenes, ("every n-th", "useful"), sizes.lakes, sizes.selection_s)
    return [*codec(sizes), *twenty_vehicles(sizes), *ranges(sizes), *teams(sizes), *chosen]


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws the figure, or prints the comparison."""
    parser = parser_of("benchmarks.comms", __doc__)
    parser.add_argument("what", choices=("figure", "selections"), help="see above")
    if parser.parse_args(arguments).what == "figure":
        channel_figure(Path(__file__).resolve().parents[1] / "docs" / "figures" / "channel.png")
        return
    for line in selections():
        ratio = "" if line["ratio"] is None else f"x {line['ratio']:.3f}"
        print(line["name"], f"{line['value']:.4g}", line["unit"], ratio)


if __name__ == "__main__":
    end_with(main)
