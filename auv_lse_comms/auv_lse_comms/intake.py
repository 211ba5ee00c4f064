"""One tick of a vehicle's acoustic bridge: it processes its inputs, then composes its packet."""

from collections.abc import Iterable

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_comms.bridge import ModemBridge, Received
from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.ranging import UNTIMED, Timing


class BridgeIntake:
    """Queues the bridge's inputs and passes them on in a fixed order.

    Attributes:
        gate: Filter for own soundings.
        ranges: Ranges from pings, found by the last `process`.
        problems: Inputs that were unusable in the last `process` or `poll`, for the log.
    """

    def __init__(self, bridge: ModemBridge) -> None:
        self.bridge = bridge
        self.gate = SoundingGate()
        self.ranges: list[MateNavigation] = []
        self.problems: list[str] = []
        self._soundings: list[Sounding] = []
        self._packets: list[tuple[float, int, bytes, Timing]] = []
        self._answers: list[tuple[float, int, Timing]] = []
        self._raw: DeadReckoning | None = None
        self._fixes: list[Fix] = []
        self._plan: Plan | None = None

    def add_soundings(self, soundings: Iterable[Sounding]) -> None:
        """Queues own soundings."""
        self._soundings.extend(soundings)

    def set_dead_reckoning(self, raw: DeadReckoning) -> None:
        """Sets the vehicle's dead-reckoned position, replacing a waiting one."""
        self._raw = raw

    def add_fix(self, fix: Fix) -> None:
        """Queues a fix of this vehicle."""
        self._fixes.append(fix)

    def add_packet(self, stamp_s: float, source: int, payload: bytes, timing: Timing = UNTIMED) -> None:
        """Queues a received packet: end of reception (s), the sender's number, its bytes and its timing."""
        self._packets.append((stamp_s, source, payload, timing))

    def add_answer(self, stamp_s: float, source: int, timing: Timing) -> None:
        """Queues the answer to a ping: the time at which its range applies (s), the mate's number and the timing."""
        self._answers.append((stamp_s, source, timing))

    def set_plan(self, plan: Plan) -> None:
        """Sets the vehicle's own plan, replacing a waiting one."""
        self._plan = plan

    def process(self) -> list[Received]:
        """Passes own navigation and soundings to the bridge, then packets by stamp and source; returns the accepted."""
        self.problems = []
        bridge, counts = self.bridge, self.bridge.counts
        bad, unplaced = counts["samples.bad"], counts["samples.unplaced"]
        if self._raw is not None:
            bridge.set_dead_reckoning(self._raw)
            self._raw = None
        for fix in sorted(self._fixes, key=lambda fix: fix.stamp_s):
            bridge.set_fix(fix)
        self._fixes = []
        if self._soundings:
            bridge.add_soundings(self.gate.passed(sorted(self._soundings, key=lambda sounding: sounding[0])))
            self._soundings = []
        if counts["samples.bad"] > bad:
            self.problems.append(f"soundings that are not finite are not sent: {counts['samples.bad']} so far")
        if counts["samples.unplaced"] > unplaced:
            self.problems.append(
                f"soundings without a dead-reckoned position are not sent: {counts['samples.unplaced']} so far; use a "
                "driver that sets raw_north_m and raw_east_m, or set packet.navigation: false for the whole team"
            )
        packets, self._packets = sorted(self._packets, key=lambda packet: packet[:2]), []
        answers, self._answers = sorted(self._answers, key=lambda answer: answer[:2]), []
        self.ranges = [found for answer in answers if (found := bridge.ranged(*answer)) is not None]
        heard = [received for packet in packets if (received := bridge.receive(*packet)) is not None]
        return [*bridge.waited(), *heard]

    def poll(self, now_s: float) -> bytes | None:
        """Passes the plan to the bridge; returns the packet to send now, if it is the vehicle's slot."""
        self.problems = []
        plan, self._plan = self._plan, None
        if plan is not None:
            try:
                self.bridge.set_plan(plan)
            except PacketError as error:
                self.bridge.counts["plans.unsendable"] += 1
                self.problems.append(f"plan of step {plan.step} does not fit a packet: {error}")
        return self.bridge.poll(now_s)
