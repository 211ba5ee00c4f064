"""Finds a fleet's problems before a dive in the vehicles' reports: one line each, with its cure. Pure."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from auv_lse_shore.remote.clocks import ClockOffset, wrong_clocks

#: Least space (MB) if the mission file does not say.
_LEAST_FREE_MB = 500.0
#: Age (s) of a position or state that is too old while nodes run.
_OLD_S = 10.0
#: Guard time (s) if no vehicle has a mission file.
_GUARD_S = 0.5
LEVELS = ("error", "warning")


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """A problem of a vehicle, the laptop or the fleet.

    Attributes:
        vehicle: The vehicle's name; "laptop"; "fleet" for all.
        level: "error" or "warning".
        text: What is wrong, and the cure.
    """

    vehicle: str
    level: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A vehicle's report; see `auv_lse_run/remote/facts.py`.

    Attributes:
        trouble: Why there is no report; "" if there is one.
        clock: Its clock; None without a report.
    """

    trouble: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    clock: ClockOffset | None = None


def judged(
    reports: Mapping[str, Report], version: str, sent: Mapping[str, str] | None = None, laptop: str = ""
) -> list[Problem]:
    """The problems of a fleet, by vehicle.

    Args:
        reports: By vehicle.
        version: The laptop's version of the software.
        sent: SHA-256 of the mission file that this laptop sent last, as {"mission.yaml": ...}; empty: none.
    """
    there = {name: report.facts for name, report in reports.items() if not report.trouble}
    found = [Problem(name, "error", report.trouble) for name, report in reports.items() if report.trouble]
    for name, facts in there.items():
        found += [Problem(name, level, text) for level, text in _vehicle_problems(name, facts, laptop)]
    found += _versions(there, version)
    found += _files(there, sent or {})
    found += _identities(there)
    guard_s = min(
        (float(f["mission"]["guard_s"]) for f in there.values() if f.get("mission", {}).get("guard_s")),
        default=_GUARD_S,
    )
    clocks = {name: report.clock for name, report in reports.items() if report.clock is not None}
    found += [Problem(name, level, text) for name, (level, text) in wrong_clocks(clocks, guard_s).items()]
    order = {name: k for k, name in enumerate(reports)}
    found = _merged(found, list(there))
    return sorted(found, key=lambda p: (order.get(p.vehicle, len(order)), LEVELS.index(p.level), p.text))


def _vehicle_problems(name: str, facts: Mapping[str, Any], laptop: str) -> list[tuple[str, str]]:
    """Problems of one vehicle by itself."""
    mission, errors = facts.get("mission", {}), []
    least_mb = float(mission.get("least_free_mb") or _LEAST_FREE_MB)
    if facts["problem"]:
        errors.append(facts["problem"])
    elif facts["free_mb"] < least_mb:
        errors.append(
            f"its disk has {facts['free_mb']:.0f} MB left, less than {least_mb:.0f} MB. Fetch its recordings and "
            "remove them: auv_lse fleet FILE fetch --delete"
        )
    if not facts["has_ros"]:
        errors.append("ROS 2 is not found by a login without a terminal. Set 'command' in the fleet file.")
    if mission.get("error"):
        errors.append(f"its mission file is refused: {mission['error']}")
    send = "Send it with the mission: auv_lse fleet FILE send MISSION.yaml"
    missing = [parameter for parameter, digest in mission.get("hashes", {}).items() if not digest]
    errors += [f"the file of {parameter} is missing there. {send}" for parameter in missing]
    if facts["domain_in_use"]:
        errors.append("its ROS domain is used by other nodes there. End them, or set 'domain' in the fleet file.")
    found = [("error", text) for text in errors]
    by = facts.get("controller") or {}
    if by and laptop and by["laptop"] != laptop:
        found.append(("warning", f"{by['name']} has commanded it since {by['at']}. To take over: --take-over"))
    found += [(f["level"], f"{f['part']}: {f['text']}") for f in facts.get("findings", ())]
    least_battery = float(mission.get("min_battery") or 0.0)
    return found + (running_problems(facts.get("state", {}), least_battery) if facts["running"] else [])


