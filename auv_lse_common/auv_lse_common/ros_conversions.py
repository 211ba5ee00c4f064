"""What every node of the stack does the same way: parameters, stamps, qualities of service, main."""

from __future__ import annotations

import array
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from auv_lse_common.params import ParameterError, check_sections, merge, nest, to_mapping
from auv_lse_common.plan import Plan
from auv_lse_msgs.msg import Plan as PlanMessage

#: Every message counts: reliable, and room for a burst (depth 1 drops bursts).
EVERY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
#: For a state that is soon replaced: also hears drivers that publish with ROS's sensor QoS (best effort).
NEWEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
#: The last message also reaches readers that come later (latched).
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides")

#: In lockstep, wall clock (s) without a simulator after which a node says what it waits for.
_NO_SIMULATOR_S = 30.0


def stamp(seconds: float) -> Time:
    """ROS time of seconds since the clock's epoch, to the nearest nanosecond."""
    nanoseconds = round(seconds * 1e9)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds(time: Time) -> float:
    """Seconds since the clock's epoch of a ROS time."""
    return float(time.sec) + time.nanosec * 1e-9


def header(now_s: float) -> Header:
    """Header in the map frame (ENU) with the stamp `now_s`."""
    return Header(stamp=stamp(now_s), frame_id="map")


def doubles(values: Any) -> array.array:
    """A float64[] field's value from a NumPy array, without a Python loop."""
    return array.array("d", values.astype("f8").tobytes())


def floats(values: Any) -> array.array:
    """A float32[] field's value from a NumPy array, without a Python loop."""
    return array.array("f", values.astype("f4").tobytes())


def diagnostics(now_s: float, node: str, level: bytes, message: str, values: Mapping[str, Any]) -> DiagnosticArray:
    """A DiagnosticArray with one status of `node`."""
    status = DiagnosticStatus(
        level=level,
        name=node,
        message=message,
        hardware_id="auv_lse",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(now_s), status=[status])


def plan_message(now_s: float, vehicle: int, plan: Plan) -> PlanMessage:
    """Plan message of a vehicle's plan."""
    return PlanMessage(
        header=header(now_s),
        vehicle=vehicle,
        step=plan.step,
        heading_rad=plan.heading_rad,
        north_m=plan.north_m,
        east_m=plan.east_m,
        actions=list(plan.actions),
        naive_path=plan.naive_path,
    )


def plan_from_message(message: PlanMessage) -> Plan:
    """The plan of a Plan message."""
    return Plan(
        step=message.step,
        heading_rad=message.heading_rad,
        north_m=message.north_m,
        east_m=message.east_m,
        actions=tuple(message.actions),
        naive_path=message.naive_path,
    )


