"""`auv_lse completion`: a script with which bash or zsh completes verbs, options and their values.

The script holds all words, so a shell need not start Python at each key. argcomplete would, and shtab needs one parser
of all verbs.
"""

import argparse
import importlib
import shlex
from collections.abc import Iterator

from auv_lse_run.command.find_verbs import find_verbs

_SCRIPT = """\
# Completes auv_lse; made by `auv_lse completion`.
_auv_lse() {{
    local i place="" words="" current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}"
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$place ${{COMP_WORDS[i]}}" in
{places}
        esac
    done
    case "$place $before" in
{values}
        *)
            case "$place" in
{options}
            esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _auv_lse auv_lse
"""
_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse completion."""
    p = argparse.ArgumentParser(
        prog="auv_lse completion",
        description="Prints a script with which a shell completes auv_lse: its verbs, their options and values. "
        'For bash: auv_lse completion bash >> ~/.bash_completion. For zsh: add eval "$(auv_lse completion zsh)" to '
        "~/.zshrc. Print it again after installing a package with further verbs.",
        epilog="Exit codes: 0; 2 wrong command line.",
    )
    p.add_argument("shell", choices=("bash", "zsh"), help="the shell")
    return p


def run(options: argparse.Namespace) -> None:
    """Prints the script."""
    print(f"{_ZSH if options.shell == 'zsh' else ''}{script()}", end="")


def script() -> str:
    """The completion script of bash, which zsh can read."""
    verbs, _ = find_verbs()
    words = {"": [*verbs, "--help", "--version"]}
    values: dict[str, list[str]] = {}
    for verb in verbs.values():
        try:
            command_line = importlib.import_module(verb.module).parser()
        except ImportError:  # a package that the verb needs is missing: only its name is completed
            words[f" {verb.name}"] = ["--help"]
            continue
        for part in verb.words:
            command_line = next(_commands(command_line))[part]
        _collect(command_line, f" {verb.name}", words, values)
    places = [f'            "{place}") place="{place}" ;;' for place in words if place]
    return _SCRIPT.format(places="\n".join(places), values=_cases(values, 8), options=_cases(words, 16))


def _cases(words: dict[str, list[str]], indent: int) -> str:
    """The branches of a `case` that set the words."""
    quoted = {place: shlex.quote(" ".join(found)) for place, found in words.items()}
    return "\n".join(f'{" " * indent}"{place}") words={text} ;;' for place, text in quoted.items())


def _commands(p: argparse.ArgumentParser) -> Iterator[dict[str, argparse.ArgumentParser]]:
    """The subcommands of a parser: none, or one table."""
    for action in p._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield action.choices


def _collect(p: argparse.ArgumentParser, place: str, words: dict[str, list[str]], values: dict[str, list[str]]) -> None:
    """Adds the words that may follow `place`, and the values of its options."""
    found: list[str] = []
    for commands in _commands(p):
        found += commands
        for name, command in commands.items():
            _collect(command, f"{place} {name}", words, values)
    for action in p._actions:
        if action.help is argparse.SUPPRESS or isinstance(action, argparse._SubParsersAction):
            continue
        found += action.option_strings[-1:]
        choices = [str(choice) for choice in action.choices or ()]
        if not action.option_strings:
            found += choices
        for option in action.option_strings if choices else ():
            values[f"{place} {option}"] = choices
    words[place] = found
