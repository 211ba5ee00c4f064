"""One vehicle's side of the acoustic channel: its packets in its own slots, and the team's packets received."""

from auv_lse_comms.bridge.mate_tracks import MateTracks, Pace
from auv_lse_comms.bridge.modem_bridge import EVENTS, ModemBridge, ModemFeatures, Received

__all__ = ["EVENTS", "MateTracks", "ModemBridge", "ModemFeatures", "Pace", "Received"]
