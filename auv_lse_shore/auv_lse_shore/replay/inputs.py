"""What the nodes of each vehicle were given and what they decided, by a recording.

In lockstep a node took in each tick what the messages' own stamps say, so that the recording settles everything. In a
paced mission or at sea each decision tells what its planner had taken; what a map had is known only to about 0.1 s,
from the times at which the recorder heard the messages.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation, raw_place
from auv_lse_common.vocabulary.frames import heading_from_quaternion
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.vehicle.intake import Taken
from auv_lse_record.bag import FIX_FIELDS, MATE_FIELDS, Patterns, flown_parameters, is_ping, plan_of
from auv_lse_record.recording import SOFTWARE, Recording, RecordingError, recording_in

Array = NDArray[np.float64]

_TOPICS = re.compile(
    r"/[^/]*?(\d+)/(sounding|odometry|dead_reckoning|corrected|fix|kernel_centers|field|plan|waypoint|planner/bound|"
    r"team/plans|team/samples|team/navigation|modem/rx)"
)
_EVENTS = "/parameter_events"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDecision:
    """One decision as it was published.

    Attributes:
        now_s: Mission time of the decision.
        step: Step that the decided leg leads from.
        plan: The plan.
        leg: The leg decided; None if no waypoint was recorded.
        jbar: Value of the plan; NaN if it was not recorded.
        deadline_hit: Whether the deadline ended the search, so that it cannot be repeated.
        taken: What the planner had been given until then; None if it was not recorded.
    """

    now_s: float
    step: int
    plan: Plan
    leg: Leg | None
    jbar: float
    deadline_hit: bool
    taken: Taken | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedMap:
    """A map as it was published: arrays (ny, nx) of float32, NaN outside of the area."""

    now_s: float
    mean_m: Array
    std_m: Array
    risk: Array


@dataclass(slots=True)
class VehicleInputs:
    """One vehicle's inputs and outputs; each input begins with the time at which it was there (s).

    Attributes:
        vehicle: Its number.
        odometry: Stamp (s), heading (rad), north, east (m).
        corrected: Stamp (s), north, east (m) of the vehicle's place by its map.
        soundings: Stamp (s), north, east, depth, raw north, raw east (m); NaN where not known.
        navigation: Raw places, fixes, and what mates told of theirs.
        samples: Stamp (s), source, north, east, depth (m) of each sample (n, 3).
        plans: Stamp (s), source, plan.
        packets: Stamp (s), source, payload.
        centers: Revision, kernel centers.
        tuned: Parameters changed while the planner ran.
        maps: Maps published.
        decisions: Decisions published.
    """

    vehicle: int
    odometry: list[tuple[float, tuple[float, float, float, float]]] = field(default_factory=list)
    corrected: list[tuple[float, tuple[float, float, float]]] = field(default_factory=list)
    soundings: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    navigation: list[tuple[float, DeadReckoning | Fix | MateNavigation]] = field(default_factory=list)
    samples: list[tuple[float, tuple[float, int, Array]]] = field(default_factory=list)
    plans: list[tuple[float, tuple[float, int, Plan]]] = field(default_factory=list)
    packets: list[tuple[float, tuple[float, int, bytes]]] = field(default_factory=list)
    centers: list[tuple[float, tuple[int, Centers]]] = field(default_factory=list)
    tuned: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    maps: list[RecordedMap] = field(default_factory=list)
    decisions: list[RecordedDecision] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedInputs:
    """Everything that is needed to compute a mission's decisions again.

    Attributes:
        parameters: The mission file as flown.
        software: Version of the software that recorded it; "" if the recording does not say.
        lockstep: Whether time waited for the nodes.
        vehicles: Each vehicle's inputs, by number.
    """

    parameters: Patterns
    software: str
    lockstep: bool
    vehicles: Mapping[int, VehicleInputs]


def read_inputs(path: Path, mission: Path | None = None) -> RecordedInputs:
    """Reads a recording.

    Args:
        path: The run folder, the rosbag2 directory, or its file of messages.
        mission: The mission file that was flown, if the recording does not hold it.

    Raises:
        RecordingError: naming the recording and what is wrong.
        ParameterError: if the mission file is not a parameter file.
    """
    parameters = flown_parameters(path, mission)
    lockstep = bool(parameters_for(parameters, "/auv1/gp_node").get("sim", {}).get("lockstep", False))
    gathered: dict[int, _Gathered] = {}
    with Recording(recording_in(path)) as recording:
        software = recording.text(SOFTWARE) or ""
        for topic, log_ns, message in recording.messages(re.compile(f"{_TOPICS.pattern}|{_EVENTS}")):
            if topic == _EVENTS:
                number = re.fullmatch(r"/[^/]*?(\d+)/planner_node", message.node)
                if number is not None:
                    changed = {p.name: _value(p.value) for p in message.changed_parameters}
                    gathered.setdefault(int(number[1]), _Gathered(int(number[1]))).tuned(log_ns * 1e-9, changed)
                continue
            match = _TOPICS.fullmatch(topic)
            assert match is not None
            number_of = int(match[1])
            stamp_s = seconds(message.header.stamp)
            there_s = stamp_s if lockstep else log_ns * 1e-9
            gathered.setdefault(number_of, _Gathered(number_of)).take(match[2], stamp_s, there_s, message)
    if not gathered:
        raise RecordingError(f"{path}: holds no topic /auvN/...; expected the recording of a mission")
    vehicles = {number: gathered[number].inputs() for number in sorted(gathered)}
    return RecordedInputs(parameters=parameters, software=software, lockstep=lockstep, vehicles=vehicles)


class _Gathered:
    """One vehicle's messages; decisions are put together from three topics with one stamp."""

    def __init__(self, number: int) -> None:
        self._found = VehicleInputs(number)
        self._plans: dict[float, Plan] = {}
        self._legs: dict[float, Leg] = {}
        self._bounds: dict[float, Any] = {}

    def tuned(self, there_s: float, changed: dict[str, Any]) -> None:
        """Parameters changed by hand while the node ran."""
        own = {name: value for name, value in changed.items() if name.startswith("planner.")}
        if own:
            self._found.tuned.append((there_s, own))

    def take(self, name: str, stamp_s: float, there_s: float, m: Any) -> None:
        """A message of the vehicle's topic `name`, there at `there_s`."""
        found = self._found
        match name:
            case "sounding":
                raw = raw_place(getattr(m, "raw_north_m", math.nan), getattr(m, "raw_east_m", math.nan))  # not in older
                found.soundings.append((there_s, (stamp_s, m.north_m, m.east_m, m.depth_m, *raw)))
            case "dead_reckoning":
                p, q = m.pose.pose.position, m.pose.pose.orientation
                heading = heading_from_quaternion(q.x, q.y, q.z, q.w)
                place = DeadReckoning(stamp_s=stamp_s, heading_rad=heading, north_m=p.y, east_m=p.x, depth_m=-p.z)
                found.navigation.append((there_s, place))
            case "fix":
                fix = Fix(stamp_s=stamp_s, **{key: getattr(m, key) for key in FIX_FIELDS})
                found.navigation.append((there_s, fix))
            case "team/navigation":
                values = {key: getattr(m, key) for key in MATE_FIELDS}
                told = MateNavigation(stamp_s=stamp_s, source=int(m.source), **values)
                found.navigation.append((there_s, told))
            case "odometry":
                p, q = m.pose.pose.position, m.pose.pose.orientation
                heading = heading_from_quaternion(q.x, q.y, q.z, q.w)
                found.odometry.append((there_s, (stamp_s, heading, p.y, p.x)))
            case "corrected":
                found.corrected.append((there_s, (stamp_s, m.pose.pose.position.y, m.pose.pose.position.x)))
            case "team/samples":
                rows = np.column_stack([np.asarray(c, dtype=float) for c in (m.north_m, m.east_m, m.depth_m)])
                found.samples.append((there_s, (stamp_s, int(m.source), rows)))
            case "team/plans":
                found.plans.append((there_s, (stamp_s, int(m.vehicle), plan_of(m))))
            case "modem/rx" if not is_ping(m):
                found.packets.append((there_s, (stamp_s, int(m.source), bytes(m.payload))))
            case "kernel_centers":
                places = np.column_stack([m.north_m, m.east_m])
                modes = getattr(m, "place_modes", 0)
                effect = np.asarray(m.place_effect_m, dtype=float).reshape(-1, modes) if modes else None
                centers = Centers(places, np.asarray(m.depth_m), np.asarray(m.noise_std_m), effect)
                found.centers.append((stamp_s, (int(m.revision), centers)))
            case "field":
                shape = (m.rows, m.columns)
                mean, std, risk = (np.asarray(v).reshape(shape) for v in (m.mean_m, m.std_m, m.risk))
                found.maps.append(RecordedMap(now_s=stamp_s, mean_m=mean, std_m=std, risk=risk))
            case "plan":
                self._plans[stamp_s] = plan_of(m)
            case "waypoint":
                self._legs[stamp_s] = _leg_of(m)
            case "planner/bound":
                self._bounds[stamp_s] = m

    def _there(self, there_s: float, entry: DeadReckoning | Fix | MateNavigation) -> float:
        """When an entry was there: what a mate told is stamped at the start of a reception, and is there at its end."""
        if not isinstance(entry, MateNavigation) or there_s != entry.stamp_s:
            return there_s
        plans = self._found.plans
        ends = [end_s for end_s, (_, source, _) in plans if source == entry.source and end_s >= there_s - 0.1]
        return min(ends, default=there_s)

    def inputs(self) -> VehicleInputs:
        """What was gathered, each in order of time."""
        found = self._found
        found.navigation = [(self._there(there_s, entry), entry) for there_s, entry in found.navigation]
        found.navigation.sort(key=lambda entry: entry[0])
        for entries in (
            found.odometry,
            found.corrected,
            found.soundings,
            found.samples,
            found.plans,
            found.packets,
            found.centers,
        ):
            entries.sort(key=lambda entry: entry[0])
        for now_s in sorted(self._plans):
            plan, bound = self._plans[now_s], self._bounds.get(now_s)
            found.decisions.append(
                RecordedDecision(
                    now_s=now_s,
                    step=plan.step if bound is None else int(bound.step),
                    plan=plan,
                    leg=self._legs.get(now_s),
                    jbar=float("nan") if bound is None else float(bound.jbar),
                    deadline_hit=bound is not None and bool(bound.deadline_hit),
                    taken=_taken(bound),
                )
            )
        return found


