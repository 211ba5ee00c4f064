"""scripts/export: results as files for other programs."""
