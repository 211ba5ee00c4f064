"""The pictures and the table of docs/guide/tuning.md."""
