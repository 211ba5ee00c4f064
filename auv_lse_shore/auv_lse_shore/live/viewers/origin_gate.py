"""A local port that passes WebSocket connections on to a server only if their `Host` and `Origin` are allowed.

The SDK's server checks neither header, so any web page could read the mission, even through a host name that resolves
to 127.0.0.1 (DNS rebinding). The gate reads the first request of each connection, refuses it or passes it on, and then
copies bytes both ways. The server itself listens on a random port of a random address of the loopback network: a web
page cannot find it by trying.
"""

from __future__ import annotations

import contextlib
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable, Collection

#: Longest first request (bytes), longest wait for it (s), and largest number of connections at a time.
MAX_REQUEST, REQUEST_S, MAX_CONNECTIONS = 1 << 14, 5.0, 32
#: Time (s) after which the gate accepts again when the system has refused, such as for lack of file descriptors.
_RETRY_S = 0.2
_END = b"\r\n\r\n"
#: Pages that a program on this machine serves.
_LOCAL = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d{1,5})?")


def hidden_address() -> str:
    """A random address of the loopback network, 127.1.0.0 to 127.254.255.255."""
    return f"127.{1 + secrets.randbelow(254)}.{secrets.randbelow(256)}.{1 + secrets.randbelow(254)}"


def refusal(request: bytes, hosts: Collection[str], origins: Collection[str]) -> str:
    """Why a WebSocket request is refused; "" if it is not.

    Args:
        request: The request up to its empty line.
        hosts: Values of `Host` that name this server, with the port.
        origins: Values of `Origin` of pages that may connect, besides those of this machine. Programs that are no
            browser send none.
    """
    found: dict[str, list[str]] = {}
    for line in request.split(b"\r\n")[1:]:
        name, colon, value = line.partition(b":")
        if colon:
            found.setdefault(name.decode("latin-1").strip().lower(), []).append(value.decode("latin-1").strip())
    host, origin = found.get("host", []), found.get("origin", [])
    if found.get("upgrade", [""])[0].lower() != "websocket":
        return "expected a WebSocket connection"
    if len(host) != 1 or host[0].lower() not in hosts:
        return f"Host {', '.join(host)!r}: expected one of {', '.join(sorted(hosts))}"
    if not origin or (len(origin) == 1 and (origin[0].lower() in origins or _LOCAL.fullmatch(origin[0].lower()))):
        return ""
    return f"Origin {', '.join(origin)!r}: expected a page of this machine. To allow it: --foxglove-origin {origin[0]}"


class OriginGate:
    """The port, served by threads until `close`.

    Attributes:
        port: Its number.
        server: Address and port of the server.
        failures: Number of connections that the system could not open.
    """

    def __init__(self, address: str, port: int, origins: Collection[str], report: Callable[[str], None]) -> None:
        """Listens on `address`, `port` (0: any free one).

        Args:
            address: Address to listen on.
            port: Port to listen on.
            origins: Pages that may connect, besides those of this machine.
            report: Takes why a connection was refused or failed, from any thread; each reason once.

        Raises:
            OSError: if the port is in use.
        """
        self._listener = socket.create_server((address, port))
        self.port = int(self._listener.getsockname()[1])
        self.server = (address, 0)
        self._report, self._reported = report, set[str]()
        self._hosts = {f"{name}:{self.port}" for name in (address, "localhost")}
        self._origins = {origin.lower() for origin in origins}
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self.failures = 0
        threading.Thread(target=self._listen, name="foxglove gate", daemon=True).start()

    def close(self) -> None:
        """Stops listening and closes every connection."""
        self._closed.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            for connection in self._open:
                _shut(connection)

    def _listen(self) -> None:
        while not self._closed.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError as error:
                self._fail(error)
                continue
            with self._lock:
                full = len(self._open) >= 2 * MAX_CONNECTIONS
                if not full:
                    self._open.add(client)
            if full:
                client.close()
                continue
            try:
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()
            except RuntimeError as error:  # no more threads
                self._drop(client)
                self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Counts and reports an error of the system, and waits; after `close` does nothing."""
        if self._closed.is_set():
            return
        self.failures += 1
        self._report_once(f"cannot open connections: {error}; retrying")
        self._closed.wait(_RETRY_S)

    def _report_once(self, text: str) -> None:
        with self._lock:
            new = text not in self._reported and len(self._reported) < MAX_CONNECTIONS
            if new:
                self._reported.add(text)
        if new:
            self._report(text)

    def _drop(self, side: socket.socket) -> None:
        side.close()
        with self._lock:
            self._open.discard(side)

    def _refuse(self, client: socket.socket, reason: str) -> None:
        self._report_once(f"refused: {reason}")
        body = f"refused: {reason}\n".encode("ascii", "replace")
        head = f"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Length: {len(body)}\r\n\r\n"
        client.sendall(head.encode() + body)

    def _serve(self, client: socket.socket) -> None:
        server: socket.socket | None = None
        try:
            head, rest = _first_request(client)
            reason = refusal(head, self._hosts, self._origins)
            if reason:
                self._refuse(client, reason)
                return
            server = socket.create_connection(self.server, REQUEST_S)
            with self._lock:
                self._open.add(server)
            for side in (client, server):
                side.settimeout(None)
            server.sendall(head + _END + rest)
            back = threading.Thread(target=_copy, args=(server, client), daemon=True)
            back.start()
            _copy(client, server)
            back.join()
        except OSError:
            pass  # either side is gone
        finally:
            for side in filter(None, (client, server)):
                self._drop(side)


def _first_request(client: socket.socket) -> tuple[bytes, bytes]:
    """The request up to its empty line, and the bytes after that. Raises OSError if it does not come in time."""
    client.settimeout(REQUEST_S)
    data, until_s = b"", time.monotonic() + REQUEST_S
    while _END not in data:
        more = client.recv(4096)
        if not more or len(data) > MAX_REQUEST or time.monotonic() > until_s:
            raise OSError("no request")
        data += more
    head, _, rest = data.partition(_END)
    return head, rest


def _copy(source: socket.socket, target: socket.socket) -> None:
    """Copies until either side closes, then closes both."""
    with contextlib.suppress(OSError):
        while data := source.recv(1 << 16):
            target.sendall(data)
    for side in (source, target):
        _shut(side)


def _shut(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
