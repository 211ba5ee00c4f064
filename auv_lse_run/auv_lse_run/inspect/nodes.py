"""auv_lse nodes: list, info; arguments and output as those of `ros2 node`."""

import argparse
import difflib
import sys
from collections import Counter
from typing import Any

from auv_lse_run.inspect.domain_choice import add_commands, add_graph_options, run_command
from auv_lse_run.process.domain import DomainError

_ACTION = "/_action/"
#: The node of `auv_lse live`: several may watch.
_VIEW = "/live_view"

ERRORS = (DomainError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse nodes."""
    p = argparse.ArgumentParser(
        prog="auv_lse nodes",
        description="Inspects running nodes, as `ros2 node` does, on machines without that command.",
        epilog="Exit codes: 0; 1 a node does not exist, or there is none to list; 2 a wrong command line; 130 Ctrl-C.",
    )
    commands = add_commands(p)
    c = commands.add_parser("list", help="names of the nodes")
    add_graph_options(c)
    c.add_argument("-a", "--all", action="store_true", help="also those with a leading underscore")
    c.add_argument("-c", "--count-nodes", action="store_true", help="only their number")
    c.set_defaults(call=run_list)
    c = commands.add_parser("info", help="subscriptions, publications, services and clients of a node")
    add_graph_options(c)
    c.add_argument("node", metavar="NODE", help="full name, such as /auv1/planner_node")
    c.set_defaults(call=run_info)
    return p


def run_list(options: argparse.Namespace, graph: Any) -> int:
    """`nodes list`."""
    names = graph.nodes(options.all)
    if options.count_nodes:
        print(len(names))
    graph.require_nodes()
    if options.count_nodes:
        return 0
    for name in names:
        print(name)
    for name, count in Counter(names).items():
        if count > 1 and name != _VIEW:
            print(f"warning: {count} nodes have the name {name}; one of them may be left over", file=sys.stderr)
    return 0


def run_info(options: argparse.Namespace, graph: Any) -> int:
    """`nodes info`."""
    name = known_node(options.node, graph)
    print(name)
    found = graph.node_topics(name)
    actions = {"Action Servers": "Service Servers", "Action Clients": "Service Clients"}
    for heading, pairs in found.items():
        print(f"  {heading}:")
        for topic, kinds in pairs:
            if _ACTION not in topic:
                print(f"    {topic}: {', '.join(kinds)}")
    for heading, services in actions.items():
        print(f"  {heading}:")
        for topic, kinds in found[services]:
            if topic.endswith(f"{_ACTION}send_goal"):
                print(f"    {topic.removesuffix(f'{_ACTION}send_goal')}: {kinds[0].removesuffix('_SendGoal')}")
    return 0


def known_node(name: str, graph: Any) -> str:
    """The full name of an existing node.

    Raises:
        GraphError: if it does not exist, with the name of a similar one.
    """
    from auv_lse_run.inspect.graph_node import GraphError

    full, there = name if name.startswith("/") else f"/{name}", graph.nodes(hidden=True)
    if full not in there:
        near = difflib.get_close_matches(full, there, n=1, cutoff=0.6)
        hint = f"did you mean {near[0]}?" if near else "list the running nodes: auv_lse nodes list"
        raise GraphError(f"node {full}: not found; {hint}")
    return full


def run(options: argparse.Namespace) -> int:
    """Returns the exit code (see --help)."""
    return run_command(options, options.call)
