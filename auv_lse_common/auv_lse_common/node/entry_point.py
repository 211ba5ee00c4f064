"""A node's entry point: makes the node, serves it until it is to end, and cleans up."""

from __future__ import annotations

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
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node.executor import make_executor
from auv_lse_common.node.local_post import POST
from auv_lse_common.process.heartbeat import BEAT_PERIOD_S, Heartbeat


def prepare() -> None:
    """Loads the type supports of all messages and services imported so far: a process forked later has them."""
    for name, module in list(sys.modules.items()):
        if ".msg._" in name or ".srv._" in name:
            for kind in vars(module).values():
                if hasattr(kind, "__import_type_support__"):
                    kind.__import_type_support__()


class Stopping:
    """SIGINT and SIGTERM, taken as the wish that the process end: between two callbacks, never within one.

    rclpy's own handlers end ROS from a thread of theirs while the node may be taking a message, which crashed nodes;
    and a KeyboardInterrupt while a node was made or within a callback left recordings that were not closed. A second
    signal does interrupt: who sends it has waited.

    Attributes:
        asked: Whether the process is to end.
    """

    def __init__(self) -> None:
        """Takes the signals from now on; only in the main thread."""
        self.asked = False
        self._wake: Callable[[], None] | None = None
        self._ended, told = os.pipe()
        os.set_blocking(told, False)
        signal.set_wakeup_fd(told, warn_on_full_buffer=False)  # written to at once, whatever the main thread waits for
        threading.Thread(target=self._watch, name="signals", daemon=True).start()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def waking(self, wake: Callable[[], None] | None) -> None:
        """What ends the main thread's wait from another thread; None: nothing does."""
        self._wake = wake

    def closing(self) -> None:
        """Nothing interrupts any more: what is being written must not be lost."""
        self._wake = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)

    def _ask(self, number: int, frame: object) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def _watch(self) -> None:
        while os.read(self._ended, 64):
            wake = self._wake
            if wake is not None:
                wake()


def spin(stopping: Stopping, *nodes: Node) -> None:
    """Serves the nodes' callbacks, those of what came before shutdown, too: the one place that chooses the executor."""
    executor = make_executor()
    try:
        for node in nodes:
            executor.add_node(node)
        heartbeat = Heartbeat(os.environ)
        if heartbeat.wanted:
            nodes[0].create_timer(BEAT_PERIOD_S, heartbeat.beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        stopping.waking(executor.wake)
        gather_s = max(getattr(node, "gather_s", 0.0) for node in nodes)
        while not stopping.asked and rclpy.ok():
            executor.spin_once()
            if gather_s:
                time.sleep(gather_s)
        if gather_s and rclpy.ok():  # what gathered meanwhile is served, too: the first round lists what has changed
            for _ in range(2):
                executor.spin_once(0.0)
    finally:
        stopping.waking(None)
        executor.shutdown()


@dataclass(frozen=True, slots=True)
class Main:
    """A node's entry point, to be called.

    Attributes:
        make: Makes the node.
    """

    make: Callable[[], Node]

    @property
    def name(self) -> str:
        """The node's name: that of the module that makes it."""
        return self.make.__module__.rpartition(".")[2]

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
        mains = (self, *beside)
        POST.share([main.name for main in mains])
        return _run([main.make for main in mains], arguments)


def _run(makes: Sequence[Callable[[], Node]], arguments: list[str]) -> int:
    # A script in the background ignores SIGINT, and its children inherit that: the signal is taken back.
    stopping = Stopping()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[Node] = []
    try:
        try:
            for make in makes:
                if not stopping.asked:
                    nodes.append(make())
        except ParameterError:
            raise
        except ValueError as error:  # a part that checks its own arguments: here they come from the parameters
            raise ParameterError(str(error)) from error
        if not stopping.asked:
            spin(stopping, *nodes)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        stopping.closing()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
