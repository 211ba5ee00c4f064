"""The command scripts/live."""

import sys

from auv_lse_shore.live.command import main

if __name__ == "__main__":
    sys.exit(main())
