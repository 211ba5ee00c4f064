"""Serves the live view to browsers on this machine only.

The `Host` header of a request must name this machine, and its `Origin` header, if any, must be this page. This prevents
DNS rebinding: another website could otherwise read the mission under a name that resolves to 127.0.0.1. There are three
addresses, the page, its stream of events and its commands, and no files.

Commands need the token that is printed with the page's address, so that other users of this machine cannot send any.
It is the address's fragment, which browsers do not send; the page sends it in a header.
"""

import asyncio
import contextlib
import hmac
import json
import secrets
import socket
import threading
from collections.abc import Iterator
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from auv_lse_shore.live.sources.command_queue import CommandError, CommandQueue
from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers.page import live_page, script_hash

#: The only address on which the server listens.
ADDRESS = "127.0.0.1"
DEFAULT_PORT = 8642
#: Names of this machine that a browser may use.
_NAMES = ("127.0.0.1", "localhost")
#: Period (s of wall clock) with which each page's connection polls the timeline.
_PERIOD_S = 0.1
#: Wall clock (s) without news after which an empty message keeps the connection alive.
_QUIET_S = 2.0
#: Maximum number of events in one message.
_BATCH = 2000
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src '{script}'; img-src data:; "
    "connect-src 'self' ws://127.0.0.1:{port} ws://localhost:{port}; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


#: Header in which the page sends the token.
TOKEN_HEADER = "X-Live-Token"


class PortTakenError(OSError):
    """The port is in use by another program."""


def port_or_any(port: int) -> int:
    """The port if it is free, else 0 (any free port)."""
    try:
        with socket.create_server((ADDRESS, port)):
            return port
    except OSError:
        return 0


class LiveServer:
    """The page and its events on one port of 127.0.0.1.

    Attributes:
        url: Address to open in a browser.
        token: The token of the commands, "" if there are none; it is part of `url`.
    """

    def __init__(self, timeline: Timeline, port: int, commands: CommandQueue | None = None) -> None:
        """Binds the port; serves once an event loop runs.

        Args:
            port: TCP port, 0 for any free port.
            commands: Queue for the page's commands; None: they are refused.

        Raises:
            PortTakenError: if the port is in use or not allowed.
        """
        try:
            sockets = tornado.netutil.bind_sockets(port, ADDRESS, family=socket.AF_INET)
        except OSError as error:
            raise PortTakenError(
                f"--port {port}: cannot listen on {ADDRESS}:{port}: {error.strerror or error}. Close the other live "
                "view, or choose another port: --port N, or --port 0 for any free one"
            ) from error
        self.port = sockets[0].getsockname()[1]
        self.token = "" if commands is None else secrets.token_urlsafe(16)
        self.url = f"http://{ADDRESS}:{self.port}/" + (f"#control={self.token}" if self.token else "")
        given = {"timeline": timeline, "port": self.port}
        commanded = {**given, "commands": commands, "token": self.token}
        application = tornado.web.Application(
            [("/", PageHandler, given), ("/events", EventsHandler, given), ("/command", CommandHandler, commanded)],
            default_handler_class=NotFoundHandler,
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


@contextlib.contextmanager
def served(timeline: Timeline, port: int) -> Iterator[str]:
    """A context with a server of the page in a thread of its own; the value is its address.

    Args:
        port: TCP port, 0 for any free port.

    Raises:
        PortTakenError: if the port is in use or not allowed.
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def begin() -> LiveServer:
        return LiveServer(timeline, port)

    try:
        server = asyncio.run_coroutine_threadsafe(begin(), loop).result()
        try:
            yield server.url
        finally:
            asyncio.run_coroutine_threadsafe(server.close(), loop).result(5.0)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5.0)


class _Guard(tornado.web.RequestHandler):
    """Rejects requests that do not come from this machine's own page."""

    def initialize(self, timeline: Timeline, port: int) -> None:
        """Sets the timeline and the server's port."""
        self.timeline = timeline
        self._hosts = {f"{name}:{port}" for name in _NAMES}
        self._port = port

    def prepare(self) -> None:
        """Checks the headers first."""
        host, origin = self.request.headers.get("Host", ""), self.request.headers.get("Origin")
        if host not in self._hosts:
            self._refuse(f"Host {host!r} is not served; use {' or '.join(sorted(self._hosts))}")
        elif origin is not None and origin not in {f"http://{name}" for name in self._hosts}:
            self._refuse(f"Origin {origin!r} is not http://{host}")

    def _refuse(self, reason: str, status: int = 403) -> None:
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"refused: {reason}\n")

    def set_default_headers(self) -> None:
        """Headers of every answer: no caching, no type guessing, no referrer, no use by other sites."""
        self.clear_header("Server")
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")

    def write_error(self, status_code: int, **_: Any) -> None:
        """Sends one line of text instead of a traceback."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}\n")


class PageHandler(_Guard):
    """The page."""

    def get(self) -> None:
        """Sends the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        page = live_page()
        policy = _POLICY.format(script=script_hash(page), port=self._port)
        self.set_header("Content-Security-Policy", policy)
        self.finish(page)

    head = get


