"""Runs a module as `python -m` does; the scripts run their modules this way.

`python -m auv_lse_common.support.command MODULE ARGUMENTS` prints "interrupted" on Ctrl-C and exits with code 130, even
during imports. A command that has to end processes in order handles the signal itself. If a package of the stack is not
installed (a vehicle has no simulator), or a Python package that it needs, the command names it and exits with code 2.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys

from auv_lse_common.support.missing_packages import MissingPackageError, install_command, is_installed

#: Packages that the commands of a package need, if not only that package.
_NEEDS = {
    "auv_lse_mavlink": ("auv_lse_mavlink",),
    "auv_lse_shore": ("auv_lse_sim", "auv_lse_shore"),
    "benchmarks": ("auv_lse_sim", "auv_lse_shore"),
}


def _script(module: str) -> str:
    return os.environ.get("AUV_LSE_SCRIPT", module)


def main() -> int:
    """Runs the first argument as a module; returns the exit code if the module does not exit itself."""
    _, module, *arguments = sys.argv
    package = module.split(".")[0]
    missing = [name for name in _NEEDS.get(package, ()) if not is_installed(name)]
    if missing:
        names = " and ".join(missing)
        print(
            f"error: {_script(module)} needs the package{'s' * (len(missing) > 1)} {names}; "
            f"this workspace has not installed {'them' if len(missing) > 1 else 'it'}. Fix: link {names} into "
            "ros_ws/src, then scripts/setup",
            file=sys.stderr,
        )
        return 2
    sys.argv = [module, *arguments]
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # scripts/environment.sh blocks it until now
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except MissingPackageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        name = (error.name or "").split(".")[0]
        if not name or is_installed(name) or name.startswith("auv_lse_"):  # a wrong import in the stack
            raise
        text = f"{_script(module)} needs the Python package {name}, which is not installed: {install_command(name)}"
        print(f"error: {text}", file=sys.stderr)
        return 2
    finally:
        exec("")  # Ctrl-C within an evaluated string, caught or not, would make Python end by SIGINT; this clears it
    return 0


if __name__ == "__main__":
    sys.exit(main())