def running_problems(state: Mapping[str, Any], least_battery: float) -> list[tuple[str, str]]:
    """Level and text of each problem that running nodes report.

    Args:
        state: The vehicle's state, as `auv_lse_run/remote/mission_link.py` has it.
        least_battery: Charge (0 to 1) at which the mission surfaces; 0: unknown.
    """
    mission, position, autopilot = (state.get(name) or {} for name in ("mission", "position", "autopilot"))
    errors = []
    if not mission:
        errors.append("its nodes run, but safety_node reports no state. Look into the logs, or: stop, start")
    if not position or (position.get("age_s") or 0.0) > _OLD_S:
        errors.append("it has no position (no odometry). Wait for GPS at the surface; check the autopilot's link.")
    if autopilot and not autopilot["heard"]:
        errors.append("its autopilot is silent. Check link.endpoint and the autopilot's power.")
    errors += [f"a limit has tripped: {text}. Remove the cause, then: reset" for text in mission.get("limits", ())]
    found = [("error", text) for text in errors]
    battery = autopilot.get("battery")
    if battery is not None and battery < least_battery + 0.1:
        level, least = "error" if battery < least_battery else "warning", f"{100 * least_battery:.0f} %"
        text = f"its battery has {100 * battery:.0f} % left; the mission surfaces at {least}. Charge it."
        found.append((level, text))
    return found + [("warning", text) for text in (*mission.get("warnings", ()), *ill_health(state))]


def ill_health(state: Mapping[str, Any]) -> list[str]:
    """Problems that nodes report about their health, except a planner that waits because the mission does."""
    waits = f"the mission is {(state.get('mission') or {}).get('state')}"
    return [text for text in state.get("health", ()) if waits not in text]


def _versions(there: Mapping[str, Mapping[str, Any]], version: str) -> list[Problem]:
    other = {name: facts["version"] for name, facts in there.items() if facts["version"] != version}
    text = "it has version {} of auv_lse, the laptop {}. Install one on all."
    found = [Problem(name, "error", text.format(own, version)) for name, own in other.items()]
    commits = {name: facts["commit"] for name, facts in there.items() if facts["version"] == version}
    if len({commit for commit in commits.values() if commit}) > 1:
        listed = ", ".join(f"{name} {commit}" for name, commit in commits.items() if commit)
        text = f"the checkouts are at different commits: {listed}. Install one on all."
        found.append(Problem("fleet", "warning", text))
    return found


def _files(there: Mapping[str, Mapping[str, Any]], sent: Mapping[str, str]) -> list[Problem]:
    """Missions and keys that are missing or not equal."""
    found = []
    hashes = {name: facts["hashes"].get("mission.yaml", "") for name, facts in there.items() if not facts["problem"]}
    wanted = sent.get("mission.yaml") or _most(hashes.values())
    other = "the one that this laptop sent" if sent.get("mission.yaml") else "the others'"
    for name, digest in hashes.items():
        if not digest:
            text = "it has no mission file. Send one: auv_lse fleet FILE send MISSION.yaml"
            found.append(Problem(name, "error", text))
        elif digest != wanted:
            text = f"its mission file ({digest[:8]}) differs from {other} ({wanted[:8]}). Send it again."
            found.append(Problem(name, "error", text))
    for parameter in ("packet.key_file", "gp.survey_file"):
        has = {name: facts.get("mission", {}).get("hashes", {}).get(parameter, "") for name, facts in there.items()}
        most = _most(has.values())
        for name, digest in has.items():
            if digest and digest != most:
                text = f"its file of {parameter} ({digest[:8]}) differs from the others' ({most[:8]}). Send it again."
                found.append(Problem(name, "error", text))
    return found


def _identities(there: Mapping[str, Mapping[str, Any]]) -> list[Problem]:
    """Two names that lead to one folder of one computer."""
    by: dict[str, list[str]] = {}
    for name, facts in there.items():
        if facts.get("identity"):
            by.setdefault(facts["identity"], []).append(name)
    found = []
    for names in (names for names in by.values() if len(names) > 1):
        text = f"{' and '.join(names)} are one folder on one computer. Correct 'host' in the fleet file."
        found += [Problem(name, "error", text) for name in names]
    for name, facts in there.items():
        if (owner := facts.get("owner")) and owner != name:
            text = (
                f"its folder is that of {owner}, so two vehicles would have one number. Correct 'host' or 'folder' in "
                "the fleet file; if its number has changed, remove fleet/owner in its folder."
            )
            found.append(Problem(name, "error", text))
    return found


def _merged(found: list[Problem], names: list[str]) -> list[Problem]:
    """A problem that all vehicles have in the same words is one of the fleet."""
    by: dict[tuple[str, str], set[str]] = {}
    for problem in found:
        by.setdefault((problem.level, problem.text), set()).add(problem.vehicle)
    everywhere = {key for key, vehicles in by.items() if len(names) > 1 and vehicles >= set(names)}
    kept = [problem for problem in found if (problem.level, problem.text) not in everywhere]
    return kept + [Problem("fleet", level, text) for level, text in sorted(everywhere)]


def _most(values: Any) -> str:
    counts = Counter(value for value in values if value)
    return counts.most_common(1)[0][0] if counts else ""
