"""auv_lse go, hold, surface, abort and reset command vehicles; auv_lse state shows the states of their missions."""

import argparse
import os
import re
import sys
import time
from typing import Any

from auv_lse_common.support.confinement import reach
from auv_lse_common.vocabulary.mission_run import STALES, Command, RunState
from auv_lse_common.vocabulary.vehicle_name import vehicle_names
from auv_lse_run.inspect.domain_choice import add_commands, add_graph_options, run_command
from auv_lse_run.process.domain import DomainError

_COMMANDS = {
    "go": (Command.GO, "start the mission, or continue after a hold"),
    "hold": (Command.HOLD, "hold the position until go"),
    "surface": (Command.SURFACE, "hold at the surface until go"),
    "abort": (Command.ABORT, "end the mission; safety.abort sets what the vehicle does then"),
    "reset": (Command.RESET, "clear tripped limits and an abort; the mission then holds until go"),
}
#: Time (s) to wait for the states of missions.
_LISTEN_S = 1.0
#: Why a vehicle without a responsive safety_node takes no command, though its other nodes run.
_HUNG = "its safety_node, which takes commands, hangs or is not running. auv_lse vehicle restarts it: try again"
#: Time (s) in which a safety_node that hangs is restarted and found.
_RESTART_S = 20.0

ERRORS = (DomainError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse go, hold, surface, abort, reset and state."""
    p = argparse.ArgumentParser(
        prog="auv_lse",
        description="Starts, holds, surfaces or aborts the missions of running vehicles (service mission/run), or "
        "shows their states. The table of states: docs/guide/during-the-dive.md.",
        epilog="Exit codes: 0 every vehicle has accepted the command; 1 a vehicle has refused it or does not answer; 2 "
        "wrong command line; 130 Ctrl-C.",
    )
    commands = add_commands(p)
    for name, (command, text) in _COMMANDS.items():
        c = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        add_graph_options(c)
        c.add_argument("vehicles", nargs="+", metavar="VEHICLE", help="vehicles, such as auv2, or `all`")
        if command is Command.ABORT:
            c.add_argument("--team", action="store_true", help="also abort the team mates, by acoustic packet")
        c.set_defaults(call=run_send, what=command, at_once=True, changes=True)
    c = commands.add_parser("state", help="show the state of each vehicle's mission",
                            description="Show the state of each vehicle's mission.")  # fmt: skip
    c.epilog = "Exit codes: 0 every vehicle has reported its state; 1 a vehicle has not, or none is found; 2 wrong "
    c.epilog += "command line; 130 Ctrl-C."
    add_graph_options(c)
    c.set_defaults(call=run_state)
    return p


def run_send(options: argparse.Namespace, graph: Any) -> int:
    """`auv_lse go` and the other commands: sends to each vehicle once it is found, then reports who has answered."""
    from auv_lse_run.inspect.graph_node import GraphError
    from auv_lse_run.inspect.mission_calls_node import CommandCalls, vehicles, without_safety_node

    names = vehicle_names(options.vehicles)
    valid = None if names is None else [name for name in names if re.fullmatch(r"auv\d+", name)]
    failed = []

    def report(name: str, answer: Any) -> None:
        if answer.accepted:
            print(f"{name}: {answer.message}", flush=True)
        else:
            print(f"{name}: refused: {answer.message}", file=sys.stderr)
            failed.append(name)

    calls = CommandCalls(graph, valid, options.what, getattr(options, "team", False), report)
    try:
        if valid == []:  # no valid name: only list the vehicles that run
            graph.discover(options.spin_time)
        else:
            graph.discover(options.spin_time, calls.step)
        if options.what not in STALES:
            _wait_for_restart(calls, graph, names)
        calls.finish()
    except KeyboardInterrupt:
        unsent, silent = calls.unsent, [name for name in calls.silent if name not in calls.unsent]
        texts = [f"No answer yet from {', '.join(silent)}, which may act on it: see auv_lse state"] if silent else []
        texts += [f"{options.what.name} was not sent to {', '.join(unsent)}"] if unsent else []
        raise KeyboardInterrupt(". ".join(["interrupted", *texts]) if texts else "") from None
    nodes = graph.nodes()
    answered, there, mute = calls.acknowledged, vehicles(nodes), without_safety_node(nodes)
    for name in sorted({*([*there, *mute] if names is None else names), *calls.silent} - {*answered}):
        failed.append(name)
        why = "no answer (is it busy?)" if name in there else f"not found; running: {', '.join(there) or 'no vehicle'}"
        if name in mute:
            why = _HUNG
        if name in calls.silent:
            why = f"no answer. It may still act on {options.what.name}: see auv_lse state"
        if name in calls.unsent:
            why = f"no answer, so {options.what.name} was not sent. Try again"
        print(f"{name}: error: {why}", file=sys.stderr)
    if not answered and not failed:
        raise GraphError(_no_vehicle())
    if names is None or len(names) > 1:
        accepted = [name for name in answered if name not in failed]
        print(f"accepted by {len(accepted)}: {', '.join(accepted) or 'none'}")
    return int(bool(failed))


def _no_vehicle() -> str:
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    return (
        f"no vehicle found in ROS domain {domain} {reach(os.environ)} (no safety_node). Choose another domain with "
        "--domain N, or start one"
    )


def _wait_for_restart(calls: Any, graph: Any, names: list[str] | None) -> None:
    """Sends a stop also to the vehicles whose safety_node hangs or has died, once it is back."""
    from auv_lse_run.inspect.mission_calls_node import without_safety_node

    silent = [name for name in without_safety_node(graph.nodes()) if name not in calls.acknowledged]
    mute = [name for name in silent if names is None or name in names]
    if mute:
        why = f"its safety_node hangs or is not running; waiting up to {_RESTART_S:g} s for its restart"
        print(*(f"{name}: {why}" for name in mute), sep="\n", file=sys.stderr, flush=True)
    end_s = time.monotonic() + _RESTART_S
    while time.monotonic() < end_s and not {*mute} <= {*calls.acknowledged}:
        calls.step()
        graph.spin(0.05)


def run_state(options: argparse.Namespace, graph: Any) -> int:
    """`auv_lse state`."""
    from auv_lse_run.inspect.graph_node import GraphError
    from auv_lse_run.inspect.mission_calls_node import states, vehicles, without_safety_node

    nodes = graph.nodes()
    there, mute = vehicles(nodes), without_safety_node(nodes)
    for name in mute:
        print(f"{name}: {_HUNG}")
    if not there and not mute:
        raise GraphError(_no_vehicle())
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
    return int(bool(mute) or len(heard) < len(there))


def run(options: argparse.Namespace) -> int:
    """Returns the exit code (see --help)."""
    return run_command(options, options.call)
