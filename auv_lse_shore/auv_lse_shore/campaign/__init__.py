"""Many missions: specified, flown, tabulated."""
