"""Messages of the acoustic bridge."""

from __future__ import annotations

import numpy as np

from auv_lse_common.topics.ros_conversions import floats, header
from auv_lse_comms.bridge import ModemBridge, Received
from auv_lse_msgs.msg import ModemTx, SampleArray, TdmaStatus


def team_samples(received: Received) -> SampleArray:
    """Samples of the team mate that sent the packet."""
    samples = np.asarray(received.packet.samples)
    return SampleArray(
        header=header(received.stamp_s),
        source=received.source,
        north_m=floats(samples[:, 0]),
        east_m=floats(samples[:, 1]),
        depth_m=floats(samples[:, 2]),
    )


def transmission(now_s: float, source: int, payload: bytes) -> ModemTx:
    """ModemTx of a payload, to all, or to `modem.destination` if the driver has one."""
    return ModemTx(header=header(now_s), source=source, payload=payload)


def ping(now_s: float, source: int, destination: int) -> ModemTx:
    """ModemTx that asks for a ping of the mate `destination`."""
    return ModemTx(header=header(now_s), source=source, destination=destination, ping=True)


def tdma_status(now_s: float, bridge: ModemBridge) -> TdmaStatus:
    """The bridge's schedule and counts."""
    slot = bridge.tdma.slot(now_s)
    following = bridge.tdma.next_slot(now_s)
    happened = bridge.counts + bridge.quality.counts
    reasons = sorted(
        key for key in happened if key.startswith(("slots.missed.", "rejected.", "out_of_slot.", "in_slot_of."))
    )
    return TdmaStatus(
        header=header(now_s),
        vehicle=bridge.address,
        slot_owner=slot.owner,
        own_slot=slot.owner == bridge.address,
        next_own_slot=float("nan") if following is None else following.start_s,
        slots_used=bridge.counts["slots.used"],
        slots_missed=sum(n for key, n in bridge.counts.items() if key.startswith("slots.missed.")),
        packets_received=bridge.counts["received"],
        reasons=reasons,
        counts=[happened[key] for key in reasons],
    )
