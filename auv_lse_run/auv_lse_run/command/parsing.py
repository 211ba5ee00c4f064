"""Parses the arguments of a verb; errors name the verb that was called, in words that need no Python."""

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any


def parsed(parser: argparse.ArgumentParser, words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line.

    Raises:
        SystemExit: with 2 after a printed error, with 0 after help.
        OSError: if help cannot be written.
    """
    for each in _parsers(parser):
        name_numbers(each)
        each._negative_number_matcher = _VALUE
        # argparse has no other way in: parsers come from the verbs, and add_subparsers makes more of the same class.
        each._print_message = _print_message  # type: ignore[method-assign]
    options, unknown = parser.parse_known_args(words)
    if unknown:  # argparse would print the usage of the outermost parser
        import difflib

        called = _called(parser, words)
        near = difflib.get_close_matches(unknown[0].split("=")[0], called._option_string_actions, n=1, cutoff=0.8)
        called.error(f"unrecognized arguments: {' '.join(unknown)}{f'. Did you mean {near[0]}?' if near else ''}")
    return options


#: Arguments that are values, though they begin with a sign: numbers, and lists such as -,lat,lon.
_VALUE = re.compile(r"-[\d.,]")


def _print_message(message: str, file: Any = None) -> None:
    """Prints help or an error; argparse's own drops help that cannot be written."""
    print(message, end="", file=sys.stderr if file is None else file)


def name_numbers(parser: argparse.ArgumentParser) -> None:
    """Makes a parser refuse wrong numbers in plain words; argparse names Python's types ("invalid int value")."""
    parser.register("type", int, _whole)
    parser.register("type", float, _number)


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _verbs(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of a parser's own verbs, by name."""
    found: dict[str, argparse.ArgumentParser] = {}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found.update(action.choices)
    return found


def _parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for below in _verbs(parser).values():
        yield from _parsers(below)


def _called(parser: argparse.ArgumentParser, words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of the innermost verb that the words name."""
    for word in words:
        parser = _verbs(parser).get(word, parser)
    return parser
