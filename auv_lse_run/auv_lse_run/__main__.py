"""`python -m auv_lse_run` is the command auv_lse."""

import sys

from auv_lse_run.command.main import main

if __name__ == "__main__":
    sys.exit(main())
