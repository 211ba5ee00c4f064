"""Tables of topics, lockstep phases, packages, parameters, summary keys and packet fields."""

import ast
import re
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameters import describe
from auv_lse_common.mission_file.sections.table import SECTIONS, VEHICLE_SECTIONS
from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.topics.table import MISSION_TOPICS, PHASES, TRUTH_TOPIC, VEHICLE_TOPICS, Topic, announces, waits_for
from auv_lse_common.vocabulary.mission_run import TRANSITIONS, Command, RunState
from auv_lse_comms.packet import fields
from auv_lse_comms.packet.codec import REASONS
from auv_lse_comms.packet.navigation import RAW, RAW_AND_FIX, SIZES
from auv_lse_shore.judge import summary
from auv_lse_shore.reference_pages.blocks import code, item, table


def _topic_row(name: str, topic: Topic) -> tuple[str, ...]:
    readers = ", ".join(code(reader.replace("|", " or ")) for reader in topic.readers)
    traits = [
        word
        for word, holds in (
            (topic.delivery, topic.delivery != "every"),
            ("command", topic.command),
            ("not recorded", not topic.recorded),
        )
        if holds
    ]
    return (
        code(name),
        code(topic.kind.removeprefix("auv_lse_msgs/msg/").replace("/msg/", "/")),
        topic.about,
        code(topic.writer.replace("|", " or ")),
        readers,
        ", ".join(traits),
    )


def topics() -> str:
    """Every topic: type, what it carries, writer, readers and traits."""
    head = ("topic", "type", "carries", "writer", "readers", "traits")
    vehicle = table(head, [_topic_row(name, topic) for name, topic in VEHICLE_TOPICS.items()])
    mission = [*MISSION_TOPICS.items(), ("/truth/auvN/odometry", TRUTH_TOPIC)]
    return (
        f"### Topics of a vehicle, under `/auvN`\n{vehicle}\n\n"
        f"### Topics of a mission\n{table(head, [_topic_row(name, topic) for name, topic in mission])}"
    )


def nodes() -> str:
    """Every node with an executable: its package, what it reads and what it writes, lockstep aside."""
    rows = []
    for setup in sorted(project_folder().glob("auv_lse_*/setup.py")):
        for node in re.findall(r"\b(\w+_node) = auv_lse", setup.read_text()):
            recorder = node == "recorder_node"
            named = {**VEHICLE_TOPICS, **MISSION_TOPICS}.items()
            shown = [(code(name), topic) for name, topic in named if not topic.lockstep and name != "/clock"]
            reads = [name for name, topic in shown if any(node in reader.split("|") for reader in topic.readers)]
            writes = [name for name, topic in shown if node in topic.writer.split("|")]
            reading = "every recorded topic" if recorder else ", ".join(reads)
            rows.append((code(node), code(setup.parent.name), reading, ", ".join(writes)))
    return table(("node", "package", "reads", "writes"), rows)


def phases() -> str:
    """The phases of a lockstep tick."""
    rows = [
        (
            code(name),
            code(phase.node),
            ", ".join(code(topic) for topic in waits_for(name)),
            ", ".join(code(topic) for topic in announces(name)),
            "yes" if phase.ends_tick else "",
        )
        for name, phase in PHASES.items()
    ]
    return table(("phase", "node", "waits for", "announces", "simulator waits for it"), rows)


def mission_states() -> str:
    """The next state of a mission by state and command; empty: it stays as it is."""
    rows = []
    for state in RunState:
        cells = []
        for moves in (TRANSITIONS[command] for command in Command):
            after = moves.get(state, state)
            cells.append("refused" if after is None else "" if after is state else after.name)
        rows.append((state.name, *cells))
    return table(("state", *(command.name for command in Command)), rows)


def _summary_of(init: Path) -> str:
    """The first sentence of a package's docstring, without its full stop."""
    text = ast.get_docstring(ast.parse(init.read_text())) or ""
    return " ".join(text.split("\n\n")[0].split()).rstrip(".")


