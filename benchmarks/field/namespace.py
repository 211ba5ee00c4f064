"""A network namespace behind a link on which the kernel drops packets, in both directions. Needs root."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from benchmarks.command import call_as_root

_NAME, _NEAR, _FAR = "auv_lse_field", "alf0", "alf1"
_HERE, _THERE = "10.77.0.1", "10.77.0.2"


@contextlib.contextmanager
def lossy_namespace(loss: float) -> Iterator[tuple[str, tuple[str, ...]]]:
    """A context with a namespace: the address of what listens there, and the words that run a command in it.

    Args:
        loss: Probability that a packet is dropped, each way.

    Raises:
        RuntimeError: if this process may not make one.
    """
    inside = ("ip", "netns", "exec", _NAME)
    drop = ("-m", "statistic", "--mode", "random", "--probability", f"{loss:g}", "-j", "DROP")
    call_as_root("--packets", "ip", "netns", "add", _NAME)
    try:
        call_as_root("--packets", "ip", "link", "add", _NEAR, "type", "veth", "peer", "name", _FAR)
        call_as_root("--packets", "ip", "link", "set", _FAR, "netns", _NAME)
        call_as_root("--packets", "ip", "addr", "add", f"{_HERE}/24", "dev", _NEAR)
        call_as_root("--packets", "ip", "link", "set", _NEAR, "up")
        call_as_root("--packets", *inside, "ip", "addr", "add", f"{_THERE}/24", "dev", _FAR)
        call_as_root("--packets", *inside, "ip", "link", "set", _FAR, "up")
        call_as_root("--packets", *inside, "iptables", "-A", "INPUT", "-i", _FAR, *drop)
        call_as_root("--packets", *inside, "iptables", "-A", "OUTPUT", "-o", _FAR, *drop)
        yield _THERE, inside
    finally:
        call_as_root("--packets", "ip", "netns", "del", _NAME)
