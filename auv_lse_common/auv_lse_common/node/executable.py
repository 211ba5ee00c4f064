"""Prepares the process of a node's executable; each node's module imports this one first.

A signal to end during the imports ends the node without a traceback; `auv_lse_common.node.entry_point` then replaces
the handlers. Linear algebra runs on one thread unless the environment sets more: a mission is many processes on
few cores, and waiting threads would take the cores from each other. `leave` ends the process.
"""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType

from auv_lse_common.support.ending_signals import accepted_signals


def handle_signals(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    """Sets the handler of SIGINT, SIGTERM and, unless it is ignored as under nohup, SIGHUP (a closed terminal)."""
    for number in accepted_signals():
        signal.signal(number, handler)


#: Whether `ros2 run` or `ros2 launch` has started this process: it is not a test, a command or the fork server.
IS_EXECUTABLE = os.path.basename(sys.argv[0]).endswith("_node")

if IS_EXECUTABLE:
    handle_signals(lambda number, frame: os._exit(0))
    for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(_name, "1")


def leave(code: int) -> None:
    """Ends the process of an executable at once, after its nodes' clean-up; elsewhere it returns.

    Python would take down the compiled loops one by one, which takes seconds of a slow or busy core; `ros2 launch`
    kills a node that takes longer than 15 s.
    """
    if IS_EXECUTABLE:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
