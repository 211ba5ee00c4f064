"""Runs a module as `python -m` does, but ends on Ctrl-C with exit code 130 and one word, whatever it is doing.

`python -m auv_lse_common.support.command MODULE ARGUMENTS`: the scripts are run so. A command that has something to
end in order takes the signal itself; this is for the rest of the time, such as the seconds in which modules are
imported.
"""

from __future__ import annotations

import runpy
import sys


def main() -> int:
    """Runs the module that the command line names first; it ends the process itself, or by coming to its end."""
    _, module, *arguments = sys.argv
    sys.argv = [module, *arguments]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
