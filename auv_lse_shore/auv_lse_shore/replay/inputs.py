"""Reads the inputs and decisions of each vehicle's nodes from a recording.

In lockstep the stamps of the messages determine a node's inputs in each tick. In a paced mission or at sea each
decision reports its planner's inputs. A map's inputs are known only to about 0.1 s, from the recorder's reception
times.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.retired import notes_on_retired, without_retired
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.topics.records import (
    BoundReport,
    CentersReport,
    FieldReport,
    Odometry,
    PlanReport,
    Reception,
    RunReport,
)
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition, DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_planner.vehicle.intake import InputsUsed
from auv_lse_record.recording import SOFTWARE, Recording, RecordingError, recording_in
from auv_lse_record.run_reader import Patterns, recorded_parameters
from auv_lse_shore.areas.area_file import read_area

#: Topics that inputs and outputs are read from.
_TOPICS = {
    "sounding",
    "odometry",
    "dead_reckoning",
    "corrected",
    "fix",
    "kernel_centers",
    "map/quality",
    "mission/state",
    "field",
    "plan",
    "waypoint",
    "planner/bound",
    "team/plans",
    "team/samples",
    "team/navigation",
    "modem/rx",
}
_PARAMETER_EVENTS = "/parameter_events"

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDecision:
    """One decision as it was published.

    Attributes:
        now_s: Mission time of the decision.
        step: Step that the decided leg leads from.
        leg: The leg decided; None if no waypoint was recorded.
        jbar: Value of the plan; NaN if it was not recorded.
        deadline_hit: Whether the deadline ended the search, so that it cannot be repeated.
        taken: Inputs of the planner up to then; None if not recorded.
    """

    now_s: float
    step: int
    plan: Plan
    leg: Leg | None
    jbar: float
    deadline_hit: bool
    taken: InputsUsed | None = None


@dataclass(slots=True)
class VehicleInputs:
    """One vehicle's inputs and outputs; each input has the time (s) at which the node received it.

    Attributes:
        odometry: The vehicle's navigation.
        corrected: Its position, corrected by its map.
        navigation: Dead-reckoned positions, fixes, and what mates reported of theirs.
        samples: The team's samples, packet by packet.
        centers: Kernel centers; the time is that of their publication.
        states: The mission's states: while it does not run, legs are not timed.
        tuned: Parameters changed while the planner ran.
    """

    vehicle: int
    odometry: list[tuple[float, Odometry]] = field(default_factory=list)
    corrected: list[tuple[float, CorrectedPosition]] = field(default_factory=list)
    soundings: list[tuple[float, Sounding]] = field(default_factory=list)
    navigation: list[tuple[float, DeadReckoning | Fix | MateNavigation]] = field(default_factory=list)
    samples: list[tuple[float, Soundings]] = field(default_factory=list)
    plans: list[tuple[float, PlanReport]] = field(default_factory=list)
    packets: list[tuple[float, Reception]] = field(default_factory=list)
    centers: list[tuple[float, CentersReport]] = field(default_factory=list)
    qualities: list[tuple[float, Quality]] = field(default_factory=list)
    states: list[tuple[float, RunReport]] = field(default_factory=list)
    tuned: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    maps: list[FieldReport] = field(default_factory=list)
    decisions: list[RecordedDecision] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedInputs:
    """The inputs from which a mission's decisions can be recomputed.

    Attributes:
        parameters: The mission file as flown.
        notes: What this version reads differently in it.
        software: Version of the software that recorded it; "" if not recorded.
        lockstep: Whether time waited for the nodes.
        vehicles: Each vehicle's inputs, by number.
    """

    parameters: Patterns
    notes: list[str]
    software: str
    lockstep: bool
    vehicles: Mapping[int, VehicleInputs]


class Pending(Generic[T]):
    """Inputs in order of time, taken one after another.

    Attributes:
        taken: How many have been taken.
    """

    def __init__(self, entries: Sequence[tuple[float, T]]) -> None:
        """Args: entries: inputs, each with the time (s) at which the node received it."""
        self._entries = entries
        self.taken = 0

    @property
    def next_s(self) -> float:
        """Time of the next input (s); infinite after the last one."""
        return self._entries[self.taken][0] if self.taken < len(self._entries) else math.inf

    def take(self, ready: Callable[[float, T], bool]) -> Iterator[T]:
        """Pops the next inputs for as long as `ready(time (s), value)` holds."""
        while self.taken < len(self._entries) and ready(*self._entries[self.taken]):
            self.taken += 1
            yield self._entries[self.taken - 1][1]


def read_inputs(path: Path, mission: Path | None = None) -> RecordedInputs:
    """Reads a recording.

    Args:
        path: The run folder, the rosbag2 directory, or its file of messages.
        mission: The mission file that was flown, if the recording does not hold it.

    Raises:
        RecordingError: naming the recording and what is wrong.
        ParameterError: if the mission file is not a parameter file.
    """
    as_recorded = recorded_parameters(path, mission, read_area)
    parameters = without_retired(as_recorded)
    lockstep = bool(parameters_for(parameters, "/auv1/gp_node").get("sim", {}).get("lockstep", False))
    gathered: dict[int, _Gathered] = {}
    with Recording(recording_in(path)) as recording:
        software = recording.text(SOFTWARE) or ""
        for recorded in recording.values(_TOPICS):
            received_s = recorded.stamp_s if lockstep else recorded.log_ns * 1e-9
            vehicle = gathered.setdefault(recorded.vehicle, _Gathered(recorded.vehicle))
            vehicle.take(recorded.topic.name, recorded.stamp_s, received_s, recorded.value)
        for _, log_ns, message in recording.messages({_PARAMETER_EVENTS}):
            node = re.fullmatch(r"/[^/]*?(\d+)/planner_node", message.node)
            if node is not None:
                number = int(node[1])
                own = parameters_for(parameters, f"/auv{number}/planner_node").get("planner", {})
                gathered.setdefault(number, _Gathered(number)).tune(log_ns * 1e-9, _tuned(message, own))
    if not gathered:
        raise RecordingError(f"{path} holds no topic /auvN/...; name the recording of a mission")
    vehicles = {number: gathered[number].inputs() for number in sorted(gathered)}
    return RecordedInputs(
        parameters=parameters,
        notes=notes_on_retired(as_recorded),
        software=software,
        lockstep=lockstep,
        vehicles=vehicles,
    )


def _tuned(message: Any, own: Mapping[str, Any]) -> dict[str, Any]:
    """The planner's parameters that an event changes, of those that this version has.

    A parameter that the method sets has no value before its first change, which ROS reports as new. It also reports
    every parameter of a node that starts as new; these have the mission file's values, `own`.
    """
    known = {f"planner.{f.name}": own.get(f.name) for f in fields(PlannerConfig)}
    new = {p.name: _value(p.value) for p in message.new_parameters if known.get(p.name) is None}
    changed = {p.name: _value(p.value) for p in message.changed_parameters}
    return {name: value for name, value in (new | changed).items() if name in known and value is not None}


class _Gathered:
    """One vehicle's values; decisions are put together from three topics with one stamp."""

    def __init__(self, number: int) -> None:
        self._found = found = VehicleInputs(number)
        self._plans: dict[float, Plan] = {}
        self._legs: dict[float, Leg] = {}
        self._bounds: dict[float, BoundReport] = {}
        self._inputs: dict[str, list[tuple[float, Any]]] = {
            "sounding": found.soundings,
            "odometry": found.odometry,
            "corrected": found.corrected,
            "map/quality": found.qualities,
            "mission/state": found.states,
            "dead_reckoning": found.navigation,
            "fix": found.navigation,
            "team/navigation": found.navigation,
            "team/samples": found.samples,
            "team/plans": found.plans,
        }

    def tune(self, received_s: float, changed: dict[str, Any]) -> None:
        """Applies parameters changed by hand while the node ran."""
        if changed:
            self._found.tuned.append((received_s, changed))

    def take(self, name: str, stamp_s: float, received_s: float, value: Any) -> None:
        """Applies a value of the vehicle's topic `name`, received at `received_s` (s)."""
        match name:
            case "modem/rx":
                if not value.ping:
                    self._found.packets.append((received_s, value))
            case "kernel_centers":
                self._found.centers.append((stamp_s, value))
            case "field":
                self._found.maps.append(value)
            case "plan":
                self._plans[stamp_s] = value.plan
            case "waypoint":
                self._legs[stamp_s] = value.leg
            case "planner/bound":
                self._bounds[stamp_s] = value
            case _:
                self._inputs[name].append((received_s, value))

    def _reception_s(self, received_s: float, entry: DeadReckoning | Fix | MateNavigation) -> float:
        """When the node received an entry (s); a mate's entry is stamped at the start of its reception."""
        if not isinstance(entry, MateNavigation) or received_s != entry.stamp_s:
            return received_s
        ends = [
            end_s for end_s, plan in self._found.plans if plan.vehicle == entry.source and end_s >= received_s - 0.1
        ]
        return min(ends, default=received_s)

    def inputs(self) -> VehicleInputs:
        """The values, each kind in order of time."""
        found = self._found
        found.navigation = [(self._reception_s(received_s, entry), entry) for received_s, entry in found.navigation]
        entries: list[Any]
        for entries in (
            found.navigation, found.odometry, found.corrected, found.soundings, found.samples, found.plans,
            found.packets, found.centers, found.qualities, found.states,
        ):  # fmt: skip
            entries.sort(key=lambda entry: entry[0])
        for now_s in sorted(self._plans):
            plan, bound = self._plans[now_s], self._bounds.get(now_s)
            found.decisions.append(
                RecordedDecision(
                    now_s=now_s,
                    step=plan.step if bound is None else bound.step,
                    plan=plan,
                    leg=self._legs.get(now_s),
                    jbar=math.nan if bound is None else bound.jbar,
                    deadline_hit=bound is not None and bound.deadline_hit,
                    taken=_taken(bound),
                )
            )
        return found


def _taken(bound: BoundReport | None) -> InputsUsed | None:
    """A planner's inputs as its bound reports them; None if not reported (older recordings, the fleet engine)."""
    if bound is None or not (bound.odometry_taken or bound.map_revision or bound.plans_heard):
        return None
    return InputsUsed(map_revision=bound.map_revision, plans=bound.plans_heard, odometry_s=bound.odometry_taken)


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
