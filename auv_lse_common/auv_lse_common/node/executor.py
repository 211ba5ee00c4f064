"""An executor that keeps its wait set, and needs a fraction of the processor time of rclpy's.

For every message, rclpy 7.1 builds a new wait set in Python: it lists every publisher, subscription, timer and service
of the node, enters their handles, adds two event handlers for every publisher and subscription, waits, and runs one
callback as a coroutine. `StandingExecutor` rebuilds the list only when an entity was created or destroyed (rclpy then
calls `wake`). One round:

1. If entities have changed, release their handles, list them again and make a new wait set.
2. Fill the wait set, which rcl clears in every wait, and wait.
3. Mark every ready guard condition, because the wait has reset its trigger.
4. Run ready waitables, timers, guard conditions, subscriptions, clients and services. Subscriptions take turns, one
   message each, until all are empty or have had `_TURNS`, so that timers and services do not wait. A callback that
   creates or destroys an entity ends the round; the other ready entities follow in the next one.

The time to fill the wait set and to wait grows with its size. So services (every node has seven for its parameters) are
included only once per `_SERVICES_PERIOD_S`. Event handlers for incompatible readers and writers, which matter only
during discovery, are included once per `_RARE_PERIOD_S`.

Callbacks that may need a coroutine (of a service, a client, a waitable, or `async def`) run as in rclpy. While a task
is pending, rclpy's own rounds are used.
"""

from __future__ import annotations

import inspect
import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities, Waitable

#: Environment variable with which auv_lse bench selects rclpy's own executor: "rclpy".
CHOICE = "AUV_LSE_EXECUTOR"
#: Largest number of messages of one subscription per round.
_TURNS = 100
#: Wall-clock period (s) of checks for service calls, and for incompatible readers and writers, in a busy node.
_SERVICES_PERIOD_S, _RARE_PERIOD_S = 0.1, 1.0
_RARE = (
    "RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS",
    "RCL_PUBLISHER_INCOMPATIBLE_TYPE",
    "RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS",
    "RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE",
)
#: Undocumented parts of rclpy that the executor uses.
_EXECUTOR_NEEDS = (
    "_context",
    "_guard",
    "_sigint_gc",
    "_is_shutdown",
    "_tasks",
    "_tasks_lock",
    "_cb_iter",
    "_make_handler",
    "_take_client",
    "_take_service",
    "_take_subscription",
    "_take_timer",
    "_take_waitable",
    "_take_guard_condition",
)
_WAIT_SET_NEEDS = (
    "clear_entities",
    "add_subscription",
    "add_guard_condition",
    "add_timer",
    "add_client",
    "add_service",
    "get_ready_entities",
    "wait",
)


def missing_of(executor: Executor) -> list[str]:
    """Parts of rclpy's executor and wait set that `StandingExecutor` needs and the installed rclpy lacks."""
    wait_set = getattr(_rclpy, "WaitSet", None)
    missing = [f"Executor.{name}" for name in _EXECUTOR_NEEDS if not hasattr(executor, name)]
    return missing + [f"WaitSet.{name}" for name in _WAIT_SET_NEEDS if not hasattr(wait_set, name)]


def make_executor() -> Executor:
    """The executor for a node of the stack; rclpy's own, with a warning, if rclpy lacks needed parts."""
    plain = SingleThreadedExecutor()
    if os.environ.get(CHOICE) == "rclpy":
        return plain
    missing = missing_of(plain)
    if missing:
        get_logger("auv_lse").warning(
            f"this rclpy has no {', '.join(missing)}, unlike rclpy 7.1 (ROS 2 Jazzy); rclpy's "
            "SingleThreadedExecutor serves the callbacks and takes more processor time"
        )
        return plain
    plain.shutdown()
    return StandingExecutor()


