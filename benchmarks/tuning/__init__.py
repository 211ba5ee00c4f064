"""The pictures and the table of docs/evidence/tuning.md."""