class CommandHandler(_Guard):
    """Commands of the page's buttons to the vehicles of the mission that it shows."""

    def initialize(self, timeline: Timeline, port: int, commands: CommandQueue | None = None, token: str = "") -> None:
        """Sets also the commands (None without --control) and the token."""
        super().initialize(timeline, port)
        self._commands, self._token = commands, token

    def prepare(self) -> None:
        """Checks the headers, then the token."""
        super().prepare()
        if self._finished:
            return
        given = self.request.headers.get(TOKEN_HEADER, "").encode()
        if self._commands is None:
            self._refuse("this live view sends no commands. Start it with auv_lse live --control")
        elif not hmac.compare_digest(given, self._token.encode()):
            self._refuse("wrong or missing token. Open the address that auv_lse live --control printed")

    async def post(self) -> None:
        """Handles {"mission": name of the timeline, "command": ..., "vehicles": [...]}; answers when all is known.

        The answer has the outcome and text of each vehicle, by its number.
        """
        assert self._commands is not None
        try:
            wanted = json.loads(self.request.body)
            mission, command, vehicles = wanted["mission"], wanted["command"], list(wanted["vehicles"])
        except (ValueError, TypeError, KeyError, RecursionError):
            self._refuse('send {"mission": text, "command": text, "vehicles": [number, ...]}', 400)
            return
        try:
            if mission != self.timeline.since("", 0, 0)[0]:
                raise CommandError("another mission has begun; nothing was sent. Try again")
            outcomes = await asyncio.shield(asyncio.wrap_future(self._commands.order(command, vehicles)))
        except CommandError as error:
            self._refuse(str(error), 409)
            return
        self.finish(json.dumps({k: {"outcome": outcome, "text": text} for k, (outcome, text) in outcomes.items()}))


class NotFoundHandler(_Guard):
    """Every other address."""

    def prepare(self) -> None:
        """Answers 404."""
        super().prepare()
        if not self._finished:
            self.send_error(404)


class EventsHandler(_Guard, tornado.websocket.WebSocketHandler):
    """The event stream of one page: the page names the events it has and receives those that follow."""

    _sending: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        """Whether the page may connect; `prepare` has checked it against the same list."""
        return origin in {f"http://{name}" for name in self._hosts}

    def get_compression_options(self) -> dict[str, Any] | None:
        """Disables compression, because the connection never leaves this machine."""
        return None

    def on_message(self, message: str | bytes) -> None:
        """Handles the page's first message, {"name": ..., "have": ...}; closes on anything else."""
        try:
            wanted = json.loads(message)
            name, have = str(wanted["name"]), int(wanted["have"])
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            self.close(1003, 'send {"name": text, "have": number}')
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
                reply = {"name": name, "from": first, "events": events, "more": len(events) == _BATCH, "state": now}
                try:
                    await self.write_message(json.dumps(reply, separators=(",", ":")))
                except tornado.websocket.WebSocketClosedError:
                    return
                have, state, quiet_s = first + len(events), now, 0.0
            if len(events) < _BATCH:
                await asyncio.sleep(_PERIOD_S)
                quiet_s += _PERIOD_S
