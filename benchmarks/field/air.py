"""The Wi-Fi between laptop and vehicles, packet by packet: loses, delays and interrupts what goes through TUN devices.

As a process, with SEED NEAR FAR [NEAR FAR ...], it takes the descriptors of pairs of devices, and orders on
standard input, a JSON object a line: {"link": 0, "loss": 0.3, "delay_s": 0.15, "up": true}. It ends with its input.
"""

import heapq
import json
import os
import random
import select
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_PACKET = 1 << 16
#: Packets that are read from a device before what is due is written.
_BURST = 64


@dataclass(slots=True)
class Link:
    """The link of one vehicle, the same in both directions.

    Attributes:
        loss: Probability that a packet is lost.
        delay_s: Time (s) that it takes.
        up: Whether packets pass. Those on their way when it changes still arrive.
    """

    loss: float = 0.0
    delay_s: float = 0.0
    up: bool = True

    def set(self, values: Mapping[str, Any]) -> None:
        """Sets the values of an order."""
        self.loss = float(values.get("loss", self.loss))
        self.delay_s = float(values.get("delay_s", self.delay_s))
        self.up = bool(values.get("up", self.up))


class Air:
    """Passes packets between pairs of devices."""

    def __init__(self, pairs: list[tuple[int, int]], seed: int) -> None:
        """Relays between open descriptors of devices, (near, far) of each link, which must not block."""
        self.links = [Link() for _ in pairs]
        self._random = random.Random(seed)
        self._to = {a: (b, self.links[k]) for k, pair in enumerate(pairs) for a, b in (pair, pair[::-1])}
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._count = 0

    def step(self, control: int) -> bool:
        """Waits for packets or orders and handles them; returns whether `control` has something to read."""
        wait_s = max(self._waiting[0][0] - time.monotonic(), 0.0) if self._waiting else None
        ready = select.select([*self._to, control], [], [], wait_s)[0]
        for source in ready:
            if source != control:
                self._take(source)
        self._write_due()
        return control in ready

    def _take(self, source: int) -> None:
        target, link = self._to[source]
        for _ in range(_BURST):
            try:
                packet = os.read(source, _PACKET)
            except BlockingIOError:
                return
            if link.up and self._random.random() >= link.loss:
                self._count += 1  # packets of one delay stay in order
                heapq.heappush(self._waiting, (time.monotonic() + link.delay_s, self._count, target, packet))

    def _write_due(self) -> None:
        now_s = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now_s:
            _, _, target, packet = heapq.heappop(self._waiting)
            try:
                os.write(target, packet)
            except OSError:  # the device is full or down: a lost packet
                continue


def main() -> None:
    """Passes packets until standard input ends."""
    seed, *descriptors = map(int, sys.argv[1:])
    for descriptor in descriptors:
        os.set_blocking(descriptor, False)
    air, orders = Air(list(zip(descriptors[::2], descriptors[1::2], strict=True)), seed), b""
    while True:
        if air.step(0):
            more = os.read(0, _PACKET)
            if not more:
                return
            *lines, orders = (orders + more).split(b"\n")
            for line in lines:
                values = json.loads(line)
                air.links[values["link"]].set(values)


if __name__ == "__main__":
    main()
