"""What a vehicle's acoustic bridge does in a tick: it takes what has come in, then composes what goes out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_comms.bridge import ModemBridge, Received
from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.ranging import UNTIMED, Timing


class BridgeIntake:
    """Soundings, packets and plans that wait for the bridge, and the order in which it takes them.

    Attributes:
        bridge: The bridge.
        gate: What own soundings pass before the bridge takes them.
        ranges: Ranges by pings, taken by the last `hear`.
        problems: What could not be used in the last `hear` or `say`, for the log.
    """

    def __init__(self, bridge: ModemBridge) -> None:
        """Nothing waits yet."""
        self.bridge = bridge
        self.gate = SoundingGate()
        self.ranges: list[MateNavigation] = []
        self.problems: list[str] = []
        self._soundings: list[Sequence[float]] = []
        self._packets: list[tuple[float, int, bytes, Timing]] = []
        self._answers: list[tuple[float, int, Timing]] = []
        self._raw: DeadReckoning | None = None
        self._fixes: list[Fix] = []
        self._plan: Plan | None = None

    def add_soundings(self, rows: Iterable[Sequence[float]]) -> None:
        """Own soundings: stamp (s), north, east, depth (m) of each, then raw north, east (m) where known."""
        self._soundings.extend(rows)

    def set_dead_reckoning(self, raw: DeadReckoning) -> None:
        """The vehicle's raw place; it replaces one that still waits."""
        self._raw = raw

    def add_fix(self, fix: Fix) -> None:
        """A fix of the vehicle's own."""
        self._fixes.append(fix)

    def add_packet(self, stamp_s: float, source: int, payload: bytes, timing: Timing = UNTIMED) -> None:
        """What the modem received: end of reception (s), number of the sender, the bytes, and when it was sent."""
        self._packets.append((stamp_s, source, payload, timing))

    def add_answer(self, stamp_s: float, source: int, timing: Timing) -> None:
        """The answer to a ping: the time for which it holds (s), the mate that answered, and how long sound took."""
        self._answers.append((stamp_s, source, timing))

    def set_plan(self, plan: Plan) -> None:
        """The vehicle's own plan; it replaces one that still waits."""
        self._plan = plan

    def hear(self) -> list[Received]:
        """The bridge takes own navigation and soundings, then packets by stamp and source; returns those it accepts."""
        self.problems = []
        bad, unplaced = self.bridge.counts["samples.bad"], self.bridge.counts["samples.unplaced"]
        if self._raw is not None:
            self.bridge.moved(self._raw)
            self._raw = None
        for fix in sorted(self._fixes, key=lambda fix: fix.stamp_s):
            self.bridge.fixed(fix)
        self._fixes = []
        if self._soundings:
            self.bridge.add_soundings(self.gate.passed(sorted(self._soundings, key=lambda row: row[0])))
            self._soundings = []
        if self.bridge.counts["samples.bad"] > bad:
            self.problems.append(
                f"soundings that are not finite: {self.bridge.counts['samples.bad']} so far, none is sent"
            )
        if self.bridge.counts["samples.unplaced"] > unplaced:
            self.problems.append(
                f"soundings without a raw place: {self.bridge.counts['samples.unplaced']} so far, none is sent; fix: a "
                "driver that gives raw_north_m and raw_east_m, or packet.navigation: false for the whole team"
            )
        packets, self._packets = sorted(self._packets, key=lambda packet: packet[:2]), []
        answers, self._answers = sorted(self._answers, key=lambda answer: answer[:2]), []
        ranges = (self.bridge.ranged(*answer) for answer in answers)
        self.ranges = [found for found in ranges if found is not None]
        heard = (self.bridge.receive(*packet) for packet in packets)
        return [received for received in heard if received is not None]

    def ping(self, now_s: float) -> int | None:
        """The mate to ping now, if it is time to."""
        return self.bridge.ping(now_s)

    def say(self, now_s: float) -> bytes | None:
        """The bridge takes the plan; returns the packet to send now, if it is the vehicle's slot."""
        self.problems = []
        plan, self._plan = self._plan, None
        if plan is not None:
            try:
                self.bridge.set_plan(plan)
            except PacketError as error:
                self.bridge.counts["plans.unsendable"] += 1
                self.problems.append(f"plan of step {plan.step} cannot be sent: {error}")
        return self.bridge.poll(now_s)
