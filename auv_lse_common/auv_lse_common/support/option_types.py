"""Types of command-line options that are numbers, for argparse."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def whole_from(least: int) -> Callable[[str], int]:
    """The type of an option that is a whole number of at least `least`."""

    def whole(text: str) -> int:
        if not text.isdigit() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {least}")
        return int(text)

    return whole


def positive(text: str) -> float:
    """The type of an option that is a number above 0.

    Raises:
        argparse.ArgumentTypeError: for anything else.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value
