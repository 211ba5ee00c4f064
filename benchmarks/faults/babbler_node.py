"""A babbling transmitter: far too many packets in the mates' names, as a vehicle's modem would read them."""

from __future__ import annotations

from types import TracebackType

import numpy as np
import rclpy

from auv_lse_common.topics.quality import EVERY
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.packet.codec import Packet, encode
from auv_lse_msgs.msg import ModemRx
from auv_lse_run.process.domain import dive_on


class Babbler:
    """A context that lets vehicle 1 receive what `babble` sends."""

    def __init__(self, domain: int, mates: int, seed: int) -> None:
        """Joins nothing yet.

        Args:
            domain: The mission's ROS domain.
            mates: How many mates' names are used, from vehicle 2.
            seed: Seed of the positions and depths in the packets.
        """
        self.sent = 0
        self._dive = dive_on(domain) or ""  # as if the modem had heard it
        self._domain, self._mates = domain, mates
        self._rng = np.random.default_rng(seed)

    def __enter__(self) -> Babbler:
        """Joins the mission's domain; signals stay the caller's."""
        self._context = rclpy.Context()
        rclpy.init(
            context=self._context, domain_id=self._domain, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO
        )
        self._node = rclpy.create_node("babbler", context=self._context)
        self._heard = self._node.create_publisher(ModemRx, "/auv1/modem/rx", EVERY)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves."""
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def babble(self, now_s: float) -> None:
        """One packet in each mate's name, received at `now_s` (s, by the mission's clock)."""
        for mate in range(2, 2 + self._mates):
            positions = self._rng.uniform(50.0, 500.0, (15, 2))
            plan = Plan.at(int(now_s / 15.7), np.array([0.3, *positions[0]]), (5,) * 10, NONE)
            payload = encode(Packet(plan, np.column_stack([positions, self._rng.uniform(10.0, 30.0, 15)])))
            message = ModemRx(source=mate, payload=payload, sent_s=now_s - 2.5, arrival_s=now_s - 2.0, travel_s=0.5)
            message.header.stamp.sec, message.header.stamp.nanosec = int(now_s), int(now_s % 1.0 * 1e9)
            message.header.frame_id, message.dive = "map", self._dive
            self._heard.publish(message)
            self.sent += 1
