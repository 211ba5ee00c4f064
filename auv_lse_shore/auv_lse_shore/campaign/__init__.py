"""scripts/campaign: simulates many missions and tabulates their results."""
