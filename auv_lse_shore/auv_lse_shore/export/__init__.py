"""scripts/export: writes results as files for other programs."""
