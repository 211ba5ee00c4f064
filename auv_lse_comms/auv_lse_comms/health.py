"""The diagnostics that modem_node publishes about the acoustic link."""

from collections.abc import Mapping

from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_comms.bridge import ModemBridge


def bridge_problems(bridge: ModemBridge, now_s: float) -> dict[str, str]:
    """Problems for the operator: texts by key."""
    found = bridge.quality.problems(now_s)
    if bridge.unconfirmed:
        found["unconfirmed"] = (
            f"modem: the last {bridge.unconfirmed} packets were not confirmed and their samples requeued; check that "
            "micromodem_node is running"
        )
    if bridge.abort_calls.own and not bridge.abort_calls.allowed:
        found["abort"] = (
            "team: mates ignore this vehicle's call to abort, because it has no tag; set packet.tag, or "
            "packet.abort_without_tag, for the whole team"
        )
    return found


def bridge_health(bridge: ModemBridge, problems: Mapping[str, str]) -> Health:
    """The state of the acoustic link, with the result of `bridge_problems`."""
    values = {**bridge.counts, **bridge.quality.counts, "samples.unsent": bridge.unsent, "loss": f"{bridge.loss:.2f}"}
    level = Level.WARN if problems else Level.OK
    return Health(level=level, text="; ".join(problems.values()) or "ok", values=values)
