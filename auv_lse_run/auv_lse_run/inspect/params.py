"""auv_lse params: list, get, set, dump, describe; arguments and output as those of `ros2 param`."""

import argparse
import difflib
import sys
from typing import Any

import yaml

from auv_lse_common.mission_file.parameters import ParameterError, nest
from auv_lse_common.mission_file.strict_yaml import yaml_value
from auv_lse_run.inspect.domain_choice import add_commands, add_graph_options, run_command
from auv_lse_run.inspect.nodes import known_node
from auv_lse_run.process.domain import DomainError

#: Names of the types of values in `ros2 param get`.
_KINDS = {bool: "Boolean", int: "Integer", float: "Double", str: "String"}

ERRORS = (DomainError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse params."""
    p = argparse.ArgumentParser(
        prog="auv_lse params",
        description="Inspects and sets the parameters of running nodes, as `ros2 param` does, on machines without "
        "that command. docs/guide/tuning.md lists those that may change while a node runs.",
        epilog="Exit codes: 0; 1 a node or parameter does not exist, there is none to list, or a value is refused; 2 a "
        "wrong command line; 130 Ctrl-C.",
    )
    commands = add_commands(p)
    c = commands.add_parser("list", help="names of the parameters of a node, or of all")
    add_graph_options(c)
    c.add_argument("node", nargs="?", metavar="NODE", help="full name, such as /auv1/planner_node")
    c.add_argument("--param-type", action="store_true", help="with their types")
    c.add_argument("--filter", metavar="TEXT", default="", help="only names that contain this text")
    c.set_defaults(call=run_list)
    texts = {
        "get": "value of a parameter",
        "set": "set a parameter",
        "describe": "type, range and meaning of parameters",
    }
    for name, run in (("get", run_get), ("set", run_set), ("describe", run_describe)):
        c = commands.add_parser(name, help=texts[name])
        add_graph_options(c)
        c.add_argument("node", metavar="NODE")
        c.add_argument("name", metavar="NAME", nargs="+" if name == "describe" else None)
        if name == "get":
            c.add_argument("--hide-type", action="store_true", help="only the value")
        if name == "set":
            c.add_argument("value", metavar="VALUE", help="as YAML: 4000, 0.5, true, [240, 241], text")
        c.set_defaults(call=run, changes=name == "set")
    c = commands.add_parser("dump", help="all parameters of a node, as a parameter file")
    add_graph_options(c)
    c.add_argument("node", metavar="NODE")
    c.set_defaults(call=run_dump)
    return p


def run_list(options: argparse.Namespace, graph: Any) -> int:
    """`params list`."""
    from auv_lse_run.inspect.graph_node import GraphError, parameter_type

    if not options.node:
        graph.require_nodes()
    for node in [known_node(options.node, graph)] if options.node else graph.nodes():
        try:
            names = [name for name in graph.parameter_names(node) if options.filter in name]
        except GraphError as error:  # one node that does not answer must not hide the others
            if options.node:
                raise
            print(f"warning: {error}", file=sys.stderr)
            continue
        if not options.node:
            print(f"{node}:")
        types = graph.descriptions(node, names) if options.param_type else []
        for i, name in enumerate(names):
            print(f"  {name} (type: {parameter_type(types[i].type)})" if types else f"  {name}")
    return 0


def _known_parameter(name: str, node: str, graph: Any) -> None:
    """Raises GraphError if the node has no such parameter, with the name of a similar one."""
    from auv_lse_run.inspect.graph_node import GraphError

    names = graph.parameter_names(node)
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {near[0]}?" if near else f"list its parameters: auv_lse params list {node}"
        raise GraphError(f"parameter {name}: not found on {node}; {hint}")


def run_get(options: argparse.Namespace, graph: Any) -> int:
    """`params get`."""
    node = known_node(options.node, graph)
    _known_parameter(options.name, node, graph)
    value = graph.parameters(node, [options.name]).get(options.name)
    if value is None:
        print("Parameter not set.")
    elif options.hide_type:
        print(value)
    elif isinstance(value, list):
        print(f"{_KINDS.get(type(value[0]) if value else str, 'String')} values are: {value}")
    else:
        print(f"{_KINDS[type(value)]} value is: {value}")
    return 0


def run_set(options: argparse.Namespace, graph: Any) -> int:
    """`params set`."""
    node = known_node(options.node, graph)
    _known_parameter(options.name, node, graph)
    now = graph.parameters(node, [options.name]).get(options.name)
    try:
        value = yaml_value(options.value)
    except ParameterError as error:
        if isinstance(now, int | float):
            print(f"error: {error}", file=sys.stderr)
            return 2
        value = options.value
    if isinstance(now, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)  # 12 means 12.0
    if isinstance(now, str):
        value = options.value
    refused = graph.set_parameter(node, options.name, value)
    if refused is not None:
        print(f"Setting parameter failed: {refused}", file=sys.stderr)
        return 1
    print("Set parameter successful")
    return 0


def run_dump(options: argparse.Namespace, graph: Any) -> int:
    """`params dump`."""
    node = known_node(options.node, graph)
    values = {k: v for k, v in graph.parameters(node, graph.parameter_names(node)).items() if v is not None}
    print(yaml.safe_dump({node: {"ros__parameters": nest(values)}}, default_flow_style=False, width=2**31), end="")
    return 0


def run_describe(options: argparse.Namespace, graph: Any) -> int:
    """`params describe`."""
    from auv_lse_run.inspect.graph_node import parameter_type

    node = known_node(options.node, graph)
    for name in options.name:
        _known_parameter(name, node, graph)
    for found in graph.descriptions(node, options.name):
        print(f"Parameter name: {found.name}\n  Type: {parameter_type(found.type)}")
        if found.description:
            print(f"  Description: {found.description}")
        print("  Constraints:")
        for bounds in (*found.floating_point_range, *found.integer_range):
            print(f"    Min value: {bounds.from_value}\n    Max value: {bounds.to_value}")
            if bounds.step:
                print(f"    Step: {bounds.step}")
        if found.additional_constraints:
            print(f"    Additional constraints: {found.additional_constraints}")
        if found.read_only:
            print("    Read only: true")
    return 0


def run(options: argparse.Namespace) -> int:
    """Returns the exit code (see --help)."""
    return run_command(options, options.call)
