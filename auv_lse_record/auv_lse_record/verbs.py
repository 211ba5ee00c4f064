"""The verbs of this package."""

from auv_lse_common.support.verb import Verb

VERBS = (Verb("recover", "after", "repair a recording that was cut off", "auv_lse_record.recover"),)