class StandingExecutor(SingleThreadedExecutor):
    """Serves the callbacks of nodes in the spinning thread; see the module's text."""

    def __init__(self) -> None:
        self._changed = True
        self._entities: _Entities | None = None
        self._serving = threading.RLock()  # held by the thread that uses the entities
        self._services_due_s = self._rare_due_s = 0.0
        super().__init__()

    def wake(self) -> None:
        """Rebuilds the list of entities after one was created or destroyed. May be called from any thread."""
        self._changed = True
        super().wake()

    def add_node(self, node: Node) -> bool:
        """Starts serving a node; False if it is already served."""
        self._changed = True
        return super().add_node(node)

    def remove_node(self, node: Node) -> None:
        """Stops serving a node."""
        super().remove_node(node)
        self._changed = True
        self._release()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stops serving; the spinning thread releases every handle."""
        done = super().shutdown(timeout_sec)
        self._changed = True
        self._release()
        return done

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Waits until an entity is ready (at most `timeout_sec`; None: unlimited) and runs all ready ones."""
        if self._tasks:
            super().spin_once(timeout_sec)
            return
        with self._serving:
            if self._cb_iter is not None:  # an unfinished round of rclpy, which holds handles
                self._cb_iter.close()
                self._cb_iter = None
            if not self._is_shutdown:
                self._round(None if timeout_sec is None or timeout_sec < 0.0 else timeout_sec)
            if self._is_shutdown:
                self._release()

    def _round(self, timeout_s: float | None) -> None:
        if self._changed or self._entities is None:
            self._changed = False  # reset first: changes during the listing are for the next round
            self._release()
            self._entities = _Entities(self._context, self.get_nodes(), (self._guard, self._sigint_gc))
        entities = self._entities
        self._wait(entities, timeout_s)
        if self._is_shutdown:
            return
        if self._changed and not self._context.ok():  # shutdown wakes the executor
            raise ExternalShutdownException()
        entities.mark_guards()
        for run, ready in (
            (partial(self._run_tasks, self._take_waitable), entities.ready_waitables()),
            (self._run_timers, entities.ready("timer")),
            (self._run_guards, entities.node_guards),
            (self._run_subscriptions, entities.ready("subscription")),
            (partial(self._run_tasks, self._take_client), entities.ready("client")),
            (partial(self._run_tasks, self._take_service), entities.ready("service")),
        ):
            if ready and not self._changed:
                run(ready)

    def _release(self) -> None:
        """Releases the handles, unless another thread is using them, which then does it."""
        if self._serving.acquire(blocking=False):
            try:
                if self._entities is not None:
                    self._entities.close()
                    self._entities = None
            finally:
                self._serving.release()

    def _wait(self, entities: _Entities, timeout_s: float | None) -> None:
        now_s = time.monotonic()
        rare = timeout_s is not None or now_s >= self._rare_due_s
        services = rare or now_s >= self._services_due_s
        if not rare:
            timeout_s = (self._rare_due_s if services else min(self._services_due_s, self._rare_due_s)) - now_s
        entities.wait(timeout_s, services, rare)
        now_s = time.monotonic()
        if services:
            self._services_due_s = now_s + _SERVICES_PERIOD_S
        if rare:
            self._rare_due_s = now_s + _RARE_PERIOD_S

    # ------------------------------------------------------------------ callbacks

    def _run_subscriptions(self, ready: Sequence[_Served]) -> None:
        for _ in range(_TURNS):
            left = [served for served in ready if self._run_subscription(*served)]
            if not left or self._changed:
                return
            ready = left

    def _run_subscription(self, subscription: Subscription, node: Node) -> bool:
        """Handles one message; returns False if there is none, or at the end of the round."""
        group, callback = subscription.callback_group, subscription.callback
        if self._changed:
            return False
        if inspect.iscoroutinefunction(callback):
            self._run_task(subscription, node, self._take_subscription)
            return False
        if not group.beginning_execution(subscription):
            return False
        try:
            take = getattr(subscription, "take", None)  # with the message's sender (senders.py)
            taken = take() if take else subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return False
            if take or subscription._callback_type is not Subscription.CallbackType.MessageOnly:
                callback(*taken)
            else:
                callback(taken[0])
        finally:
            group.ending_execution(subscription)
        return True

    def _run_timers(self, ready: Sequence[_Served]) -> None:
        for timer, node in ready:
            if self._changed:
                return
            if not timer.handle.is_timer_ready():  # canceled by a callback of this round
                continue
            if inspect.iscoroutinefunction(timer.callback):
                self._run_task(timer, node, self._take_timer)
            elif timer.callback_group.beginning_execution(timer):
                try:
                    timer.handle.call_timer()
                    timer.callback()
                finally:
                    timer.callback_group.ending_execution(timer)

    def _run_guards(self, guards: Sequence[_Served]) -> None:
        for guard, node in guards:
            if guard._executor_triggered and not self._changed:
                self._run_task(guard, node, self._take_guard_condition)

    def _run_tasks(self, take: Callable[[Any], Any], ready: Sequence[_Served]) -> None:
        for entity, node in ready:
            if not self._changed:
                self._run_task(entity, node, take)

    def _run_task(self, entity: Any, node: Node, take: Callable[[Any], Any]) -> None:
        """Runs a callback as rclpy does: as a task, which may be suspended."""
        if not self.can_execute(entity):
            return
        task = self._make_handler(entity, node, take)
        try:
            task()
        finally:
            with self._tasks_lock:
                self._tasks = [entry for entry in self._tasks if not entry[0].done()]
        if task.exception() is not None:
            raise task.exception()


