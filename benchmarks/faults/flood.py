"""Floods the port of a vehicle's MAVLink link, and measures whether odometry and targets keep their rate.

The link (`AutopilotPort`, as vehicle_link_node drives it), a simulated autopilot and the attacker are three processes
that talk over UDP on this machine. Messages are signed. The autopilot reports ten times a second.
"""

import argparse
import multiprocessing
import random
import secrets
import select
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.option_types import positive
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.messages.wire import MavlinkCodec, mavlink
from auv_lse_mavlink.port import AutopilotPort
from auv_lse_run.process.interrupt import interrupts_postponed
from auv_lse_sim.emulated.autopilot_report import Report as State
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle
from benchmarks.faults.report import Report

SMALL = ("--seconds", "5")
VEHICLE = 2
#: The autopilot reports this often (1/s), and so fast a vehicle (m/s) comes nearer to its target.
REPORTS_HZ, SPEED_MPS = 10.0, 1.5
#: Rates under attack must reach this share of those before.
LEAST_SHARE = 0.9
#: The attacker's messages: random bytes, those of another system, those with the autopilot's ids signed with another
#: key, and recorded ones of the autopilot.
KINDS = ("garbage", "foreign ids", "bad signatures", "replays")
#: vehicle_link_node's timer (s).
_STEP_S = 0.05


def _autopilot(port: int, key: bytes, targets: Any, recorded: Any) -> None:
    """The simulated autopilot; counts the targets that it receives, and hands what it has sent to `recorded`."""
    vehicle = MavlinkVehicle(VEHICLE, (0.0, 0.0, 0.0), 15.0, None, lambda leg: None)
    vehicle._codec = codec = MavlinkCodec(VEHICLE, mavlink.MAV_COMP_ID_AUTOPILOT1, key)
    dock = MavlinkDock({VEHICLE: vehicle}, {VEHICLE: f"udpout://127.0.0.1:{port}"})
    began_s = next_s = time.monotonic()
    sent: list[bytes] = []
    encode = codec.encode

    def encoded(message: Any) -> bytes:
        data = encode(message)
        if len(sent) < 500:
            sent.append(data)
            if len(sent) == 500:
                recorded.put(list(sent))
        return data

    codec.encode = encoded  # type: ignore[method-assign]  # what a listener on the network would record
    while True:
        now_s, steady_s = time.time(), time.monotonic()
        codec.set_time(now_s)
        if steady_s >= next_s:
            next_s += 1.0 / REPORTS_HZ
            north_m = SPEED_MPS * (steady_s - began_s)
            state = State(heading_rad=0.0, north_m=north_m, east_m=0.0, depth_m=4.0, speed_mps=SPEED_MPS)
            dock.report(VEHICLE, now_s, state)
        select.select([dock], [], [], max(0.0, next_s - time.monotonic()))
        dock.serve(now_s)
        targets.value = vehicle.counts["targets"]


def _attacker(port: int, datagrams: Sequence[bytes], rate_hz: float, sent: Any) -> None:
    """Sends datagrams at a rate, in bursts every 10 ms, and counts them."""
    began_s, number = time.monotonic(), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while True:
            for _ in range(int((time.monotonic() - began_s) * rate_hz) - number):
                sender.sendto(datagrams[number % len(datagrams)], ("127.0.0.1", port))
                number += 1
            sent.value = number
            time.sleep(0.01)


def _datagrams(kind: str, recorded: Sequence[bytes], rng: random.Random) -> Sequence[bytes]:
    if kind == "garbage":
        return [rng.randbytes(rng.randrange(1, 1400)) for _ in range(1000)]
    if kind == "replays":
        return recorded
    codec = MavlinkCodec(77 if kind == "foreign ids" else VEHICLE, 1, rng.randbytes(32))
    codec.set_time(time.time())
    return [
        codec.encode(mavlink.MAVLink_local_position_ned_message(n, rng.random(), 0.0, 0.0, 0.0, 0.0, 0.0))
        for n in range(1000)
    ]


@dataclass(slots=True)
class Rates:
    """Traffic over the link in some seconds: odometry and targets (1/s), the longest gap in odometry (s), load."""

    odometry_hz: float
    targets_hz: float
    gap_s: float
    load: float


