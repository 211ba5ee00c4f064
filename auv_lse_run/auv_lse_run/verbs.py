"""The verbs of this package."""

from auv_lse_common.support.verb import Verb

VERBS: tuple[Verb, ...] = ()
