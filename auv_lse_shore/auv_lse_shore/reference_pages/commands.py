"""The commands in scripts/, by their argparse parsers."""

from __future__ import annotations

import argparse
import importlib
import re
import textwrap
from pathlib import Path
from types import ModuleType

from auv_lse_common.support.project_folder import project_folder
from auv_lse_run.command.find_verbs import find_verbs
from auv_lse_shore.reference_pages.blocks import wrapped

_MODULE = re.compile(r"run_module ([\w.]+) ")
_VERB = re.compile(r"run_auv_lse ([\w-]+) ")


def commands() -> str:
    """Each command: what it does, its usage, its exit codes."""
    parts = []
    for script in sorted((project_folder() / "scripts").iterdir()):
        if script.suffix == "":
            module = module_of(script)
            parts.append(f"### scripts/{script.name}\n{wrapped(_summary(script))}")
            parts += [_described(parser_of(module))] if module else []
    return "\n\n".join(parts)


def module_of(script: Path) -> str:
    """The module that a script runs; "" for a script that is no Python command."""
    text = script.read_text()
    if verb := _VERB.search(text):
        return find_verbs()[0][verb[1]].module
    match = _MODULE.search(text)
    return match[1] if match else ""


def parser_of(name: str) -> argparse.ArgumentParser:
    """The parser of a command's module.

    Args:
        name: Module, or package with a `__main__`.

    Raises:
        ValueError: if neither has a function `parser`.
    """
    module = importlib.import_module(name)
    package = name if hasattr(module, "__path__") else name.rpartition(".")[0]
    for candidate in (name, *(f"{package}.{part}" for part in ("__main__", "options", "command"))):
        holder = _imported(candidate)
        if holder is not None and callable(getattr(holder, "parser", None)):
            found = holder.parser()
            if isinstance(found, argparse.ArgumentParser):
                return found
    raise ValueError(f"command module got {name!r}; expected a function parser() in it, its __main__ or its options")


def _imported(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not name.startswith(error.name):
            raise
        return None


def _summary(script: Path) -> str:
    """The second line of a script: what it does."""
    return script.read_text().splitlines()[1].removeprefix("# ").replace(" See --help.", "")


def _one_line(text: str | None) -> str:
    return " ".join((text or "").split())


def _described(parser: argparse.ArgumentParser) -> str:
    """The usage in a code block, and the exit codes."""
    text = f"{_one_line(parser.description)} {_one_line(parser.epilog)}"
    codes = re.search(r"Exit codes: .*?\.(?= [A-Z]|$)", text)
    usage = textwrap.wrap(
        f"{parser.prog} {_usage(parser)}", 110, subsequent_indent="    ", break_on_hyphens=False, break_long_words=False
    )
    block = "\n".join(f"    {line}" for line in usage).replace("\0", " ")
    return f"{block}\n\n{wrapped(codes[0]) if codes else ''}".rstrip()


def _usage(parser: argparse.ArgumentParser) -> str:
    """Positional arguments and options as on a command line; of subcommands their names."""
    words = []
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction) or action.help is argparse.SUPPRESS:
            continue
        if isinstance(action, argparse._SubParsersAction):
            words.append("{" + ",".join(action.choices) + "} ...")
            continue
        flag = action.option_strings[0] if action.option_strings else ""
        word = f"{flag} {_metavar(action)}".strip().replace(" ", "\0")
        words.append(f"[{word}]" if action.option_strings or action.nargs in ("?", "*") else word)
    return " ".join(sorted(words, key=lambda word: word.startswith("[-")))


def _metavar(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    if isinstance(action.metavar, tuple):
        return " ".join(action.metavar)
    name = action.metavar or ("|".join(map(str, action.choices)) if action.choices else action.dest.upper())
    return f"{name} ..." if action.nargs in ("*", "+") else name
