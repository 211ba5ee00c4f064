"""The verbs of this package."""

from auv_lse_common.support.verb import Verb

VERBS = (
    Verb("key", "vehicle", "make a key for signed packets and messages", "auv_lse_comms.packet.key"),
    Verb("modem-check", "vehicle", "check an acoustic modem, or two in a bucket, before the dive",
         "auv_lse_comms.modem_check_command"),
)  # fmt: skip
