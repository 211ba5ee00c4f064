"""auv_lse topics: list, echo, hz, bw, info; arguments and output as those of `ros2 topic`."""

import argparse
import difflib
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from auv_lse_common.support.option_types import positive, whole_from
from auv_lse_run.inspect.domain_choice import add_commands, add_graph_options, run_command
from auv_lse_run.inspect.message_text import TRUNCATE, csv_text, field_of, plain, yaml_text
from auv_lse_run.inspect.rates import Bandwidth, Rate
from auv_lse_run.process.domain import DomainError

#: `topics echo` prints without end, and does nothing else.
ENDS_WITH_READER = True
ERRORS = (DomainError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse topics."""
    p = argparse.ArgumentParser(
        prog="auv_lse topics",
        description="Inspects the topics of running nodes, as `ros2 topic` does, on machines without that command.",
        epilog="Exit codes: 0; 1 a topic or field does not exist, or there is none to list; 2 a wrong command line; "
        "130 Ctrl-C.",
    )
    commands = add_commands(p)

    def command(name: str, run: Callable[[argparse.Namespace, Any], int], text: str) -> argparse.ArgumentParser:
        c = commands.add_parser(name, help=text, description=text)
        add_graph_options(c)
        c.set_defaults(call=run)
        return c

    c = command("list", run_list, "names of the topics")
    c.add_argument("-t", "--show-types", action="store_true", help="with the message type")
    c.add_argument("-c", "--count-topics", action="store_true", help="only their number")
    c.add_argument("-v", "--verbose", action="store_true", help="with type and number of publishers and subscribers")

    c = command("echo", run_echo, "messages of a topic, as YAML")
    c.add_argument("topic", metavar="TOPIC")
    c.add_argument("type", nargs="?", metavar="TYPE", help="message type, for a topic that does not exist yet")
    c.add_argument("--once", action="store_true", help="print one message and exit")
    c.add_argument("--field", metavar="NAME", help="print only this part: pose.pose.position, status[0].message")
    c.add_argument("--csv", action="store_true", help="one line of comma-separated values for each message")
    c.add_argument("--no-arr", action="store_true", help="print the length of arrays instead of their elements")
    c.add_argument(
        "-l", "--truncate-length", type=whole_from(0), default=TRUNCATE, metavar="N", help="elements shown of an array"
    )
    c.add_argument("-f", "--full-length", action="store_true", help="arrays and texts in full")

    for name, run, text, window in (
        ("hz", run_hz, "publishing rate of a topic", 10000),
        ("bw", run_bw, "bandwidth of a topic", 100),
    ):
        c = command(name, run, text)
        c.add_argument("topic", metavar="TOPIC")
        c.add_argument(
            "-w",
            "--window",
            type=whole_from(1),
            default=window,
            metavar="N",
            help=f"averaging window ({window})",
        )
        c.add_argument(
            "--duration", type=positive, metavar="S", help="exit after this many seconds (default: on Ctrl-C)"
        )

    c = command("info", run_info, "type, publishers and subscribers of a topic, and incompatible pairs")
    c.add_argument("topic", metavar="TOPIC")
    c.add_argument("-v", "--verbose", action="store_true", help="with nodes and quality of service")
    return p


def run_list(options: argparse.Namespace, graph: Any) -> int:
    """`topics list`."""
    graph.require_nodes()
    topics = graph.topics()
    if options.count_topics:
        print(len(topics))
    elif options.verbose:
        _list_verbose(topics, graph)
    else:
        for name, kinds in topics.items():
            print(f"{name} [{', '.join(kinds)}]" if options.show_types else name)
    return 0


def _list_verbose(topics: dict[str, tuple[str, ...]], graph: Any) -> None:
    ends = {name: graph.endpoints(name) for name in topics}
    for heading, side, word in (("Published topics:", 0, "publisher"), ("\nSubscribed topics:", 1, "subscriber")):
        print(heading)
        for name, kinds in topics.items():
            if count := len(ends[name][side]):
                print(f" * {name} [{', '.join(kinds)}] {count} {word}{'s' if count > 1 else ''}")


def _wait_for_type(graph: Any, topic: str, wanted: str | None = None) -> type:
    """The message type, once the topic exists."""
    kind: type | None = graph.message_type(topic, wanted)
    if kind is None:
        near = difflib.get_close_matches(topic, graph.topics(), n=1, cutoff=0.7)
        hint = f"; did you mean {near[0]}?" if near else ""
        where = f"in ROS domain {os.environ['ROS_DOMAIN_ID']}"
        print(f"topic {topic}: no publisher or subscriber yet {where}; waiting{hint}", file=sys.stderr)
    while kind is None:
        graph.spin(0.2)
        kind = graph.message_type(topic)
    return kind


def run_echo(options: argparse.Namespace, graph: Any) -> int:
    """`topics echo`."""
    done: list[bool] = []
    truncate = None if options.full_length else options.truncate_length

    def show(message: Any) -> None:
        if options.once and done:
            return
        part = field_of(message, options.field) if options.field else message
        content = plain(part, truncate, arrays=not options.no_arr)
        print(csv_text(content) if options.csv else yaml_text(content) + "---\n", end="", flush=True)
        done.append(True)

    topic = _full(options.topic)
    graph.listen(topic, _wait_for_type(graph, topic, options.type), show)
    while not (options.once and done):
        graph.spin(0.05 if options.once else 1.0)
    return 0


def run_hz(options: argparse.Namespace, graph: Any) -> int:
    """`topics hz`."""
    rate = Rate(options.window)
    return _measure(options, graph, lambda message: rate.note(time.monotonic()), rate.text)


def run_bw(options: argparse.Namespace, graph: Any) -> int:
    """`topics bw`."""
    bandwidth = Bandwidth(options.window)
    return _measure(
        options,
        graph,
        lambda message: bandwidth.note(time.monotonic(), len(message)),
        lambda: bandwidth.text(time.monotonic()),
    )


def _measure(options: argparse.Namespace, graph: Any, take: Callable[[Any], None], text: Callable[[], str]) -> int:
    topic = _full(options.topic)
    graph.listen(topic, _wait_for_type(graph, topic), take, raw=True)
    if options.command == "bw":
        print(f"Subscribed to [{topic}]", flush=True)
    until = None if options.duration is None else time.monotonic() + options.duration
    warned = False
    while until is None or time.monotonic() < until:
        graph.spin(1.0 if until is None else max(min(1.0, until - time.monotonic()), 0.0))
        if found := text():
            print(found, flush=True)
        elif not warned:
            print("no two messages yet; waiting", file=sys.stderr)
        warned = True
    return 0


def run_info(options: argparse.Namespace, graph: Any) -> int:
    """`topics info`."""
    from auv_lse_run.inspect.graph_node import mismatches

    topic = _full(options.topic)
    kinds = graph.topics(hidden=True).get(topic)
    if kinds is None:
        near = difflib.get_close_matches(topic, graph.topics(), n=1, cutoff=0.7)
        hint = f"; did you mean {near[0]}?" if near else "; list the topics: auv_lse topics list"
        print(f"error: topic {topic}: not found{hint}", file=sys.stderr)
        return 1
    publishers, subscriptions = graph.endpoints(topic)
    print(f"Type: {kinds[0] if len(kinds) == 1 else list(kinds)}")
    gap = "\n" if options.verbose else ""
    for word, ends in (("Publisher", publishers), ("Subscription", subscriptions)):
        print(f"{gap}{word} count: {len(ends)}")
        for end in ends if options.verbose else ():
            print(f"\nNode name: {end.node}\nNode namespace: {end.namespace}\nTopic type: {end.type}")
            print(f"Topic type hash: {end.type_hash}\nEndpoint type: {end.kind}\nGID: {end.gid}\nQoS profile:")
            print("\n".join(f"  {line}" for line in end.qos))
    for text in mismatches(publishers, subscriptions):
        print(f"{gap}Mismatch: {text}")
    return 0


def _full(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"


def run(options: argparse.Namespace) -> int:
    """Returns the exit code (see --help)."""
    return run_command(options, options.call)
