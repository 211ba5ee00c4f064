"""auv_lse campaign: simulates many missions and tabulates their results."""
