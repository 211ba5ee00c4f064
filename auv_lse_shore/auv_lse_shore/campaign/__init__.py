"""scripts/campaign: many missions specified, simulated and tabulated."""
