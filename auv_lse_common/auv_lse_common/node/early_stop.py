"""Ends a node without a traceback if SIGINT or SIGTERM arrives while it still imports its modules.

Each node's module imports this one first. It acts only in the process of a node's executable.
`auv_lse_common.node.entry_point` then replaces the handlers.
"""

import os
import signal
import sys

if os.path.basename(sys.argv[0]).endswith("_node"):  # `ros2 run`: not a test, a command or the fork server
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda number, frame: os._exit(0))
