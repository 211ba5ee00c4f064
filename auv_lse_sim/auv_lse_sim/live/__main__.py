"""The command scripts/live."""

import sys

from auv_lse_sim.live.command import main

if __name__ == "__main__":
    sys.exit(main())