class ConfiguredNode(Node):
    """A node whose parameters come strictly from the mission's file and are all visible once it runs."""

    def __init__(self, name: str) -> None:
        """Reads the parameters given to the node; refuses a top-level section that nobody owns."""
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.where = f"parameters of {self.get_fully_qualified_name()}"
        flat = {key: p.value for key, p in self.get_parameters_by_prefix("").items()}
        own = {key: list(v) if isinstance(v, array.array) else v for key, v in flat.items()}
        self.parameters = nest({k: v for k, v in own.items() if k.split(".")[0] not in _ROS_OWN})
        check_sections(self.parameters, self.where)
        self._tunable: tuple[str, ...] = ()
        self._apply: Callable[[dict[str, Any]], None] | None = None
        if self.lockstep:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._lonely = self.create_timer(_NO_SIMULATOR_S, self._look_for_simulator, clock=steady)

    def _look_for_simulator(self) -> None:
        """Lockstep: says once that nobody gives the ticks that this node waits for."""
        if self.count_publishers("/lockstep/tick") == 0:
            self._lonely.cancel()
            self.get_logger().warning(
                f"sim.lockstep is true, but no simulator has been there for {_NO_SIMULATOR_S:g} s: this node does "
                "nothing until a tick comes; on a vehicle expected sim.lockstep: false (or no section sim)"
            )

    @property
    def lockstep(self) -> bool:
        """True if the simulator leads this node tick by tick (`sim.lockstep`)."""
        return bool(self.parameters.get("sim", {}).get("lockstep", False))

    @property
    def recorded(self) -> int:
        """1 if a recorder reads along in this mission (`record.folder` is set), else 0."""
        return int(bool(self.parameters.get("record", {}).get("folder", "")))

    @property
    def vehicle(self) -> int:
        """Number of the vehicle, from the namespace (/auv2 -> 2).

        Raises:
            ParameterError: if the namespace does not end in a number from 1 to 255.
        """
        namespace = self.get_namespace()
        digits = namespace[len(namespace.rstrip("0123456789")) :]
        if not digits or not 1 <= int(digits) <= 255:
            raise ParameterError(
                f"namespace {namespace!r} of {self.get_name()}: expected one that ends in the vehicle's number, "
                f"as /auv1 (ros2 run ... --ros-args -r __ns:=/auv1)"
            )
        return int(digits)

    def now_s(self) -> float:
        """Seconds of the node's ROS clock."""
        return self.get_clock().now().nanoseconds * 1e-9

    def when_matched(self, readers: Mapping[Publisher, int], then: Callable[[], None]) -> None:
        """Calls `then` once each publisher has at least its number of matched readers (discovery takes up to 3 s)."""
        checks = 0

        def check() -> None:
            nonlocal checks
            checks += 1
            waiting = {p.topic: f"{p.get_subscription_count()} of {n}" for p, n in readers.items()}
            waiting = {topic: text for topic, text in waiting.items() if int(text.split()[0]) < int(text.split()[2])}
            if not waiting:
                timer.cancel()
                then()
            elif checks % 200 == 0:  # every 10 s
                self.get_logger().warning(f"still waiting for readers of {waiting}")

        timer = self.create_timer(0.05, check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def show_parameters(
        self,
        sections: Mapping[str, Any],
        tunable: tuple[str, ...] = (),
        apply: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:
        """Declares every parameter of the checked `sections` with its value, and lets the `tunable` ones change.

        A tunable one without a value ("as the method says") is declared as not set, so that it can be set.

        Args:
            sections: {section: its configuration}.
            tunable: Full names ("planner.iterations") that may change while the node runs.
            apply: Called with all parameters, nested, when tunable ones change; raises ValueError to refuse.
        """
        self._tunable, self._apply = tunable, apply
        for name, config in sections.items():
            for key, value in _flatten(to_mapping(config), name).items():
                if not self.has_parameter(key):
                    self.declare_parameter(key, value, ParameterDescriptor(read_only=key not in tunable))
            self.parameters = merge(self.parameters, {name: to_mapping(config)})
        for key in tunable:
            if not self.has_parameter(key):
                self.declare_parameter(key, None, ParameterDescriptor(dynamic_typing=True))
        self.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        changed = {p.name: p.value for p in changes if p.name.split(".")[0] not in _ROS_OWN}
        for name in changed:
            if name not in self._tunable:
                reason = (
                    f"{name} takes effect only at the start of the node; tunable: {', '.join(self._tunable) or 'none'}"
                )
                return SetParametersResult(successful=False, reason=reason)
            if changed[name] is None:
                reason = f"{name} cannot be unset while the node runs; expected a value"
                return SetParametersResult(successful=False, reason=reason)
        if changed and self._apply is not None:
            wanted = merge(self.parameters, nest(changed))
            try:
                self._apply(wanted)
            except ValueError as error:  # an exception that leaves this callback would end the node
                return SetParametersResult(successful=False, reason=str(error))
            self.parameters = wanted
        return SetParametersResult(successful=True)


def _flatten(nested: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        name = f"{prefix}.{key}"
        flat.update(_flatten(value, name) if isinstance(value, Mapping) else {name: value})
    return flat


def run(make: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """A node's main: makes it, spins it until SIGINT, SIGTERM or shutdown, and cleans up.

    Returns:
        Exit code: 0 after an ordinary end, 2 if the node could not be made from its parameters.
    """
    if arguments is None:
        arguments = sys.argv
    if "-h" in arguments or "--help" in arguments:
        print(f"{make.__doc__ or ''}\nParameters: --ros-args --params-file MISSION.yaml -r __ns:=/auv1")
        return 0
    # A parent that ignores SIGINT (a script in the background) hands that on: take it back.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rclpy.init(args=arguments)
    node: Node | None = None
    try:
        try:
            node = make()
        except ParameterError:
            raise
        except ValueError as error:  # a part that checks its own arguments: here they come from the parameters
            raise ParameterError(str(error)) from error
        rclpy.spin(node)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        # A second Ctrl-C while closing must not lose what is being written.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
