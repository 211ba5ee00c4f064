"""A node's entry point: makes the node, serves it until it is stopped, and cleans up."""

from __future__ import annotations

import inspect
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.mission_file.parameter_file import readable_by_ros
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node.executable import handle_signals, leave
from auv_lse_common.node.executor import make_executor
from auv_lse_common.node.heartbeat import BEAT_PERIOD_S, Heartbeat
from auv_lse_common.node.intra_process import INTRA_PROCESS
from auv_lse_common.support.confinement import confine
from auv_lse_common.support.installed_copy import refuse_mixture
from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_common.topics.ros_conversions import message_class
from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS

#: Rounds in which a node that gathers messages serves the last ones; the first round may only list what has changed.
_LAST_ROUNDS = 5


def prepare() -> None:
    """Loads what every node uses, so that processes forked later share it.

    These are the messages of all topics, the services imported so far, and Python's table of modules: rclpy's logger
    looks up its caller there, and the first look-up touches every module.
    """
    for topic in (*VEHICLE_TOPICS.values(), *MISSION_TOPICS.values()):
        message_class(topic.kind)
    for name, module in list(sys.modules.items()):
        if ".msg._" in name or ".srv._" in name:
            for kind in vars(module).values():
                if hasattr(kind, "__import_type_support__"):
                    kind.__import_type_support__()
    inspect.getmodule(inspect.currentframe())


class Stopping:
    """Requests to stop, by SIGINT, SIGTERM or SIGHUP: obeyed between two callbacks, never within one.

    rclpy's own handlers shut ROS down from another thread, which can crash a node that is taking a message. A
    KeyboardInterrupt within a callback can leave a recording open. A second signal does interrupt.

    Attributes:
        requested: Whether the process has to stop.
    """

    def __init__(self) -> None:
        """Handles the signals from now on; only in the main thread."""
        self.requested = False
        self._wake: Callable[[], None] | None = None
        self._signals, written = os.pipe()
        os.set_blocking(written, False)
        signal.set_wakeup_fd(written, warn_on_full_buffer=False)  # even while the main thread waits
        threading.Thread(target=self._watch, name="signals", daemon=True).start()
        handle_signals(self._request)

    def set_wake(self, wake: Callable[[], None] | None) -> None:
        """Sets the function with which another thread ends the main thread's wait; None: none."""
        self._wake = wake

    def ignore_signals(self) -> None:
        """Ignores signals from now on, so that nothing being written is lost."""
        self._wake = None
        handle_signals(signal.SIG_IGN)

    def _request(self, number: int, frame: object) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True

    def _watch(self) -> None:
        while os.read(self._signals, 64):
            wake = self._wake
            if wake is not None:
                wake()


def spin(stopping: Stopping, *nodes: Node) -> None:
    """Serves the nodes' callbacks, also for messages that arrived before shutdown."""
    executor = make_executor()
    try:
        for node in nodes:
            executor.add_node(node)
        heartbeat = Heartbeat(os.environ)
        if heartbeat.wanted:
            nodes[0].create_timer(BEAT_PERIOD_S, heartbeat.beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        stopping.set_wake(executor.wake)
        gather_s = max(getattr(node, "gather_s", 0.0) for node in nodes)
        while not stopping.requested and rclpy.ok():
            executor.spin_once()
            if gather_s:
                time.sleep(gather_s)
        if gather_s and rclpy.ok():  # messages gathered meanwhile are served, too
            for _ in range(_LAST_ROUNDS):
                time.sleep(gather_s)
                executor.spin_once(0.0)
    finally:
        stopping.set_wake(None)
        executor.shutdown()


@dataclass(frozen=True, slots=True)
class Main:
    """A node's entry point, to be called."""

    make: Callable[[], Node]

    @property
    def name(self) -> str:
        """The node's name: that of the module that makes it."""
        return self.make.__module__.rpartition(".")[2]

    def __call__(self, *beside: Main, arguments: Sequence[str] | None = None) -> int:
        """Makes the node, serves it until a signal or shutdown, and cleans up.

        Args:
            beside: Further nodes for this process: one thread serves all, and they are one participant in the ROS
                domain. They share the command line, and so the namespace.
            arguments: The command line; None: that of the process.

        Returns:
            Exit code: 0 after an ordinary end, 2 if a node could not be made from its parameters.
        """
        arguments = sys.argv if arguments is None else arguments
        if "-h" in arguments or "--help" in arguments:
            print(f"{self.make.__doc__ or ''}\nParameters: --ros-args --params-file MISSION.yaml -r __ns:=/auv1")
            return 0
        mains = (self, *beside)
        INTRA_PROCESS.share([main.name for main in mains])
        code = _run([main.make for main in mains], arguments)
        leave(code)
        return code


def _begin_ros(arguments: Sequence[str]) -> None:
    """Initializes ROS; its YAML parser refuses much that a mission file may hold, which is then rewritten for it."""
    try:
        rclpy.init(args=init_arguments(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        if "--params-file" not in arguments:
            raise
        readable = readable_by_ros(arguments)
        try:
            rclpy.init(args=init_arguments(readable), signal_handler_options=SignalHandlerOptions.NO)
        except rclpy_implementation.RCLError:
            raise error from None  # the first one names the user's file
        print("parameter files were rewritten for ROS, whose YAML parser cannot read them", file=sys.stderr, flush=True)


def _run(makes: Sequence[Callable[[], Node]], arguments: list[str]) -> int:
    # A script in the background ignores SIGINT, and its children inherit that; restore the signal.
    stopping = Stopping()
    sys.dont_write_bytecode = True  # on a full disk, Python would truncate a module's cache
    try:
        refuse_mixture()
        confine()
        _begin_ros(arguments)
    except (ValueError, rclpy_implementation.RCLError) as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    nodes: list[Node] = []
    try:
        try:
            for make in makes:
                if not stopping.requested:
                    nodes.append(make())
        except ParameterError:
            raise
        except ValueError as error:  # of a part that checks its own arguments, which come from the parameters here
            raise ParameterError(str(error)) from error
        if not stopping.requested:
            spin(stopping, *nodes)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        stopping.ignore_signals()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
