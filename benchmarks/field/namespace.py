"""A network namespace behind a link on which the kernel drops packets, in both directions. Needs root."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator

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
    _call("ip", "netns", "add", _NAME)
    try:
        _call("ip", "link", "add", _NEAR, "type", "veth", "peer", "name", _FAR)
        _call("ip", "link", "set", _FAR, "netns", _NAME)
        _call("ip", "addr", "add", f"{_HERE}/24", "dev", _NEAR)
        _call("ip", "link", "set", _NEAR, "up")
        _call(*inside, "ip", "addr", "add", f"{_THERE}/24", "dev", _FAR)
        _call(*inside, "ip", "link", "set", _FAR, "up")
        _call(*inside, "iptables", "-A", "INPUT", "-i", _FAR, *drop)
        _call(*inside, "iptables", "-A", "OUTPUT", "-o", _FAR, *drop)
        yield _THERE, inside
    finally:
        _call("ip", "netns", "del", _NAME)


def _call(*command: str) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise RuntimeError(f"{command[0]} is missing: --packets makes a network namespace") from error
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()} (--packets needs root)")
