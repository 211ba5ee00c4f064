"""What modem_node's diagnostics say about the acoustic link."""

from __future__ import annotations

from collections.abc import Mapping

from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_comms.bridge import ModemBridge


def bridge_problems(bridge: ModemBridge, now_s: float) -> dict[str, str]:
    """What an operator should know, a text for each problem, by its key."""
    found = bridge.quality.problems(now_s)
    if bridge.unconfirmed:
        found["unconfirmed"] = (
            f"modem: it has not confirmed the last {bridge.unconfirmed} packets, whose samples wait again: is "
            "micromodem_node running?"
        )
    if bridge.abort and not bridge.abort_counts:
        found["abort"] = (
            "team: mates do not obey its call to abort, which has no tag; fix: packet.tag, or "
            "packet.abort_without_tag, for the whole team"
        )
    return found


def bridge_health(bridge: ModemBridge, problems: Mapping[str, str]) -> Health:
    """The state of the acoustic link.

    Args:
        bridge: The bridge.
        problems: What `bridge_problems` says now.
    """
    values = {**bridge.counts, **bridge.quality.counts, "samples.unsent": bridge.unsent, "loss": f"{bridge.loss:.2f}"}
    level = Level.WARN if problems else Level.OK
    return Health(level=level, text="; ".join(problems.values()) or "ok", values=values)