def subpackages() -> str:
    """Packages and their subpackages, by their docstrings."""
    rows = []
    for package in sorted(project_folder().glob("auv_lse_*/auv_lse_*/__init__.py")):
        rows.append((f"**`{package.parent.name}`**", _summary_of(package)))
        for subpackage in sorted(package.parent.glob("*/__init__.py")):
            if text := _summary_of(subpackage):
                rows.append((code(subpackage.parent.name), text))
    return table(("package, subpackage", "what it holds"), rows)


def _shown(value: Any) -> str:
    """A parameter's default as YAML has it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(each) for each in value) + "]" if len(value) <= 4 else f"{len(value)} numbers"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _limits(allowed: str) -> str:
    """A range without blanks, as 0..1 or >0..1, or the choices."""
    if ", " in allowed:
        return f"of `{allowed.replace(', ', '|')}`"
    for words, sign in ((" to ", ".."), (" and at most ", ".."), ("above ", ">"), ("at least ", ">=")):
        allowed = allowed.replace(words, sign)
    return allowed


def parameters() -> str:
    """Every parameter, a list for each section: default, unit, range, meaning."""
    parts = []
    for section, cls in SECTIONS.items():
        lines = [f"### {section}"]
        if section in VEHICLE_SECTIONS:
            lines += ["Vehicles may differ.", ""]
        for name, default, unit, allowed, meaning in describe(cls, f"{section}."):
            value = " ".join(part for part in (code(_shown(default)), unit) if part)
            facts = ", ".join(part for part in (value, _limits(allowed)) if part)
            lines.append(item(f"{code(name)} ({facts}): {meaning}" if facts else f"{code(name)}: {meaning}"))
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def summary_keys() -> str:
    """Every key of summary.json with unit and meaning."""
    lines = []
    for key, unit, meaning in summary.table():
        lines.append(item(f"{code(key)} ({unit}): {meaning}" if unit else f"{code(key)}: {meaning}"))
    return "\n".join(lines)


def _field_row(field: fields.PacketField, repeated: str) -> tuple[str, ...]:
    at_path = field in (fields.TERMINAL, *fields.TOUR_HEADER[:1], *fields.PAIRS_HEADER[:1])
    low, high = (f"0x{int(v):02X}" if at_path else f"{v:.6g}" for v in (field.low, field.high))
    span = low if low == high else f"{low} to {high}"
    return repeated, code(field.name), field.type, field.unit, span, field.meaning


def packet_fields() -> str:
    """The fields of a packet in their order on the wire."""
    groups: tuple[tuple[str, tuple[fields.PacketField, ...]], ...] = (
        ("once", fields.HEADER),
        ("per action, up to 16", (fields.ACTION,)),
        ("or, for more actions: once", fields.PAIRS_HEADER),
        ("per two actions", (fields.PAIR,)),
        ("with a tour: once", fields.TOUR_HEADER),
        ("per segment", (fields.BEARING,)),
        ("with `mission.until` reached", (fields.QUALITY_REACHED,)),
        ("once", (fields.TERMINAL,)),
        ("per sample", fields.SAMPLE),
    )
    rows = [_field_row(field, repeated) for repeated, group in groups for field in group]
    return table(("how often", "field", "type", "unit", "range", "meaning"), rows)


def packet_sizes() -> str:
    """How many samples fit which plan, with and without navigation."""
    plans = (("3 actions", 3, 0), ("10 actions", 10, 0), ("3 actions, 50 segments", 3, 50), ("100 actions", 100, 0))
    rows = []
    for name, actions, segments in plans:
        paired = actions in fields.PAIRED
        cells = []
        for navigation in (0, SIZES[RAW], SIZES[RAW_AND_FIX]):
            samples = fields.capacity(actions, 0, segments, navigation, paired)
            spare = fields.PACKET_BYTES - fields.samples_start(actions, segments, navigation, paired)
            cells.append(f"{samples}, {spare - samples * fields.SAMPLE_BYTES}")
        first = fields.samples_start(actions, segments, 0, paired)
        rows.append((name, str(first), *cells))
    head = (
        "plan",
        "first sample at byte",
        "samples, spare bytes",
        "with dead-reckoned position",
        "with dead-reckoned position and fix",
    )
    return table(head, rows)


def packet_reasons() -> str:
    """Why a receiver rejects a packet."""
    return table(("reason", "meaning"), [(code(reason), meaning) for reason, meaning in REASONS.items()])
