"""Types of command-line options that are numbers, for argparse."""

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


def number_from(least: float, below: float = math.inf) -> Callable[[str], float]:
    """The type of an option that is a number of at least `least` and below `below`."""

    def number(text: str) -> float:
        value = _number(text)
        if not least <= value < below:
            limits = f"of at least {least:g}" if math.isinf(below) else f"from {least:g} to below {below:g}"
            raise argparse.ArgumentTypeError(f"{text!r} is not a number {limits}")
        return value

    return number


def positive(text: str) -> float:
    """The type of an option that is a number above 0.

    Raises:
        argparse.ArgumentTypeError: for anything else.
    """
    value = _number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def _number(text: str) -> float:
    """The number in a text; NaN if the text is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
