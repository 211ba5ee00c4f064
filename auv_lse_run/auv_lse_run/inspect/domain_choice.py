"""The ROS domain of an inspection command, and its error handling."""

from __future__ import annotations

import argparse
import functools
import os
import sys
from collections.abc import Callable
from typing import Any

from auv_lse_common.support.option_types import positive
from auv_lse_run.inspect.message_text import FieldError
from auv_lse_run.process.domain import DomainError, busy_domains, check_own, confine_to, domain_number, run_on, user_of


def add_graph_options(p: argparse.ArgumentParser) -> None:
    """Adds the options of every inspection command."""
    p.add_argument(
        "--domain",
        metavar="N",
        help="ROS domain (default: ROS_DOMAIN_ID, else that of the mission on this machine, else 0)",
    )
    p.add_argument(
        "--spin-time",
        type=positive,
        metavar="S",
        help="seconds to discover nodes (default: until no new one appears, up to 4.2 s)",
    )


def add_commands(p: argparse.ArgumentParser) -> argparse._SubParsersAction[argparse.ArgumentParser]:
    """Adds subcommands, whose help repeats the exit codes in the parser's epilog; returns them for `add_parser`."""
    of_command: Any = functools.partial(argparse.ArgumentParser, epilog=p.epilog)
    return p.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=of_command)


def join(wanted: str | None, commands: bool = False) -> int:
    """Sets this process's environment for the chosen domain; returns the domain.

    Args:
        wanted: The domain that the command line names.
        commands: Whether nodes are commanded or changed there, and not only watched.

    Raises:
        DomainError: if it is invalid, if several missions run on this machine and no domain is given, if the only one
            is a simulation of another user, to whose vehicles a command would go, or as `confine_to`.
    """
    text = wanted or os.environ.get("ROS_DOMAIN_ID")
    busy = busy_domains()
    if text:
        domain = domain_number(text)
    elif len(busy) > 1:
        named = [f"{domain} ({run})" if (run := run_on(domain)) else str(domain) for domain in busy]
        raise DomainError(f"Several missions are running (domains {', '.join(named)}); choose one with --domain")
    elif busy:
        domain = busy[0]
        if commands:
            check_own(domain)
        print(f"ROS domain {domain}, in use on this machine by {user_of(domain)}", file=sys.stderr)
    else:
        domain = 0
        print("ROS domain 0: no mission of auv_lse mission runs on this machine", file=sys.stderr)
    confine_to(domain)
    return domain


def _wanted(options: argparse.Namespace) -> str:
    """Full name of the one node or topic that a command is about, "" if it is about all."""
    name = getattr(options, "node", None) or getattr(options, "topic", None) or ""
    return f"/{name.lstrip('/')}" if name else ""


def run_command(options: argparse.Namespace, command: Callable[[argparse.Namespace, Any], int]) -> int:
    """Runs a command on the graph of the chosen domain; returns its exit code, 1 for an error.

    Raises:
        DomainError: if the domain is invalid, or must be chosen.
    """
    join(options.domain, commands=getattr(options, "changes", False))
    from auv_lse_run.inspect.graph_node import Graph, GraphError  # after the environment is set

    try:
        with Graph(options.spin_time, _wanted(options), getattr(options, "at_once", False)) as graph:
            if graph.missing:
                print(f"warning: still waiting for {graph.missing}; --spin-time 10 waits longer", file=sys.stderr)
            return command(options, graph)
    except (GraphError, FieldError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
