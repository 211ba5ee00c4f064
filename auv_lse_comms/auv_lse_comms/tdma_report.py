"""The acoustic bridge's report of its schedule."""

from auv_lse_common.topics.records import TdmaReport
from auv_lse_comms.bridge import ModemBridge


def tdma_report(now_s: float, bridge: ModemBridge) -> TdmaReport:
    """The bridge's schedule and counts."""
    slot = bridge.tdma.slot(now_s)
    following = bridge.tdma.next_slot(now_s)
    counts = bridge.counts + bridge.quality.counts
    reasons = sorted(
        key for key in counts if key.startswith(("slots.missed.", "rejected.", "out_of_slot.", "in_slot_of."))
    )
    return TdmaReport(
        stamp_s=now_s,
        vehicle=bridge.address,
        slot_owner=slot.owner,
        own_slot=slot.owner == bridge.address,
        next_own_slot=float("nan") if following is None else following.start_s,
        slots_used=bridge.counts["slots.used"],
        slots_missed=sum(n for key, n in bridge.counts.items() if key.startswith("slots.missed.")),
        packets_received=bridge.counts["received"],
        reasons=tuple(reasons),
        counts=tuple(counts[key] for key in reasons),
    )
