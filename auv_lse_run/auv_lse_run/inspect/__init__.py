"""Commands and views of running nodes."""
