"""Runs a module as `python -m` does; the scripts run their modules this way.

`python -m auv_lse_common.support.command MODULE ARGUMENTS` ends on Ctrl-C with the word "interrupted" and exit code
130, even while modules are being imported. A command that has to end processes in order handles the signal itself.
A package of the stack that is not installed is named, with exit code 2: a vehicle has no simulator.
"""

from __future__ import annotations

import importlib.util
import os
import runpy
import sys

#: Packages that are needed by the commands of a package, if not only that package itself.
_NEEDS = {"auv_lse_shore": ("auv_lse_sim", "auv_lse_shore"), "benchmarks": ("auv_lse_sim", "auv_lse_shore")}


def main() -> int:
    """Runs the module named first on the command line; returns the exit code if the module does not exit itself."""
    _, module, *arguments = sys.argv
    package = module.split(".")[0]
    missing = [name for name in _NEEDS.get(package, ()) if not _is_installed(name)]
    if missing:
        names = " and ".join(missing)
        print(
            f"error: {os.environ.get('AUV_LSE_SCRIPT', module)} needs the package{'s' * (len(missing) > 1)} {names}; "
            f"this workspace has not installed {'them' if len(missing) > 1 else 'it'}. Fix: link {names} into "
            "ros_ws/src, then scripts/setup",
            file=sys.stderr,
        )
        return 2
    sys.argv = [module, *arguments]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def _is_installed(package: str) -> bool:
    """Whether a package can be imported; its folder in the working directory would be found without being one."""
    spec = importlib.util.find_spec(package)
    return spec is not None and spec.origin is not None


if __name__ == "__main__":
    sys.exit(main())
