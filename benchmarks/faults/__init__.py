"""Fault injection that takes too long for the tests: killed nodes, bad water, long missions (docs/design/safety.md)."""
