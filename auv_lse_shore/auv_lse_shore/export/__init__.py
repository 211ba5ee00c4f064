"""auv_lse export: writes results as files for other programs."""
