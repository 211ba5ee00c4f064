"""A relay of TCP connections that delays, cuts and hangs them: the Wi-Fi between laptop and vehicles."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time

_CHUNK = 16384


class Relay:
    """Relays connections to a port of this machine; run it in a thread of its own (`start`).

    Attributes:
        port: Where it listens.
        target: Where it connects to; it may change, as an address does.
        delay_s: One-way delay (s) of all bytes.
        cut_rate: Probability that a connection is cut, at a random moment.
        up: Whether bytes pass; while it is False, connections hang as half-open ones do, and new ones are refused.
        counts: Connections, and those that were cut.
    """

    def __init__(self, target: int, seed: int = 1, delay_s: float = 0.0, cut_rate: float = 0.0) -> None:
        self.target, self.delay_s, self.cut_rate, self.up = target, delay_s, cut_rate, True
        #: Bytes after which a cut may come: an exchange is about this long.
        self.cut_within = 9000
        #: Bytes per second of each direction of a connection; 0: unlimited.
        self.rate_bps = 0.0
        self.counts = {"connections": 0, "cut": 0}
        self._random = random.Random(seed)
        self._server = socket.create_server(("127.0.0.1", 0), backlog=100)
        self.port: int = self._server.getsockname()[1]
        self._open: set[socket.socket] = set()

    def __enter__(self) -> Relay:
        """Begins to relay."""
        threading.Thread(target=self._serve, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Closes all connections."""
        self._server.close()
        self.cut_all()

    def cut_all(self) -> None:
        """Cuts every connection now."""
        for end in list(self._open):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def _serve(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
            except OSError:
                return
            self.counts["connections"] += 1
            if not self.up:
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self.target))
            except OSError:
                near.close()
                continue
            budget = [self._random.randrange(self.cut_within)] if self._random.random() < self.cut_rate else []
            self.counts["cut"] += len(budget)
            self._open |= {near, far}
            for a, b in ((near, far), (far, near)):
                a.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._pass, args=(a, b, budget), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket, budget: list[int]) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(_CHUNK):
                if self.delay_s:
                    time.sleep(self.delay_s)
                if self.rate_bps:
                    time.sleep(len(data) / self.rate_bps)
                while not self.up:
                    time.sleep(0.05)
                if budget:
                    budget[0] -= len(data)
                    if budget[0] <= 0:
                        break
                sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            self._open.discard(end)
