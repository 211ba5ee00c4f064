"""A node that inspects other nodes: names, endpoints, messages, parameters."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.support.confinement import NETWORK_VARIABLES, is_confined
from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_run.process.domain import domains_with_participants

#: Discovery is complete when the graph has not changed for `_QUIET_S` and every participant has had time to announce
#: itself, by default every 3 s. A node or topic that a command names may be found earlier, after `_LEAST_S`.
_QUIET_S, _LEAST_S, _ANNOUNCED_S, _MOST_S = 0.5, 1.0, 3.2, 4.2
#: rmw's name of a node whose participant is known and whose name has not arrived.
_UNNAMED = "_NODE_NAME_UNKNOWN_"
_ANSWER_S = 5.0
#: What `ROS_AUTOMATIC_DISCOVERY_RANGE` finds, by value.
_RANGES = {
    "SUBNET": "nodes of this subnet",
    "LOCALHOST": "nodes of this computer and of the named peers",
    "SYSTEM_DEFAULT": "what the DDS profile allows",
}


class GraphError(RuntimeError):
    """A node, topic or parameter does not exist, or does not answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """A publisher or subscription of a topic.

    Attributes:
        node: Name of its node, "" if not known.
        kind: "PUBLISHER" or "SUBSCRIPTION".
        type_hash: Hash of the message type, "" if not known.
        gid: Its address in DDS, bytes in hexadecimal.
        qos: Lines of its quality of service.
        profile: Its quality of service, as rclpy has it.
    """

    node: str
    namespace: str
    kind: str
    type: str
    type_hash: str
    gid: str
    qos: tuple[str, ...]
    profile: Any

    @property
    def full_name(self) -> str:
        """The node's full name."""
        return f"{self.namespace.rstrip('/')}/{self.node}"


