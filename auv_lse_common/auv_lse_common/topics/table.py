"""The topics of a mission in one table: name, type, delivery, readers, writer, lockstep phases, encoding.

Nodes, recorder, replay, live page, lockstep and the reference of topics derive from it. To add a topic or a reader, add
a row or an entry here (docs/extending/adding-a-topic.md).
"""

import functools
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics import codecs, map_codecs, plan_codecs
from auv_lse_common.topics.codecs import Decode, Encode, encode_record, packet_decoder, record_decoder
from auv_lse_common.topics.records import BoundReport, Reception, SimReport, TdmaReport, Transmission
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.map_quality import Quality

#: Kinds of delivery. "every": reliably. "newest": only the newest one matters, so readers accept best-effort
#: writers such as ROS drivers (in lockstep as "every"). "latched": late readers receive the last message.
Delivery = Literal["every", "newest", "latched"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """A node's work in every tick of lockstep.

    Attributes:
        ends_tick: Whether the simulator waits for it before the next tick.
        counts: Further counts in `LockstepDone.totals`, after those of the phase's topics (`announces`).
    """

    node: str
    ends_tick: bool = False
    counts: tuple[str, ...] = ()


#: The phases of a tick, by `LockstepDone.phase`; "vehicle_link" and "micromodem" only where these drivers run.
#: "targets" counts the targets sent to the autopilot, and "waypoint" the waypoints taken for them. "micromodem_lost"
#: follows each packet that was not transmitted.
PHASES = {
    "modem": Phase(node="modem_node"),
    "gp": Phase(node="gp_node"),
    "safety": Phase(node="safety_node", ends_tick=True),
    "planner": Phase(node="planner_node", ends_tick=True),
    "modem_sent": Phase(node="modem_node", ends_tick=True),
    "vehicle_link": Phase(node="vehicle_link_node", ends_tick=True, counts=("targets", "waypoint")),
    "micromodem": Phase(node="micromodem_node", ends_tick=True),
    "micromodem_lost": Phase(node="micromodem_node", ends_tick=True, counts=("modem/failed",)),
    "recorder": Phase(node="recorder_node", ends_tick=True),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic.

    Attributes:
        name: Its name below the vehicle's namespace; a topic of the whole mission has its full name.
        kind: Its ROS type.
        about: Its content, for the reference.
        writer: The node that writes it. "a|b": b only where a does not run; "": several nodes, or operators.
        readers: The nodes of the stack that read it, except the recorder; "a|b" as above.
        recorded: Whether the recorder subscribes to it from the start.
        ration: Share of `record.map_bytes_per_s` that is recorded of it; 0: every message is recorded.
        recorded_with: A rationed topic of the same vehicle; it is recorded at the stamps of that topic only.
        command: Whether hardware acts on it, so that a replay leaves it out.
        phase: Lockstep: the phase after which its writer announces the number of published messages.
        tick_count: Lockstep: the field of LockstepTick with that number, if the simulator writes the topic.
        awaited_by: Lockstep: phases that begin only when all announced messages have arrived.
        total: Lockstep: returns the number of messages up to a given one, where later ones replace earlier ones; None:
            counts messages.
        encode: Returns a message's fields for a value and the vehicle's number; None: its nodes make the messages.
        decode: Returns the value of a message, received or recorded.
    """

    name: str = ""
    kind: str
    about: str = ""
    writer: str = ""
    readers: tuple[str, ...] = ()
    delivery: Delivery = "every"
    recorded: bool = True
    ration: float = 0.0
    recorded_with: str = ""
    command: bool = False
    phase: str = ""
    tick_count: str = ""
    awaited_by: tuple[str, ...] = ()
    total: Callable[[Any], int] | None = None
    encode: Encode | None = None
    decode: Decode | None = None

    @property
    def latched(self) -> bool:
        """Whether late readers receive the last message."""
        return self.delivery == "latched"

    @property
    def lockstep(self) -> bool:
        """Whether it belongs to lockstep itself: not recorded, not part of a vehicle's security policy."""
        return self.kind in (_DONE, _TICK)

    @property
    def is_standard(self) -> bool:
        """Whether its messages are of a standard type, without a field for the id of the dive."""
        return not self.kind.startswith("auv_lse_msgs/")


_DONE, _TICK = "auv_lse_msgs/msg/LockstepDone", "auv_lse_msgs/msg/LockstepTick"
_decode_sent = packet_decoder(Transmission)

_ROWS = (
    Topic(
        name="sounding", kind="auv_lse_msgs/msg/Sounding", about="one measurement of water depth",
        writer="sim_node|vehicle_link_node", readers=("gp_node", "modem_node"),
        tick_count="soundings", awaited_by=("modem", "gp"),
        encode=codecs.encode_sounding, decode=codecs.decode_sounding,
    ),
    Topic(
        name="odometry", kind="nav_msgs/msg/Odometry", about="the vehicle's estimated position",
        writer="vehicle_link_node|sim_node", readers=("planner_node", "safety_node"), delivery="newest",
        tick_count="odometries", awaited_by=("safety", "planner", "vehicle_link"),
        encode=codecs.encode_odometry, decode=codecs.decode_odometry,
    ),
    Topic(
        name="dead_reckoning", kind="nav_msgs/msg/Odometry", about="the position by dead reckoning, without fixes",
        writer="vehicle_link_node|sim_node", readers=("gp_node", "modem_node"),
        tick_count="dead_reckonings", awaited_by=("modem", "gp"),
        encode=codecs.encode_dead_reckoning, decode=codecs.decode_dead_reckoning,
    ),
    Topic(
        name="fix", kind="auv_lse_msgs/msg/Fix", about="a GPS position, taken at the surface",
        writer="vehicle_link_node|sim_node", readers=("gp_node", "modem_node"),
        tick_count="fixes", awaited_by=("modem", "gp"), encode=encode_record, decode=record_decoder(Fix),
    ),
    Topic(
        name="navsat", kind="sensor_msgs/msg/NavSatFix", about="`odometry` on Earth, if the origin is known",
        writer="vehicle_link_node|sim_node", encode=codecs.encode_geodetic,
    ),
    Topic(
        name="altitude", kind="sensor_msgs/msg/Range", about="height over ground",
        writer="vehicle_link_node|sim_node", readers=("safety_node",), delivery="newest",
        tick_count="odometries", awaited_by=("safety",),
        encode=codecs.encode_altitude, decode=codecs.decode_altitude,
    ),
    Topic(
        name="pressure", kind="sensor_msgs/msg/FluidPressure", about="absolute pressure of the water",
        writer="vehicle_link_node|sim_node", encode=codecs.encode_pressure, decode=codecs.decode_pressure,
    ),
    Topic(
        name="autopilot", kind="auv_lse_msgs/msg/AutopilotStatus", about="mode and state of the autopilot",
        writer="vehicle_link_node", readers=("safety_node",), delivery="latched",
        encode=codecs.encode_autopilot, decode=record_decoder(AutopilotReport),
    ),
    Topic(
        name="mission/command", kind="auv_lse_msgs/msg/MissionCommand", about="a command to this vehicle's mission",
        readers=("safety_node",), command=True, tick_count="commands", awaited_by=("safety",),
        total=lambda message: int(message.number), encode=encode_record, decode=codecs.decode_order,
    ),
    Topic(
        name="mission/end", kind="auv_lse_msgs/msg/MissionCommand", about="END: the vehicle's last leg is complete",
        writer="planner_node", readers=("safety_node",), command=True,
        encode=encode_record, decode=codecs.decode_order,
    ),
    Topic(
        name="mission/state", kind="auv_lse_msgs/msg/MissionState", about="state of the mission, and the action",
        writer="safety_node", readers=("gp_node", "planner_node", "modem_node", "vehicle_link_node|sim_node"),
        delivery="latched", command=True, phase="safety", awaited_by=("gp", "planner", "modem_sent", "vehicle_link"),
        total=lambda message: int(message.revision), encode=plan_codecs.encode_run, decode=plan_codecs.decode_run,
    ),
    Topic(
        name="kernel_centers", kind="auv_lse_msgs/msg/KernelCenters", about="the whole map as kernel centers",
        writer="gp_node", readers=("planner_node",), delivery="latched", phase="gp", awaited_by=("planner",),
        total=lambda message: int(message.revision) + 1,  # revisions count from 0
        recorded_with="field",
        encode=map_codecs.encode_centers, decode=map_codecs.decode_centers,
    ),
    Topic(
        name="corrected", kind="nav_msgs/msg/Odometry", about="the vehicle's position, corrected by its map",
        writer="gp_node", readers=("planner_node",), delivery="newest", phase="gp", awaited_by=("planner",),
        encode=codecs.encode_odometry, decode=codecs.decode_corrected,
    ),
    Topic(
        name="map/quality", kind="auv_lse_msgs/msg/MapQuality", about="with `mission.until`: the map's quality",
        writer="gp_node", readers=("planner_node",), delivery="latched", phase="gp", awaited_by=("planner",),
        encode=encode_record, decode=record_decoder(Quality),
    ),
    Topic(
        name="field", kind="auv_lse_msgs/msg/LevelSetField", about="the map on a grid: depth, error, risk",
        writer="gp_node", delivery="latched", ration=1.0,
        encode=map_codecs.encode_field, decode=map_codecs.decode_field,
    ),
    Topic(
        name="risk_map", kind="nav_msgs/msg/OccupancyGrid", about="risk in percent of the largest, for viewers",
        writer="gp_node", delivery="latched", recorded_with="field", encode=map_codecs.encode_risk_map,
    ),
    Topic(
        name="isobath", kind="visualization_msgs/msg/Marker", about="isobath and edges of its band, for viewers",
        writer="gp_node", recorded_with="field", encode=map_codecs.encode_isobath,
    ),
    Topic(
        name="plan", kind="auv_lse_msgs/msg/Plan", about="the vehicle's plan to the end of its mission",
        writer="planner_node", readers=("modem_node",), delivery="latched", phase="planner", awaited_by=("modem_sent",),
        encode=plan_codecs.encode_plan, decode=plan_codecs.decode_plan,
    ),
    Topic(
        name="path", kind="nav_msgs/msg/Path", about="the plan as poses, for viewers", writer="planner_node",
        ration=0.035, encode=plan_codecs.encode_path,
    ),
    Topic(
        name="waypoint", kind="auv_lse_msgs/msg/Waypoint", about="the next leg to travel", writer="planner_node",
        readers=("vehicle_link_node|sim_node",), delivery="latched", command=True, phase="planner",
        encode=plan_codecs.encode_waypoint, decode=plan_codecs.decode_waypoint,
    ),
    Topic(
        name="planner/bound", kind="auv_lse_msgs/msg/Bound", about="value and lower bound of each decision",
        writer="planner_node", encode=encode_record, decode=record_decoder(BoundReport),
    ),
    Topic(
        name="modem/tx", kind="auv_lse_msgs/msg/ModemTx", about="a packet to send, or a ping", writer="modem_node",
        readers=("micromodem_node|sim_node",), command=True, phase="modem_sent",
        encode=encode_record, decode=_decode_sent,
    ),
    Topic(
        name="modem/rx", kind="auv_lse_msgs/msg/ModemRx", about="a packet received, or a ping answered",
        writer="micromodem_node|sim_node", readers=("modem_node",), tick_count="arrivals", awaited_by=("modem",),
        encode=encode_record, decode=packet_decoder(Reception),
    ),
    Topic(
        name="modem/sent", kind="auv_lse_msgs/msg/ModemTx", about="the packet with this stamp was sent",
        writer="micromodem_node", readers=("modem_node",), decode=_decode_sent,
    ),
    Topic(
        name="modem/failed", kind="auv_lse_msgs/msg/ModemTx", about="the packet with this stamp was not sent",
        writer="micromodem_node", readers=("modem_node",), recorded=False, phase="micromodem", decode=_decode_sent,
    ),
    Topic(
        name="team/plans", kind="auv_lse_msgs/msg/Plan", about="a team mate's plan", writer="modem_node",
        readers=("planner_node",), phase="modem", awaited_by=("planner",),
        encode=plan_codecs.encode_plan, decode=plan_codecs.decode_plan,
    ),
    Topic(
        name="team/samples", kind="auv_lse_msgs/msg/SampleArray", about="a team mate's depth samples",
        writer="modem_node", readers=("gp_node",), phase="modem", awaited_by=("gp",),
        encode=codecs.encode_samples, decode=codecs.decode_samples,
    ),
    Topic(
        name="team/navigation", kind="auv_lse_msgs/msg/MateNavigation", about="navigation data of a received packet",
        writer="modem_node", readers=("gp_node",), phase="modem", awaited_by=("gp",),
        encode=codecs.encode_mate_navigation, decode=codecs.decode_mate_navigation,
    ),
    Topic(
        name="team/command", kind="auv_lse_msgs/msg/MissionCommand", about="a team mate's call to abort",
        writer="modem_node", readers=("safety_node",), command=True, phase="modem", awaited_by=("safety",),
        encode=encode_record, decode=codecs.decode_order,
    ),
    Topic(
        name="packets", kind="visualization_msgs/msg/Marker", about="lines from senders of packets, for viewers",
        writer="modem_node", recorded=False, encode=plan_codecs.encode_packet_line,
    ),
    Topic(
        name="tdma", kind="auv_lse_msgs/msg/TdmaStatus", about="slots, and counts of packets", writer="modem_node",
        encode=encode_record, decode=record_decoder(TdmaReport),
    ),
    Topic(
        name="dive", kind="auv_lse_msgs/msg/Dive", about="the dive of each node that publishes standard messages",
        readers=("gp_node", "planner_node", "safety_node", "modem_node"), delivery="latched",
    ),
    Topic(
        name="diagnostics", kind="diagnostic_msgs/msg/DiagnosticArray", about="health of each node and device",
        encode=codecs.encode_health, decode=codecs.decode_health,
    ),
)  # fmt: skip

_VEHICLE_NODES = ("gp_node", "safety_node", "planner_node", "modem_node", "micromodem_node", "vehicle_link_node")

_MISSION_ROWS = (
    Topic(name="/clock", kind="rosgraph_msgs/msg/Clock", about="simulated time", writer="sim_node",
          readers=_VEHICLE_NODES),
    Topic(name="/mission/command", kind="auv_lse_msgs/msg/MissionCommand", about="a command to every vehicle's mission",
          readers=("sim_node",), command=True),
    Topic(name="/sim/status", kind="auv_lse_msgs/msg/SimStatus", about="progress of a simulated mission",
          writer="sim_node", delivery="latched", encode=encode_record, decode=record_decoder(SimReport)),
    Topic(name="/lockstep/tick", kind=_TICK, about="a tick: how many messages the simulator has published",
          writer="sim_node", readers=(*_VEHICLE_NODES, "recorder_node"), recorded=False),
    Topic(name="/lockstep/done", kind=_DONE, about="a phase is handled, for the simulator", readers=("sim_node",),
          recorded=False),
)  # fmt: skip


@functools.cache
def announces(phase: str) -> tuple[str, ...]:
    """The counts in `LockstepDone.totals` after a phase, in this order: published messages by topic."""
    return (*(row.name for row in _ROWS if row.phase == phase), *PHASES[phase].counts)


def waits_for(phase: str) -> tuple[str, ...]:
    """Topics whose announced messages must have arrived before a phase begins."""
    return tuple(row.name for row in _ROWS if phase in row.awaited_by)


def _phase_row(phase: str) -> Topic | None:
    """The topic that announces a phase's end to the vehicle's other nodes; None if no node waits for it."""
    awaiting = {by for row in _ROWS if row.name in announces(phase) for by in row.awaited_by}
    readers = tuple(dict.fromkeys(PHASES[by].node for by in PHASES if by in awaiting))
    if not readers:
        return None
    about = f'phase "{phase}" is handled'
    node = PHASES[phase].node
    return Topic(
        name=f"lockstep/{phase}", kind=_DONE, about=about, writer=node, readers=readers, recorded=False
    )  # fmt: skip


#: Topics of one vehicle, by their name below its namespace. "lockstep/PHASE" announces a phase's end.
VEHICLE_TOPICS = {row.name: row for row in (*_ROWS, *map(_phase_row, PHASES)) if row is not None}
#: Topics of the whole mission; the nodes of all vehicles are readers.
MISSION_TOPICS = {row.name: row for row in _MISSION_ROWS}
#: True position of a simulated vehicle, on /truth/auvN/odometry.
TRUTH_TOPIC = Topic(
    name="truth/odometry", kind="nav_msgs/msg/Odometry", about="a simulated vehicle's true position", writer="sim_node",
    encode=codecs.encode_odometry, decode=codecs.decode_odometry,
)  # fmt: skip


class Found(NamedTuple):
    """A topic by its full name, and the vehicle it belongs to (0: the whole mission)."""

    topic: Topic
    vehicle: int


@functools.cache
def find_topic(full_name: str) -> Found | None:
    """The row of a topic by its full name, "/auv2/plan"; None for topics outside the stack."""
    if full_name in MISSION_TOPICS:
        return Found(MISSION_TOPICS[full_name], 0)
    match = re.fullmatch(r"(/truth)?/[^/]*?(\d+)/(.+)", full_name)
    if match is None:
        return None
    if match[1]:
        return Found(TRUTH_TOPIC, int(match[2])) if match[3] == "odometry" else None
    row = VEHICLE_TOPICS.get(match[3])
    return None if row is None else Found(row, int(match[2]))


def full_name(topic: Topic, vehicle: int) -> str:
    """The full name of a topic in the mission of vehicles /auv1, /auv2, ..."""
    if topic is TRUTH_TOPIC:
        return f"/truth/auv{vehicle}/odometry"
    return topic.name if topic.name.startswith("/") else f"/auv{vehicle}/{topic.name}"


def reader_count(topic: Topic, nodes: Sequence[str], together: Collection[str] = ()) -> int:
    """Number of running nodes that read the topic.

    Args:
        nodes: Names of the running nodes: of one vehicle (and "sim_node") for a vehicle's topic, else of all.
        together: Names of nodes that share a process in each vehicle, which reads a topic once.
    """
    present = [next((name for name in reader.split("|") if name in nodes), "") for reader in topic.readers]
    shared = max((nodes.count(name) for name in present if name in together), default=0)
    return shared + sum(nodes.count(name) for name in present if name not in together)


def recorded_topics(vehicles: int) -> dict[str, Topic]:
    """The topics that the recorder subscribes to from the start, by full name."""
    topics = {name: topic for name, topic in MISSION_TOPICS.items() if topic.recorded}
    for vehicle in range(1, vehicles + 1):
        rows = (*VEHICLE_TOPICS.values(), TRUTH_TOPIC)
        topics |= {full_name(row, vehicle): row for row in rows if row.recorded}
    return topics
