"""For the tests of all packages: verbs of auv_lse as functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from auv_lse_run.command.main import main


def verb_main(*words: str) -> Callable[[Sequence[str]], int]:
    """`auv_lse WORDS` as a function of the further arguments; it returns the exit code."""
    return lambda arguments: main([*words, *arguments])
