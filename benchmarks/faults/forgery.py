"""The team's losses to an attacker with an acoustic modem but no key, and to wrong clocks.

Missions of three vehicles in one process (the fleet engine) without tags. The forger sends in vehicle 2's name. It
hears everything, knows the ground, and its packets reach all vehicles. Then a pair of vehicles with tags, whose clocks
are wrong and then corrected.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.health import bridge_problems
from auv_lse_comms.packet.codec import Packet, decode, encode, room_for_samples
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_sim.engine.fleet import Fleet, VehicleCores
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.water.channel import Arrival
from benchmarks.faults.report import Report

#: The vehicle in whose name the forger sends.
VICTIM = 2
#: When the attacks begin (s), except those from the start.
BEGINS_S = 120.0
#: Depth error of forged samples (m), towards the other side of the level.
WRONG_M = 6.0
#: Time (s) from the start of a slot to the arrival of its first forged packet, and between further ones.
EARLY_S, ON_TIME_S, APART_S = 1.0, 3.0, 2.0
#: Time (s) that a leg takes.
LEG_S = 15.7
#: Arguments of a run of a few minutes.
SMALL = ("--seeds", "1")
#: Maximum time (s) in which vehicles do not hear each other after their clocks are corrected.
MOST_LOCKOUT_S = 120.0
#: How far wrong clocks are ahead (s), and when they are corrected and the vehicles restarted (s).
AHEAD_S, CORRECTED_S, RESTARTED_S, END_S = 3600.0, 300.0, 310.0, 4200.0


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Attack:
    """A forger's attack, and its accepted effects.

    Attributes:
        name: For the table.
        forge: Makes its next packet from the victim's last one; None: there is no forger.
        most: Forged packets in a mission at most.
        per_slot: Forged packets in each of the victim's slots.
        begins_s: When it begins (s).
        early_s: Time (s) from the start of a slot to the arrival of its first forged packet. Vehicle 2's own arrives
            after 3.0 to 3.2 s.
        louder: Whether it drowns the victim's own packets.
        most_wrong: Share of wrong cells beyond those without a forger, at most.
        least_through: Share of true packets that are accepted, at least.
        most_planless_s: Time (s) without a plan, at most.
    """

    name: str
    forge: Callable[[Forger, Packet], Packet] | None = None
    most: int = 10**6
    per_slot: int = 1
    begins_s: float = BEGINS_S
    early_s: float = EARLY_S
    louder: bool = False
    most_wrong: float = 0.04
    least_through: float = 0.8
    most_planless_s: float = 240.0


class Forger:
    """Makes forged packets; knows the ground, the level and the victim's last packet."""

    def __init__(self, fleet: Fleet, seed: int) -> None:
        self._fleet = fleet
        self._rng = np.random.default_rng([seed, 23])
        self._steps = fleet.settings.mission.steps
        self._track = [self._fleet.cores[0].map.grid.locations_m.mean(axis=0)]
        self._goal = self._track[0]

    def _samples(self, packet: Packet, locations_m: Array) -> Array:
        """As many samples at the positions (n, 2) as fit, on the wrong side of the level."""
        depths = self._fleet.ground.depth_m(locations_m[:, 0], locations_m[:, 1])
        level = self._fleet.settings.level_set.level_m
        shallower, deeper = np.minimum(depths - WRONG_M, level - 1.0), np.maximum(depths + WRONG_M, level)
        wrong = np.where(depths >= level, shallower, deeper)
        known = np.isfinite(wrong)
        room = room_for_samples(packet.plan, 0, packet.navigation)
        found: Array = np.column_stack([locations_m, wrong])[known][:room]
        return found

    def scattered(self, last: Packet) -> Packet:
        """Wrong samples all over the area."""
        grid = self._fleet.cores[0].map.grid
        positions = grid.locations_m[self._rng.choice(len(grid.locations_m), 40, replace=False)]
        return dataclasses.replace(last, samples=self._samples(last, positions))

    def along(self, last: Packet) -> Packet:
        """Wrong samples within 40 m of the victim's last position."""
        position = np.array(last.plan.state[1:] if last.navigation is None else last.navigation.raw_m)
        positions = position + self._rng.uniform(-28.0, 28.0, (40, 2))
        return dataclasses.replace(last, samples=self._samples(last, positions))

    def high_step(self, last: Packet) -> Packet:
        """The victim's plan as if it were far ahead."""
        step = min(last.plan.step + self._steps // 2, self._steps)
        return dataclasses.replace(last, plan=dataclasses.replace(last.plan, step=step), samples=np.zeros((0, 3)))

    def steady(self, last: Packet) -> Packet:
        """A packet of a vehicle of its own, which travels steadily through the area; wrong samples beside its track."""
        speed_mps = self._fleet.cores[VICTIM - 1].planner.settings.vehicle.speed_mps
        locations_m = self._fleet.cores[0].map.grid.locations_m
        while len(self._track) <= self._fleet.now_s:
            way_m = self._goal - self._track[-1]
            if (left_m := float(np.hypot(*way_m))) < 10.0:
                self._goal = locations_m[self._rng.integers(len(locations_m))]
                continue
            self._track.append(self._track[-1] + way_m * min(speed_mps / left_m, 1.0))
        north_m, east_m = self._track[-1].tolist()
        step = min(int(self._fleet.now_s / LEG_S), self._steps)
        packet = Packet(
            Plan.at(step, np.array([0.0, north_m, east_m]), (), NONE),
            navigation=Navigation(raw_cm=(round(100.0 * north_m), round(100.0 * east_m))),
        )
        recent = np.array(self._track[-30:])
        positions = recent[self._rng.integers(len(recent), size=40)] + self._rng.uniform(-20.0, 20.0, (40, 2))
        return dataclasses.replace(packet, samples=self._samples(packet, positions))

    def leaving(self, last: Packet) -> Packet:
        """As `steady`, from where the victim starts."""
        if len(self._track) == 1:
            self._goal = self._track[0] = np.array(self._fleet.cores[VICTIM - 1].log.truth[0][1:3])
        return self.steady(last)

    def elsewhere(self, last: Packet) -> Packet:
        """A packet from a random position, with a random step."""
        grid = self._fleet.cores[0].map.grid
        north_m, east_m = grid.locations_m[self._rng.integers(len(grid.locations_m))].tolist()
        step = int(self._rng.integers(self._steps))
        navigation = None
        if last.navigation is not None:
            navigation = Navigation(raw_cm=(round(100.0 * north_m), round(100.0 * east_m)))
        return Packet(Plan.at(step, np.array([0.0, north_m, east_m]), (), NONE), navigation=navigation)


ATTACKS = (
    Attack(name="none"),
    Attack(name="4 packets, wrong samples all over", forge=Forger.scattered, most=4),
    Attack(name="each slot, wrong samples along the track", forge=Forger.along),
    Attack(name="each slot, a plan with a high step", forge=Forger.high_step, least_through=0.7),
    Attack(
        name="3 in each slot, first, from elsewhere",
        forge=Forger.elsewhere,
        per_slot=3,
        begins_s=0.0,
        least_through=0.7,
    ),
    Attack(name="3 in each slot, first, a steady track", forge=Forger.steady, per_slot=3, begins_s=0.0),
    Attack(name="3 in each slot, first, a track from its start", forge=Forger.leaving, per_slot=3, begins_s=0.0),
    Attack(
        name="each slot, beside the true packet, a steady track",
        forge=Forger.steady,
        begins_s=0.0,
        early_s=ON_TIME_S,
        most_wrong=0.15,
        least_through=0.7,
        most_planless_s=480.0,
    ),
    Attack(
        name="each slot, drowning the true packet, a steady track",
        forge=Forger.steady,
        begins_s=0.0,
        early_s=ON_TIME_S,
        louder=True,
        most_wrong=0.4,
        least_through=0.0,
        most_planless_s=math.inf,
    ),
)


class AttackedFleet(Fleet):
    """A fleet with a forger in the water.

    Attributes:
        true_payloads: Packets that the victim has sent.
        through: True packets of the victim that its mates have accepted.
        forged: Forged packets that they have accepted.
        planless_s: Time (s) in which a mate had no true plan of the victim, after the first one, sum of the mates.
    """

    def __init__(self, settings: Settings, attack: Attack, seed: int) -> None:
        super().__init__(settings, ground_of(settings))
        self.true_payloads: set[bytes] = set()
        self.through = self.forged = 0
        self.planless_s = 0.0
        self._attack, self._forger = attack, Forger(self, seed)
        self._made = 0
        self._last = b""
        self._plans: list[Plan] = []
        self._tdma = self.cores[0].bridge.tdma
        tick = self.world.tick
        self.world.tick = lambda now_s: self._with_forgeries(tick(now_s), now_s)  # type: ignore[method-assign]
        for cores in self._mates:
            self._count(cores.bridge)

    @property
    def _mates(self) -> list[VehicleCores]:
        return [cores for cores in self.cores if cores.vehicle != VICTIM]

    def _count(self, bridge: ModemBridge) -> None:
        receive = bridge.receive

        def counted(now_s: float, source: int, payload: bytes, *rest: Any) -> Any:
            received = receive(now_s, source, payload, *rest)
            if received is not None and source == VICTIM:
                true = payload in self.true_payloads
                self.through += true
                self.forged += not true
            return received

        bridge.receive = counted  # type: ignore[assignment,method-assign]

    def _with_forgeries(self, outputs: dict[int, Any], now_s: float) -> dict[int, Any]:
        if self._attack.louder:
            for number, output in outputs.items():
                heard = [arrival for arrival in output.arrivals if arrival.source != VICTIM]
                outputs[number] = dataclasses.replace(output, arrivals=heard)
        payloads = self._due(now_s)
        if not payloads:
            return outputs
        for number in {cores.vehicle for cores in self._mates}:
            forged = [
                Arrival(
                    receiver=number,
                    source=VICTIM,
                    payload=payload,
                    sent_s=now_s - 2.5,
                    start_s=now_s - 2.0,
                    arrival_s=now_s,
                    snr_db=20.0,
                    range_m=500.0,
                    ok=True,
                    why="",
                )
                for payload in payloads
            ]
            outputs[number] = dataclasses.replace(outputs[number], arrivals=[*forged, *outputs[number].arrivals])
        return outputs

    def _due(self, now_s: float) -> list[bytes]:
        attack, slot = self._attack, self._tdma.slot(now_s)
        if attack.forge is None or slot.owner != VICTIM or now_s < attack.begins_s or self._made >= attack.most:
            return []
        number, rest = divmod(now_s - slot.start_s - attack.early_s, APART_S)
        if rest or not 0 <= number < attack.per_slot or not (self._last or attack.begins_s == 0.0):
            return []
        self._made += 1
        last = decode(self._last) if self._last else self._first()
        return [encode(attack.forge(self._forger, last))]

    def _first(self) -> Packet:
        return Packet(Plan.at(0, np.zeros(3), (), NONE), navigation=Navigation(raw_cm=(0, 0)))

    def tick(self) -> None:
        """Runs one tick and records which of the victim's plans the mates have."""
        sent = len(self.sent)
        super().tick()
        for packet in self.sent[sent:]:
            if packet.source == VICTIM:
                self._last = packet.payload
                self.true_payloads.add(packet.payload)
                self._plans.append(decode(packet.payload).plan)
        for cores in self._mates:
            mate = cores.planner.team._mates.get(VICTIM)
            lately = mate is not None and mate.plan in self._plans and self.now_s - mate.last_heard_s < 120.0
            if self.now_s > BEGINS_S and not lately and not self.cores[VICTIM - 1].planner.finished:
                self.planless_s += self.settings.sim.tick_s


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """Results of a mission for the victim's mates: shares and times are means over the two mates.

    Attributes:
        wrong: Share of the cells that its map puts on the wrong side of the level.
        through: Share of the victim's packets that it accepted.
        forged: Forged packets that it accepted.
        planless_s: Time without a recent plan of the victim (s), from `BEGINS_S` on.
    """

    wrong: float
    through: float
    forged: float
    planless_s: float


def wrong_cells(fleet: Fleet, cores: VehicleCores) -> float:
    """Share of the cells that a vehicle's map puts on the wrong side of the level."""
    field, level = cores.map.field(), fleet.settings.level_set.level_m
    grid = field.grid
    truth = np.asarray(fleet.ground.depth_m(grid.north_m[:, None], grid.east_m[None, :]))
    known = np.isfinite(field.mean_m) & np.isfinite(truth)
    return float(np.mean((field.mean_m >= level)[known] != (truth >= level)[known]))


def fly(attack: Attack, seed: int, steps: int, method: str = "tour") -> Outcome:
    """Flies a mission under an attack."""
    settings = Settings.load(
        None, {"mission.vehicles": 3, "mission.steps": steps, "mission.seed": seed, "planner.method": method}
    )
    fleet = AttackedFleet(settings, attack, seed)
    fleet.run()
    mates = fleet._mates
    return Outcome(
        wrong=float(np.mean([wrong_cells(fleet, cores) for cores in mates])),
        through=fleet.through / (len(mates) * max(len(fleet.true_payloads), 1)),
        forged=fleet.forged / len(mates),
        planless_s=fleet.planless_s / len(mates),
    )


def _pair() -> list[ModemBridge]:
    packet = PacketConfig(tag=True, key_file="-", session="forgery", navigation=False)
    return [ModemBridge(TdmaConfig(), packet, number, 2, key=bytes(range(32))) for number in (1, 2)]


def lockout(restarted: bool) -> tuple[float, list[str]]:
    """Two vehicles whose clocks are both `AHEAD_S` ahead, until `CORRECTED_S`.

    Args:
        restarted: Whether both are restarted after that, each with the events of its journal.

    Returns:
        The longest time (s) from the correction to the first packet that one accepts; and the problems that they
        report 100 s after it.
    """
    pair = _pair()
    journals: list[list[tuple[Any, ...]]] = [[], []]
    heard_s = [math.inf, math.inf]
    texts: list[str] = []

    def keep(bridges: Sequence[ModemBridge]) -> None:
        for bridge, journal in zip(bridges, journals, strict=True):
            bridge.remember = lambda *event, journal=journal: journal.append(event)
            bridge.set_plan(Plan.at(1, np.zeros(3), (1,), NONE))

    keep(pair)
    for second in range(int(END_S)):
        now_s = second + (AHEAD_S if second < CORRECTED_S else 0.0)
        if restarted and second == RESTARTED_S:
            pair = _pair()
            for bridge, journal in zip(pair, journals, strict=True):
                bridge.recall(list(journal))
            keep(pair)
        for sender, receiver in ((0, 1), (1, 0)):
            payload = pair[sender].poll(now_s)
            if payload is None:
                continue
            received = pair[receiver].receive(now_s + 2.5, sender + 1, payload)
            if received is not None and second >= CORRECTED_S:
                heard_s[receiver] = min(heard_s[receiver], second - CORRECTED_S)
        if second == CORRECTED_S + 100.0:
            texts = sorted({text for bridge in pair for text in bridge_problems(bridge, now_s).values()})
        if second >= CORRECTED_S + 100.0 and max(heard_s) < math.inf:
            break
    return max(heard_s), texts


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults forgery`."""
    parser.add_argument(
        "--seeds", type=whole_from(1), default=2, metavar="N", help="missions of each attack (default: %(default)s)"
    )
    parser.add_argument(
        "--steps", type=whole_from(1), default=45, metavar="N", help="steps of each (default: %(default)s)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of all attacks."""
    seeds = range(options.seed, options.seed + options.seeds)
    lines = [
        "| forger without the key | wrong cells | true packets through | forged packets accepted | without a plan |",
        "|---|---|---|---|---|",
    ]
    lost: list[str] = []
    honest = 0.0
    for attack in ATTACKS:
        outcomes = [fly(attack, seed, options.steps) for seed in seeds]
        mean = {f.name: float(np.mean([getattr(o, f.name) for o in outcomes])) for f in dataclasses.fields(Outcome)}
        honest = mean["wrong"] if attack.forge is None else honest
        lines.append(
            f"| {attack.name} | {100 * mean['wrong']:.1f} % | {100 * mean['through']:.0f} % | {mean['forged']:.1f} | "
            f"{mean['planless_s']:.0f} s |"
        )
        say(lines[-1])
        wrong, through, planless_s = mean["wrong"] - honest, mean["through"], mean["planless_s"]
        if wrong > attack.most_wrong or through < attack.least_through or planless_s > attack.most_planless_s:
            lost.append(f"{attack.name}: more harm than expected")
    lines += ["", "| clocks 1 h ahead, then corrected | longest lock-out | reported |", "|---|---|---|"]
    longest_s = 0.0
    for restarted in (False, True):
        lockout_s, texts = lockout(restarted)
        when = "and restarted" if restarted else "while running"
        lines.append(f"| {when} | {lockout_s:.0f} s | {'; '.join(texts)} |")
        say(lines[-1])
        if lockout_s > MOST_LOCKOUT_S:
            lost.append(f"clocks corrected, {when}: no packet for {lockout_s:.0f} s")
        longest_s = max(longest_s, lockout_s)
    tried = len(ATTACKS) - 1 + 2
    return Report(lines, tried=tried, survived=tried - len(lost), worst_recovery_s=longest_s, lost=lost)