def _leg_of(message: Any) -> Leg:
    """The leg of a recorded Waypoint message; older ones know of no surfacing."""
    return Leg(
        step=int(message.step),
        heading_rad=float(message.start_heading_rad),
        north_m=float(message.start_north_m),
        east_m=float(message.start_east_m),
        action_rad=float(message.turn_rad),
        radius_m=float(message.turn_radius_m),
        straight_m=float(message.straight_m),
        surface=bool(getattr(message, "surface", False)),
    )


def _taken(bound: Any) -> Taken | None:
    """What a planner had taken, by its Bound message; None for one of before such were told, or of the fleet engine."""
    odometry = getattr(bound, "odometry_taken", None)
    if odometry is None or not (seconds(odometry) or bound.map_revision or bound.plans_heard):
        return None
    return Taken(
        map_revision=int(bound.map_revision), plans=int(bound.plans_heard), odometry_s=float(seconds(odometry))
    )


def ticks_of(inputs: VehicleInputs) -> Iterable[float]:
    """The ticks of a lockstep mission (s): the vehicle's odometry comes once in each."""
    return sorted({stamp_s for stamp_s, _ in inputs.odometry})


def _value(value: Any) -> Any:
    """The value of a recorded rcl_interfaces/msg/ParameterValue."""
    fields = ("", "bool_value", "integer_value", "double_value", "string_value", "byte_array_value",
              "bool_array_value", "integer_array_value", "double_array_value", "string_array_value")  # fmt: skip
    if not 0 < value.type < len(fields):
        return None
    found = getattr(value, fields[value.type])
    return [v.item() if hasattr(v, "item") else v for v in found] if value.type > 4 else found
