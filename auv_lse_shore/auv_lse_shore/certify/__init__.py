"""auv_lse certify: recomputes a mission's final map from its recordings, and states what it promises."""