#: Names of the kinds of entities in a wait set (in the order of `NumberOfEntities`), and of a node's lists of them.
_KINDS = {
    "subscription": "subscriptions",
    "guard_condition": "guards",
    "timer": "timers",
    "client": "clients",
    "service": "services",
}
#: An rclpy entity and its node.
_Served = tuple[Any, Node]


class _Entities:
    """The entities of some nodes in one wait set. Their handles stay in use until `close`."""

    def __init__(self, context: Any, nodes: Sequence[Node], own_guards: Sequence[Any]) -> None:
        """Lists the entities of `nodes`; `own_guards` are the executor's guard conditions, which only end a wait."""
        self._stack = ExitStack()
        self._stack.enter_context(context.handle)
        self._served: dict[str, dict[int, _Served]] = {}
        handles: dict[str, list[Any]] = {}
        for kind, name in _KINDS.items():
            entered = [(entity, node) for node in nodes for entity in getattr(node, name) if self._enter(entity.handle)]
            self._served[kind] = {entity.handle.pointer: (entity, node) for entity, node in entered}
            handles[kind] = [entity.handle for entity, _ in entered]
        self.node_guards = list(self._served["guard_condition"].values())
        handles["guard_condition"] += [guard.handle for guard in own_guards if self._enter(guard.handle)]
        waitables = [(waitable, node) for node in nodes for waitable in node.waitables if self._enter(waitable)]
        self._rare = [served for served in waitables if _is_rare(served[0])]
        self._frequent = [served for served in waitables if not _is_rare(served[0])]
        counts = NumberOfEntities(*(len(handles[kind]) for kind in _KINDS))
        for waitable, _ in waitables:
            counts += waitable.get_num_entities()
        self._wait_set = _rclpy.WaitSet(
            counts.num_subscriptions,
            counts.num_guard_conditions,
            counts.num_timers,
            counts.num_clients,
            counts.num_services,
            counts.num_events,
            context.handle,
        )
        adds = {kind: [(getattr(self._wait_set, f"add_{kind}"), h) for h in handles[kind]] for kind in _KINDS}
        self._service_adds = adds.pop("service")
        self._frequent_adds = [add for of_kind in adds.values() for add in of_kind]
        self._waited_for = waitables

    def _enter(self, handle: Any) -> bool:
        try:
            self._stack.enter_context(handle)
        except InvalidHandle:  # destroyed meanwhile
            return False
        return True

    def close(self) -> None:
        """Releases the handles."""
        self._wait_set = None
        self._stack.close()

    def wait(self, timeout_s: float | None, services: bool, rare: bool) -> None:
        """Waits until an entity is ready, at most `timeout_s` (None: unlimited); includes services or rare events."""
        for guard, _ in self.node_guards:
            if guard._executor_triggered:  # its callback was not run
                guard.trigger()
        self._wait_set.clear_entities()
        for add, handle in self._frequent_adds:
            add(handle)
        for add, handle in self._service_adds if services else ():
            add(handle)
        self._waited_for = [*self._frequent, *self._rare] if rare else self._frequent
        for waitable, _ in self._waited_for:
            waitable.add_to_wait_set(self._wait_set)
        self._wait_set.wait(-1 if timeout_s is None else int(timeout_s * 1e9))

    def ready(self, kind: str) -> list[_Served]:
        """The entities of a kind that the last wait found ready."""
        served = self._served[kind]
        return [served[pointer] for pointer in self._wait_set.get_ready_entities(kind)] if served else []

    def ready_waitables(self) -> list[_Served]:
        """The waitables that the last wait found ready."""
        return [served for served in self._waited_for if served[0].is_ready(self._wait_set)]

    def mark_guards(self) -> None:
        """Marks the guard conditions that the last wait found ready, because rcl has reset their triggers."""
        if self.node_guards:
            ready = self._wait_set.get_ready_entities("guard_condition")
            for guard, _ in self.node_guards:
                if guard.handle.pointer in ready:
                    guard._executor_triggered = True


def _is_rare(waitable: Waitable) -> bool:
    """Whether it handles an event that occurs only during discovery."""
    return getattr(getattr(waitable, "event_type", None), "name", "") in _RARE
