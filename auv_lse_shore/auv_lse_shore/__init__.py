"""What people use on deck: missions, checks, live view, replay, reports, exports, campaigns."""

import logging

# a cache of fonts that cannot be kept costs some time and is no fault of a mission
logging.getLogger("matplotlib").setLevel(logging.ERROR)
