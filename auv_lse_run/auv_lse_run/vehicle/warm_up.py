"""`python -m auv_lse_run.vehicle.warm_up`: compiles the code of a vehicle's nodes into numba's cache.

scripts/setup runs it on a vehicle, so that nodes start quickly.
"""

import importlib
import sys

from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes


def main() -> int:
    """Imports the vehicle's nodes and calls `prepare()` where a node's module has it."""
    for package, executable in vehicle_nodes(modem=False, link=False):
        module = importlib.import_module(f"{package}.{executable}")
        getattr(module, "prepare", lambda: None)()
    return 0


if __name__ == "__main__":
    sys.exit(main())
