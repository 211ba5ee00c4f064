"""The diagnostics that vehicle_link_node publishes about the autopilot."""

from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.targets.obedience import IGNORED_S


def silence_of(link: VehicleLink) -> str:
    """Why the autopilot is not heard, by what arrives, and the cure."""
    wire, senders = link.wire, link.senders
    if senders.is_sending:
        return "its other messages arrive, but no HEARTBEAT; make its router pass HEARTBEAT, too"
    if senders.is_unproven:
        return "signed messages arrive, but no answer to TIMESYNC: a replay, or the autopilot hears nothing"
    if senders.is_unsigned:
        return (
            "messages arrive without a signature or with another key's; give the autopilot the key "
            "(auv_lse autopilot-check --send-key)"
        )
    if senders.others:
        return "only other systems or components are heard (link.autopilot_system_id, or the vehicle's number)"
    if not link.counts["up"]:  # else port, speed and dialect were right
        if wire["unknown"] and not wire["bad"]:
            return "only messages of another MAVLink dialect arrive; the autopilot must send HEARTBEAT to this port"
        if wire["bad"] or link.counts["other_senders"]:
            return "what arrives is not MAVLink; check the port and its speed"
    return "nothing arrives; check power, cable and the autopilot's MAVLink endpoint"


def link_health(link: VehicleLink, port_problem: str) -> Health:
    """The state of the link and what the autopilot does with its targets; `port_problem`: why it is not heard."""
    values = {"mode": link.status.mode, "targets waiting": len(link.targets), **link.counts, **link.gauge.values}
    values |= {f"wire {name}": count for name, count in link.wire.items()}
    report = link.report
    if not report.heard:
        return Health(level=Level.ERROR, text=port_problem or f"no autopilot heard: {silence_of(link)}", values=values)
    found: list[tuple[Level, str]] = [(Level.OK, "armed" if link.status.armed else "not armed")]
    if not report.mode_obeys:
        obeying = " or ".join(map(str, link.obeying_modes))
        found.append((Level.OK, f"mode {link.status.mode} instead of {obeying} (link.modes)"))
    if report.problem and link.under_way:
        found.append((Level.WARN, "it follows no targets"))
    if link.refused_speed:
        found.append((Level.WARN, f"it refused the speed: {link.refused_speed}"))
    ignored_s, problem = link.problem
    if problem:
        found.append((Level.WARN if ignored_s < 2.0 * IGNORED_S else Level.ERROR, problem))
    if report.depth_problem:
        found.append((Level.WARN, report.depth_problem))
    if link.origin_problem:
        found.append((Level.ERROR, f"no odometry, no targets: {link.origin_problem}"))
    return Health(level=max(level for level, _ in found), text="; ".join(text for _, text in found), values=values)
