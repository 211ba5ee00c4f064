"""A node's entry point: makes the node, serves it until it is to end, and cleans up."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from auv_lse_common.executor import make_executor
from auv_lse_common.heartbeat import BEAT_PERIOD_S, Heartbeat
from auv_lse_common.params import ParameterError


def prepare() -> None:
    """Loads the type supports of all messages and services imported so far: a process forked later has them."""
    for name, module in list(sys.modules.items()):
        if ".msg._" in name or ".srv._" in name:
            for kind in vars(module).values():
                if hasattr(kind, "__import_type_support__"):
                    kind.__import_type_support__()


def spin(*nodes: Node) -> None:
    """Serves the nodes' callbacks until shutdown: the one place that chooses the executor."""
    executor = make_executor()
    try:
        for node in nodes:
            executor.add_node(node)
        heartbeat = Heartbeat(os.environ)
        if heartbeat.wanted:
            nodes[0].create_timer(BEAT_PERIOD_S, heartbeat.beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        executor.spin()
    finally:
        executor.shutdown()


@dataclass(frozen=True, slots=True)
class Main:
    """A node's entry point, to be called.

    Attributes:
        make: Makes the node.
    """

    make: Callable[[], Node]

    def __call__(self, *beside: Main, arguments: Sequence[str] | None = None) -> int:
        """Makes the node, serves it until SIGINT, SIGTERM or shutdown, and cleans up.

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
        return _run([main.make for main in (self, *beside)], arguments)


def _run(makes: Sequence[Callable[[], Node]], arguments: list[str]) -> int:
    # A script in the background ignores SIGINT, and its children inherit that: take the signal back.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rclpy.init(args=list(arguments))
    nodes: list[Node] = []
    try:
        try:
            for make in makes:
                nodes.append(make())
        except ParameterError:
            raise
        except ValueError as error:  # a part that checks its own arguments: here they come from the parameters
            raise ParameterError(str(error)) from error
        spin(*nodes)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        # A second Ctrl-C while closing must not lose what is being written.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
