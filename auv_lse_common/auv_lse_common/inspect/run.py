"""scripts/run: sends go, hold, surface, abort or reset to vehicles, and shows the state of their missions."""

from __future__ import annotations

import argparse
import getpass
import re
import sys
from collections.abc import Sequence
from typing import Any

from auv_lse_common.inspect.domain_choice import add_commands, add_graph_options, run_command
from auv_lse_common.vocabulary.mission_run import Command, RunState

_COMMANDS = {
    "go": (Command.GO, "start the mission, or continue after a hold"),
    "hold": (Command.HOLD, "hold the position until go"),
    "surface": (Command.SURFACE, "hold at the surface until go"),
    "abort": (Command.ABORT, "end the mission; safety.abort sets what the vehicle does then"),
    "reset": (Command.RESET, "clear tripped limits and an abort; the mission then holds until go"),
}
#: Time (s) to wait for the states of missions.
_LISTEN_S = 1.0


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/run."""
    p = argparse.ArgumentParser(
        prog="scripts/run",
        description="Starts, holds, surfaces or aborts the missions of running vehicles (service mission/run), or "
        "shows their states. The table of states: docs/guide/during-the-dive.md.",
        epilog="Exit codes: 0 every vehicle has accepted the command; 1 a vehicle has refused it or does not answer; 2 "
        "wrong command line; 130 Ctrl-C.",
    )
    commands = add_commands(p)
    for name, (command, text) in _COMMANDS.items():
        c = commands.add_parser(name, help=text, description=text)
        add_graph_options(c)
        c.add_argument("vehicles", nargs="+", metavar="VEHICLE", help="vehicles, as auv2, or `all`")
        if command is Command.ABORT:
            c.add_argument("--team", action="store_true", help="also abort the team mates, by acoustic packet")
        c.set_defaults(run=run_tell, what=command)
    c = commands.add_parser("state", help="show the state of each vehicle's mission")
    add_graph_options(c)
    c.set_defaults(run=run_state)
    return p


def _vehicles(graph: Any) -> list[str]:
    """The vehicles with a running safety_node."""
    found = [re.fullmatch(r"/(auv\d+)/safety_node", name) for name in graph.nodes()]
    return sorted({match[1] for match in found if match}, key=lambda name: int(name[3:]))


def run_tell(options: argparse.Namespace, graph: Any) -> int:
    """`run go` and the other commands."""
    from auv_lse_common.inspect.graph_node import GraphError
    from auv_lse_common.inspect.mission_calls_node import tell

    there = _vehicles(graph)
    wanted = there if options.vehicles == ["all"] else options.vehicles
    if not wanted:
        raise GraphError("no vehicle found (no safety_node in this ROS domain). Fix: --domain N, or start one")
    failed = False
    for name in wanted:
        try:
            if name not in there:
                raise GraphError(f"{name}: not found; running: {', '.join(there) or 'no vehicle'}")
            taken, text = tell(graph, name, options.what, getpass.getuser(), getattr(options, "team", False))
        except GraphError as error:  # the other vehicles still receive the command
            print(f"{name}: error: {error}", file=sys.stderr)
            failed = True
            continue
        if taken:
            print(f"{name}: {text}")
        else:
            print(f"{name}: refused: {text}", file=sys.stderr)
        failed = failed or not taken
    return int(failed)


def run_state(options: argparse.Namespace, graph: Any) -> int:
    """`run state`."""
    from auv_lse_common.inspect.graph_node import GraphError
    from auv_lse_common.inspect.mission_calls_node import states

    there = _vehicles(graph)
    if not there:
        raise GraphError("no vehicle found (no safety_node in this ROS domain). Fix: --domain N, or start one")
    heard = states(graph, there, _LISTEN_S)
    for name in there:
        if name not in heard:
            print(f"{name}: no state received")
            continue
        message = heard[name]
        text = f"{name}: {RunState(message.state).name}"
        print(f"{text}: {message.reason}" if message.reason else text)
        for limit in message.limits:
            print(f"    tripped: {limit}")
        for warning in message.warnings:
            print(f"    warning: {warning}")
    return int(len(heard) < len(there))


def main(arguments: Sequence[str] | None = None) -> int:
    """Commands vehicles. Returns the exit code (see --help)."""
    options = parser().parse_args(arguments)
    return run_command(options, options.run)


if __name__ == "__main__":
    sys.exit(main())