class _Link:
    """The link, driven as vehicle_link_node drives it, and its autopilot's process."""

    def __init__(self) -> None:
        key = secrets.token_bytes(32)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.udp_port = int(probe.getsockname()[1])
        config = LinkConfig(kind="mavlink", endpoint=f"udpin://127.0.0.1:{self.udp_port}")
        self.port = AutopilotPort(config, VEHICLE, None, key=key)
        context = multiprocessing.get_context("spawn")
        with interrupts_postponed():  # this process ends the others
            self._targets, recorded = context.Value("q", 0), context.Queue()
            arguments = (self.udp_port, key, self._targets, recorded)
            self._process = context.Process(target=_autopilot, args=arguments, daemon=True)
            self._process.start()
        self.measure(1.0)
        until_s = time.monotonic() + 60.0
        while recorded.empty():
            if time.monotonic() > until_s:
                raise RuntimeError(f"no autopilot after 60 s: {self.port.health().text}")
            self.measure(1.0)
        self.recorded: list[bytes] = recorded.get()
        self.port.link.command(time.time(), Target(north_m=1e5, east_m=0.0, depth_m=4.0, heading_rad=0.0))

    def measure(self, seconds: float) -> Rates:
        """Runs the link for a time."""
        before, began_s, cpu_s = self._targets.value, time.monotonic(), time.process_time()
        stamps = [began_s]
        while (steady_s := time.monotonic()) < began_s + seconds:
            events = self.port.step(time.time(), steady_s)
            stamps += [steady_s for event in events if isinstance(event, AutopilotEstimate)]
            if self.port.transport is not None:
                select.select([self.port.transport], [], [], _STEP_S)
        took_s = time.monotonic() - began_s
        gap_s = max((b - a for a, b in zip(stamps, [*stamps[1:], time.monotonic()], strict=True)), default=took_s)
        load = (time.process_time() - cpu_s) / took_s
        return Rates((len(stamps) - 1) / took_s, (self._targets.value - before) / took_s, gap_s, load)

    def close(self) -> None:
        """Ends the autopilot."""
        self._process.terminate()
        self._process.join()
        self.port.close(0.0, time.monotonic())


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `auv_lse faults flood`."""
    parser.add_argument(
        "--datagrams", type=positive, default=10_000.0, metavar="HZ", help="number per second (default: %(default)g)"
    )
    parser.add_argument(
        "--seconds", type=positive, default=10.0, metavar="S", help="of each flood (default: %(default)g)"
    )


def run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> Report:
    """The table of all floods."""
    rng, context = random.Random(options.seed), multiprocessing.get_context("spawn")
    lines = [
        "| flood | datagrams/s | odometry/s before, during | targets/s before, during | longest gap | processor |",
        "|---|---|---|---|---|---|",
    ]
    lost, worst_s = [], 0.0
    link = _Link()
    try:
        for kind in KINDS:
            before = link.measure(options.seconds / 2.0)
            sent = context.Value("q", 0)
            datagrams = _datagrams(kind, link.recorded, rng)
            attacker = context.Process(
                target=_attacker, args=(link.udp_port, datagrams, options.datagrams, sent), daemon=True
            )
            with interrupts_postponed():
                attacker.start()
            while not sent.value:
                link.measure(0.1)
            first, began_s = sent.value, time.monotonic()
            during = link.measure(options.seconds)
            rate_hz = (sent.value - first) / (time.monotonic() - began_s)
            attacker.terminate()
            attacker.join()
            lines.append(
                f"| {kind} | {rate_hz:.0f} | {before.odometry_hz:.1f}, {during.odometry_hz:.1f} | "
                f"{before.targets_hz:.1f}, {during.targets_hz:.1f} | {during.gap_s:.2f} s | "
                f"{before.load:.0%}, {during.load:.0%} |"
            )
            worst_s = max(worst_s, during.gap_s)
            for what in ("odometry", "targets"):
                was, now = getattr(before, f"{what}_hz"), getattr(during, f"{what}_hz")
                if now < LEAST_SHARE * was or not was:
                    lost.append(f"{kind}: {what} fell from {was:.1f} to {now:.1f} per second")
            say(f"{kind}: {rate_hz:.0f} datagrams/s, odometry {during.odometry_hz:.1f}/s")
        lines.append(f"diagnostics: {_counts(link.port.health().values)}")
    finally:
        link.close()
    broken = {line.split(":")[0] for line in lost}
    return Report(lines, tried=len(KINDS), survived=len(KINDS) - len(broken), worst_recovery_s=worst_s, lost=lost)


def _counts(values: Any) -> str:
    names = (
        "other_senders",
        "other_senders_unread",
        "wire bad",
        "wire unproven",
        "port full_reads",
        "port datagrams_dropped",
    )
    return ", ".join(f"{name} {values.get(name, 0)}" for name in names)
