"""Prepares the process of a node's executable; each node's module imports this one first.

SIGINT or SIGTERM during the imports ends the node without a traceback; `auv_lse_common.node.entry_point` then replaces
the handlers. Linear algebra runs on one thread unless the environment says otherwise: a mission is many processes on
few cores, and waiting threads would take the cores from each other.
"""

import os
import signal
import sys

if os.path.basename(sys.argv[0]).endswith("_node"):  # `ros2 run`: not a test, a command or the fork server
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda number, frame: os._exit(0))
    for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(_name, "1")
