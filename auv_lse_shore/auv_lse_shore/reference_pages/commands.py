"""The verbs of auv_lse by their argparse parsers, and the scripts of a checkout."""

import argparse
import importlib
import re
import textwrap
from pathlib import Path

from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.support.verb import GROUPS, Verb
from auv_lse_run.command.find_verbs import PACKAGE_OF, find_verbs
from auv_lse_shore.reference_pages.blocks import wrapped


def commands() -> str:
    """Each verb of auv_lse, and each script of a checkout: what it does, its usage, its exit codes."""
    verbs = [verb for verb in find_verbs()[0].values() if verb.name in PACKAGE_OF]
    parts = []
    for group, heading in GROUPS.items():
        parts.append(f"## {heading}")
        last = ""  # exit codes; those of several verbs in a row stand once, above them
        for verb in verbs:
            if verb.group == group:
                parts.append(f"### auv_lse {verb.name}\n{verb.text[0].upper()}{verb.text[1:]}.")
                usage, codes = _described(parser_of(verb))
                parts += [usage, *([] if codes in ("", last) else [codes])]
                last = codes
    parts.append("## Scripts of a checkout")
    for script in sorted((project_folder() / "scripts").iterdir()):
        if script.suffix == "":
            parts.append(f"### scripts/{script.name}\n{wrapped(_summary(script))}")
    return "\n\n".join(parts)


def parser_of(verb: Verb) -> argparse.ArgumentParser:
    """The parser of a verb's command line."""
    found: argparse.ArgumentParser = importlib.import_module(verb.module).parser()
    for word in verb.words:
        (commands,) = (action for action in found._actions if isinstance(action, argparse._SubParsersAction))
        found = commands.choices[word]
    return found


def _summary(script: Path) -> str:
    """The second line of a script: what it does."""
    return script.read_text().splitlines()[1].removeprefix("# ").replace(" See --help.", "")


def _one_line(text: str | None) -> str:
    return " ".join((text or "").split())


def _described(parser: argparse.ArgumentParser) -> tuple[str, str]:
    """The usage in a code block, and the exit codes, without those that every command has."""
    text = f"{_one_line(parser.description)} {_one_line(parser.epilog)}"
    codes = re.search(r"Exit codes: .*?\.(?= [A-Z]|$)", text)
    usage = textwrap.wrap(
        f"{parser.prog} {_usage(parser)}", 110, subsequent_indent="    ", break_on_hyphens=False, break_long_words=False
    )
    block = "\n".join(f"    {line}" for line in usage).replace("\0", " ")
    own = re.sub(r"; 2 wrong command line(?=[;.])|; 130 Ctrl-C(?=\.$)", "", codes[0]) if codes else ""
    return block, wrapped(own)


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