class Graph:
    """A context that joins the environment's ROS domain and discovers its nodes.

    Attributes:
        missing: What the discovery was still waiting for when it timed out; "" if it is complete.
        took_s: Duration (s) of the discovery.
    """

    def __init__(self, spin_s: float | None = None, wanted: str = "", at_once: bool = False) -> None:
        """Sets how long to discover.

        Args:
            spin_s: Duration (s) of the discovery; None: until nothing new appears, at most 4.2 s.
            wanted: Full name of a node or topic, which ends the discovery early; "": all are wanted.
            at_once: Whether entering the context skips the discovery; the caller then calls `discover`.
        """
        self._spin_s, self._wanted, self._at_once = spin_s, wanted, at_once
        self.missing, self.took_s = "", 0.0

    def __enter__(self) -> Graph:
        """Joins the domain and discovers the nodes; the caller keeps handling Ctrl-C."""
        rclpy.init(args=init_arguments(), signal_handler_options=SignalHandlerOptions.NO)
        # A name that begins with an underscore is hidden from `list`.
        self.node = rclpy.create_node(f"_auv_lse_inspect_{os.getpid()}", start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        if not self._at_once:
            self.discover(self._spin_s)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def discover(self, spin_s: float | None = None, is_done: Callable[[], bool] = lambda: False) -> None:
        """Discovers nodes until nothing new appears, and sets `missing`.

        Args:
            spin_s: Duration (s) of the discovery; None: until nothing new appears, at most 4.2 s.
            is_done: Called every 0.05 s; returns whether to end the discovery early.
        """
        self.missing = ""
        began = changed = time.monotonic()
        seen: Any = None
        while not is_done():
            self.spin(0.05)
            found = nodes, topics = self.nodes(hidden=True), self.topics(hidden=True)
            now = time.monotonic()
            if found != seen:
                seen, changed = found, now
            took_s, is_changing = now - began, now - changed < _QUIET_S
            self.took_s = took_s
            if spin_s is None and took_s >= _LEAST_S and not is_changing:
                if self._wanted and (self._wanted in nodes or self._wanted in topics):
                    return
                if took_s >= _ANNOUNCED_S and not self._unnamed():
                    return
            if took_s >= (_MOST_S if spin_s is None else spin_s):
                self.missing = self._unnamed() or ("nodes or topics that are just appearing" if is_changing else "")
                return

    def _unnamed(self) -> str:
        """The participants whose endpoints are known and whose nodes' names are not, "" if there are none."""
        by = self.node
        found = [
            (bytes(info.endpoint_gid[:12]), topic)
            for topic in self.topics(hidden=True)
            for info in (*by.get_publishers_info_by_topic(topic), *by.get_subscriptions_info_by_topic(topic))
            if info.node_name == _UNNAMED
        ]
        number, topics = len({participant for participant, _ in found}), sorted({topic for _, topic in found})
        return f"node names of {number} participant{'s' * (number > 1)} on {', '.join(topics[:3])}" if found else ""

    def spin(self, seconds: float) -> None:
        """Handles messages for `seconds`."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def services(self) -> list[str]:
        """Full names of the services, also of those that are only called; known earlier than the nodes' names."""
        return sorted(name for name, _ in self.node.get_service_names_and_types())

    # ------------------------------------------------------------------ topics

    def topics(self, hidden: bool = False) -> dict[str, tuple[str, ...]]:
        """The types of each topic, by name."""
        found = self.node.get_topic_names_and_types()
        return {name: tuple(kinds) for name, kinds in sorted(found) if hidden or not _is_hidden(name)}

    def endpoints(self, topic: str) -> tuple[list[Endpoint], list[Endpoint]]:
        """Publishers and subscriptions of a topic, without this node's own."""
        pairs = (self.node.get_publishers_info_by_topic(topic), self.node.get_subscriptions_info_by_topic(topic))
        publishers, subscriptions = ([e for i in infos if (e := _endpoint(i)) is not None] for infos in pairs)
        me = self.node.get_name()
        return [e for e in publishers if e.node != me], [e for e in subscriptions if e.node != me]

    def message_type(self, topic: str, wanted: str | None = None) -> type | None:
        """The class of a topic's messages; None if the topic does not exist and no type is given.

        Raises:
            GraphError: if the type is not installed, or the topic has several.
        """
        if wanted is None:
            kinds = self.topics(hidden=True).get(topic, ())
            if len(kinds) > 1:
                raise GraphError(f"{topic} has several types: {', '.join(kinds)}. Add one after the topic")
            if not kinds:
                return None
            wanted = kinds[0]
        package, _, name = wanted.replace("/msg/", "/").partition("/")
        try:
            return getattr(import_module(f"{package}.msg"), name)
        except (ImportError, AttributeError) as error:
            raise GraphError(
                f"{topic}: the type {wanted} cannot be read ({error}). Install its package and source it"
            ) from error

    def listen(self, topic: str, kind: type, take: Callable[[Any], None], raw: bool = False) -> None:
        """Subscribes with a quality of service that matches every publisher; receives latched messages.

        Args:
            take: Called with each message, or with its bytes if `raw`.
            raw: Whether messages are not deserialized; latched ones are then omitted.
        """
        profiles = [endpoint.profile for endpoint in self.endpoints(topic)[0]]
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
        kept = not raw and bool(profiles) and all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        quality = QoSProfile(
            depth=1000,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        )
        self.node.create_subscription(kind, topic, take, quality, raw=raw)

    # ------------------------------------------------------------------ nodes

    def nodes(self, hidden: bool = False) -> list[str]:
        """Full names of the nodes, one for each node of that name."""
        found = self.node.get_node_names_and_namespaces()
        names = [f"{space.rstrip('/')}/{name}" for name, space in found if hidden or not name.startswith("_")]
        return sorted(names)

    def require_nodes(self) -> None:
        """Checks that a list has something to show.

        Raises:
            GraphError: if the domain has no other node, with what to check.
        """
        if self._unnamed() or any(name != f"/{self.node.get_name()}" for name in self.nodes(hidden=True)):
            return
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        others = ", ".join(str(used) for used in domains_with_participants() if str(used) != domain)
        used = f" (nodes of this machine use {others}: --domain N)" if others else ", else pass --domain N"
        raise GraphError(
            f"no other node in ROS domain {domain} after {self.took_s:.1f} s. Check that the nodes run, that their "
            f"ROS_DOMAIN_ID is {domain}{used}, and that DDS reaches them: {discovery_range()}. "
            "--spin-time 10 waits longer"
        )

    def node_topics(self, name: str) -> dict[str, list[tuple[str, tuple[str, ...]]]]:
        """Topics and services of a node: {heading: [(name, types)]}.

        Raises:
            GraphError: if the node does not exist.
        """
        space, _, base = name.rpartition("/")
        by = self.node
        calls = {
            "Subscribers": by.get_subscriber_names_and_types_by_node,
            "Publishers": by.get_publisher_names_and_types_by_node,
            "Service Servers": by.get_service_names_and_types_by_node,
            "Service Clients": by.get_client_names_and_types_by_node,
        }
        try:
            found = {heading: call(base, space or "/") for heading, call in calls.items()}
        except Exception as error:  # rclpy raises NodeNameNonExistentError of its C layer
            raise GraphError(f"node {name} does not exist") from error
        return {h: [(n, tuple(t)) for n, t in sorted(pairs)] for h, pairs in found.items()}

    # ------------------------------------------------------------------ parameters

    def parameter_names(self, node: str) -> list[str]:
        """Names of a node's parameters."""
        answer = self._call(node, ListParameters, "list_parameters", ListParameters.Request())
        return sorted(answer.result.names)

    def parameters(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """Values of some of a node's parameters; None for one that is not set."""
        answer = self._call(node, GetParameters, "get_parameters", GetParameters.Request(names=list(names)))
        values = [_value(v) for v in answer.values]
        return dict(zip(names, values, strict=False))  # fewer values than names: rcl stops at an unknown one

    def descriptions(self, node: str, names: Sequence[str]) -> list[Any]:
        """Descriptors of some of a node's parameters."""
        request = DescribeParameters.Request(names=list(names))
        return list(self._call(node, DescribeParameters, "describe_parameters", request).descriptors)

    def set_parameter(self, node: str, name: str, value: Any) -> str | None:
        """Sets a parameter; returns the reason of a refusal, None if it is set."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        result = self._call(node, SetParameters, "set_parameters", request).results[0]
        return None if result.successful else result.reason or "no reason given"

    def _call(self, node: str, kind: type, service: str, request: Any) -> Any:
        return self.call(f"{node}/{service}", kind, request)

    def call(self, service: str, kind: type, request: Any) -> Any:
        """Calls a service by its full name; returns the answer.

        Raises:
            GraphError: if no node offers it, or it does not answer.
        """
        node, _, name = service.rpartition("/")
        client = self.node.create_client(kind, service)
        until = time.monotonic() + _ANSWER_S
        while not client.service_is_ready():
            if time.monotonic() > until:
                raise GraphError(f"node {node} offers no service {name}. Name a node that does")
            self.spin(0.05)
        future = client.call_async(request)
        while not future.done():
            if time.monotonic() > until:
                raise GraphError(f"node {node}: no answer to {name} within {_ANSWER_S:g} s (is it busy?)")
            self._executor.spin_once(timeout_sec=0.1)
        self.node.destroy_client(client)
        return future.result()


def discovery_range() -> str:
    """What this environment lets DDS discover."""
    if is_confined(os.environ):
        return "only nodes of this computer are searched; ROS_STATIC_PEERS=ADDRESS adds another computer"
    chosen = [f"{name}={os.environ[name]}" for name in NETWORK_VARIABLES[1:] if os.environ.get(name)]
    wanted = os.environ.get(NETWORK_VARIABLES[0], "")
    name = f"{NETWORK_VARIABLES[0]}={wanted}" if wanted else f"{NETWORK_VARIABLES[0]}, which is not set,"
    return ", ".join([f"{name} finds {_RANGES.get(wanted or 'SUBNET', 'an unknown range')}", *chosen])


def mismatches(publishers: Sequence[Endpoint], subscriptions: Sequence[Endpoint]) -> list[str]:
    """A sentence for each pair of endpoints that do not match, with the fix."""
    found = []
    for publisher in publishers:
        for subscription in subscriptions:
            pair = f"{subscription.full_name} does not receive {publisher.full_name}"
            if publisher.type != subscription.type:
                found.append(f"{pair}: it publishes {publisher.type}; the reader expects {subscription.type}")
                continue
            result, reason = qos_check_compatible(publisher.profile, subscription.profile)
            if result == QoSCompatibility.ERROR:
                found.append(f"{pair}: {_explained(publisher, subscription) or reason}")
    return found


def _explained(publisher: Endpoint, subscription: Endpoint) -> str:
    p, s = publisher.profile, subscription.profile
    reasons = []
    if p.reliability == ReliabilityPolicy.BEST_EFFORT and s.reliability == ReliabilityPolicy.RELIABLE:
        reasons.append("it requests RELIABLE and is offered BEST_EFFORT (fix: request BEST_EFFORT)")
    if p.durability == DurabilityPolicy.VOLATILE and s.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        reasons.append("it requests TRANSIENT_LOCAL and is offered VOLATILE (fix: publish with TRANSIENT_LOCAL)")
    return "; ".join(reasons)


def parameter_type(code: int) -> str:
    """The name of a parameter's type, as in `ros2 param describe`."""
    names = {
        getattr(ParameterType, f"PARAMETER_{name.upper().replace(' ', '_')}"): name
        for name in (
            "not set", "bool", "integer", "double", "string", "byte array", "bool array", "integer array",
            "double array", "string array",
        )
    }  # fmt: skip
    return {"bool": "boolean", "bool array": "boolean array"}.get(names[code], names[code])


def _is_hidden(name: str) -> bool:
    return any(part.startswith("_") for part in name.split("/"))


def _value(message: Any) -> Any:
    value = parameter_value_to_python(message)
    return value.tolist() if hasattr(value, "tolist") else value


def _endpoint(info: Any) -> Endpoint | None:
    if _is_hidden(info.node_name):
        return None
    q = info.qos_profile
    lines = (
        f"Reliability: {q.reliability.name}",
        f"History (Depth): {q.history.name}" + (f" ({q.depth})" if q.history.name == "KEEP_LAST" else ""),
        f"Durability: {q.durability.name}",
        f"Lifespan: {_duration(q.lifespan)}",
        f"Deadline: {_duration(q.deadline)}",
        f"Liveliness: {q.liveliness.name}",
        f"Liveliness lease duration: {_duration(q.liveliness_lease_duration)}",
    )
    return Endpoint(
        node=info.node_name,
        namespace=info.node_namespace,
        kind=info.endpoint_type.name,
        type=info.topic_type,
        type_hash=str(getattr(info, "topic_type_hash", "") or ""),
        gid=".".join(f"{b:02x}" for b in info.endpoint_gid),
        qos=lines,
        profile=q,
    )


def _duration(value: Any) -> str:
    return "Infinite" if value.nanoseconds >= 2**63 - 1 else f"{value.nanoseconds} nanoseconds"
