"""Entry point of the command auv_lse, installed or as `python -m auv_lse_run`."""

import sys


def main() -> int:
    """Runs the command line of this process; returns the exit code. Ctrl-C during the imports prints one word."""
    try:
        from auv_lse_run.command.main import main as run
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return run()


if __name__ == "__main__":
    sys.exit(main())
