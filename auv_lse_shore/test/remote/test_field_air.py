"""The emulated Wi-Fi of `auv_lse faults field --packets` loses, delays and stops packets as ordered."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator

import pytest

from benchmarks.field.air import Air


@pytest.fixture
def ends() -> Iterator[tuple[Air, socket.socket, socket.socket]]:
    """A link and its two ends, which keep packets apart as devices do."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
    for pair in pairs:
        for end in pair:
            end.setblocking(False)
    yield Air([(pairs[0][1].fileno(), pairs[1][1].fileno())], seed=1), pairs[0][0], pairs[1][0]
    for pair in pairs:
        for end in pair:
            end.close()


def passed(air: Air, end: socket.socket, seconds: float) -> list[bytes]:
    """The packets that come out within a time."""
    read, write = os.pipe()
    os.write(write, b"x")  # so that no step waits
    found, end_s = [], time.monotonic() + seconds
    while time.monotonic() < end_s:
        air.step(read)
        try:
            found.append(end.recv(1 << 16))
        except BlockingIOError:
            time.sleep(0.001)
    os.close(read)
    os.close(write)
    return found


def test_packets_are_lost_delayed_and_kept_in_order(ends: tuple[Air, socket.socket, socket.socket]) -> None:
    air, near, far = ends
    air.links[0].set({"loss": 0.3, "delay_s": 0.2})
    sent = [b"%d" % k for k in range(100)]
    for packet in sent:
        near.send(packet)
    assert passed(air, far, 0.15) == [], "each needs 0.2 s"
    found = passed(air, far, 0.3)
    assert 50 < len(found) < 90
    assert found == sorted(found, key=int)
    far.send(b"back")
    air.links[0].set({"loss": 0.0, "delay_s": 0.0})
    assert passed(air, near, 0.05) == [b"back"]


def test_an_outage_swallows_packets_and_closes_nothing(ends: tuple[Air, socket.socket, socket.socket]) -> None:
    air, near, far = ends
    air.links[0].set({"up": False})
    near.send(b"lost")
    assert passed(air, far, 0.05) == []
    air.links[0].set({"up": True})
    near.send(b"kept")
    assert passed(air, far, 0.05) == [b"kept"]
