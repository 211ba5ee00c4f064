"""Serves the live view to browsers on this machine, and to nobody else.

Every request must name this machine (`Host`) and, if it names where it comes from (`Origin`), come from this very
page. Otherwise a page elsewhere on the web could read the mission through a name of its own that it lets lead to
127.0.0.1. There are two addresses, the page and its stream of events, and no files.
"""

from __future__ import annotations

import asyncio
import json
import socket
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers.page import live_page, script_hash

#: The only address that is listened on.
ADDRESS = "127.0.0.1"
DEFAULT_PORT = 8642
#: Names of this machine that a browser may use.
_NAMES = ("127.0.0.1", "localhost")
#: Wall-clock seconds between two looks at the timeline, for each page.
_PERIOD_S = 0.1
#: Wall-clock seconds after which a page is told that nothing is new.
_QUIET_S = 2.0
#: Most events in one message.
_BATCH = 400
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src '{script}'; img-src data:; "
    "connect-src ws://127.0.0.1:{port} ws://localhost:{port}; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


class PortTakenError(OSError):
    """The port is in use by another program."""


def port_or_any(port: int) -> int:
    """The port if nobody listens on it, else 0: any that is free."""
    try:
        with socket.create_server((ADDRESS, port)):
            return port
    except OSError:
        return 0


class LiveServer:
    """The page and its events on one port of 127.0.0.1.

    Attributes:
        url: What to open in a browser.
    """

    def __init__(self, timeline: Timeline, port: int) -> None:
        """Takes the port; serves once an event loop runs.

        Args:
            timeline: What the pages are told.
            port: TCP port, 0 for any that is free.

        Raises:
            PortTakenError: if the port is in use or not allowed.
        """
        try:
            sockets = tornado.netutil.bind_sockets(port, ADDRESS, family=socket.AF_INET)
        except OSError as error:
            raise PortTakenError(
                f"--port {port}: cannot listen on {ADDRESS}:{port}: {error.strerror or error}; is another live view "
                "open? fix: --port N with another number, or --port 0 for any that is free"
            ) from error
        self.port = sockets[0].getsockname()[1]
        self.url = f"http://{ADDRESS}:{self.port}/"
        given = {"timeline": timeline, "port": self.port}
        application = tornado.web.Application(
            [("/", PageHandler, given), ("/events", EventsHandler, given)],
            default_handler_class=NothingHandler,
            default_handler_args=given,
            log_function=lambda handler: None,
            websocket_ping_interval=20,
            websocket_max_message_size=1 << 12,
        )
        self._server = tornado.httpserver.HTTPServer(application, max_buffer_size=1 << 16)
        self._server.add_sockets(sockets)

    async def close(self) -> None:
        """Stops listening and closes every connection."""
        self._server.stop()
        await self._server.close_all_connections()


class _Guard(tornado.web.RequestHandler):
    """Refuses requests that do not come from this machine's own page."""

    def initialize(self, timeline: Timeline, port: int) -> None:
        """Takes the timeline and the server's port."""
        self.timeline = timeline
        self._hosts = {f"{name}:{port}" for name in _NAMES}
        self._port = port

    def prepare(self) -> None:
        """Checks the headers before anything else is done."""
        host, origin = self.request.headers.get("Host", ""), self.request.headers.get("Origin")
        if host not in self._hosts:
            self._refuse(f"Host {host!r}: expected one of {', '.join(sorted(self._hosts))}")
        elif origin is not None and origin not in {f"http://{name}" for name in self._hosts}:
            self._refuse(f"Origin {origin!r}: expected http://{host}")

    def _refuse(self, reason: str) -> None:
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"refused: {reason}\n")

    def set_default_headers(self) -> None:
        """Headers of every answer: nothing is kept, framed, guessed or fetched from elsewhere."""
        self.clear_header("Server")
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")

    def write_error(self, status_code: int, **_: Any) -> None:
        """A line of text instead of a page with a traceback."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}\n")


class PageHandler(_Guard):
    """The page."""

    def get(self) -> None:
        """Gives the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        page = live_page()
        policy = _POLICY.format(script=script_hash(page), port=self._port)
        self.set_header("Content-Security-Policy", policy)
        self.finish(page)

    head = get


class NothingHandler(_Guard):
    """Every other address."""

    def prepare(self) -> None:
        """Nothing is there, whoever asks."""
        super().prepare()
        if not self._finished:
            self.send_error(404)


class EventsHandler(_Guard, tornado.websocket.WebSocketHandler):
    """The events of one page: it says what it has, and gets what follows for as long as it stays."""

    _sending: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        """Whether the page may connect; `prepare` has checked it against the same list."""
        return origin in {f"http://{name}" for name in self._hosts}

    def get_compression_options(self) -> dict[str, Any] | None:
        """No compression: the connection never leaves this machine."""
        return None

    def on_message(self, message: str | bytes) -> None:
        """Takes the page's first message, {"name": ..., "have": ...}; closes on anything else."""
        try:
            wanted = json.loads(message)
            name, have = str(wanted["name"]), int(wanted["have"])
        except (ValueError, TypeError, KeyError):
            self.close(1003, 'expected {"name": text, "have": number}')
            return
        if self._sending is None:
            self._sending = asyncio.get_running_loop().create_task(self._send(name, have))

    def on_close(self) -> None:
        """Stops sending."""
        if self._sending is not None:
            self._sending.cancel()

    async def _send(self, name: str, have: int) -> None:
        state: Any = None
        quiet_s = 0.0
        while True:
            name, first, events = self.timeline.since(name, have, _BATCH)
            now = self.timeline.state
            if events or first != have or now != state or quiet_s >= _QUIET_S:
                told = {"name": name, "from": first, "events": events, "state": now}
                try:
                    await self.write_message(json.dumps(told, separators=(",", ":")))
                except tornado.websocket.WebSocketClosedError:
                    return
                have, state, quiet_s = first + len(events), now, 0.0
            if len(events) < _BATCH:
                await asyncio.sleep(_PERIOD_S)
                quiet_s += _PERIOD_S
