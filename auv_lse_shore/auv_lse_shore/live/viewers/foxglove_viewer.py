"""A WebSocket server for Foxglove and Lichtblick on this machine, with the standard messages of a mission.

It is read-only: viewers cannot publish, set parameters or call services. The time bar of a recording moves the playback
of this server, nothing else. `origin_gate.py` refuses web pages that the user has not allowed.
"""

from __future__ import annotations

import sys
from collections.abc import Collection
from typing import Any

from auv_lse_shore.live.viewers.feed import Playback
from auv_lse_shore.live.viewers.map_panel import GEOJSON
from auv_lse_shore.live.viewers.origin_gate import OriginGate, hidden_address
from auv_lse_shore.live.viewers.server import ADDRESS
from auv_lse_shore.live.viewers.standard_messages import StandardMessage, StandardMessages

DEFAULT_PORT = 8765


class FoxgloveError(RuntimeError):
    """The server cannot be started."""


class FoxgloveViewer:
    """Serves the messages; the viewer's time bar plays, pauses and seeks a recording.

    Attributes:
        url: Address to open in the viewer.
    """

    def __init__(self, port: int, playback: Playback, origins: Collection[str] = ()) -> None:
        """Opens the port; the server starts with the first mission.

        Args:
            port: TCP port.
            playback: What the time bar moves.
            origins: Web pages that may connect, besides those of this machine: "https://app.foxglove.dev".

        Raises:
            FoxgloveError: if foxglove-sdk is not installed, or the port is taken.
        """
        try:
            import foxglove
        except ImportError:
            raise FoxgloveError(
                "--foxglove got no package foxglove-sdk; expected it to be installed. Run pip install foxglove-sdk "
                "(in .venv: .venv/bin/pip install -c config/constraints.txt foxglove-sdk)"
            ) from None
        try:
            self._gate = OriginGate(ADDRESS, port, origins, lambda text: print(f"Foxglove: {text}", file=sys.stderr))
        except OSError as error:
            raise FoxgloveError(
                f"--foxglove {port}: cannot listen on {ADDRESS}:{port}: {error.strerror or error}. Choose another "
                "port: --foxglove N"
            ) from error
        self._foxglove: Any = foxglove
        self._playback = playback
        self._server: Any = None
        self._channels: dict[str, Any] = {}
        self._last: dict[str, tuple[Any, int]] = {}
        self._messages: StandardMessages | None = None
        self.url = f"ws://{ADDRESS}:{self._gate.port}"

    def begin(self, messages: StandardMessages, first_s: float, last_s: float) -> None:
        """Starts or restarts the server; viewers then drop the previous mission.

        Raises:
            FoxgloveError: if it cannot be started.
        """
        self._stop()
        self._messages = messages
        self._context = self._foxglove.Context()
        address = hidden_address()
        given: dict[str, Any] = {}
        if last_s > first_s:
            given["playback_time_range"] = (round(first_s * 1e9), round(last_s * 1e9))
        try:
            self._server = self._foxglove.start_server(
                name="auv_lse",
                host=address,
                port=0,
                context=self._context,
                server_listener=_listener(self),
                **given,
            )
        except Exception as error:  # the SDK raises errors of its own
            raise FoxgloveError(f"--foxglove: the server cannot be started: {error}") from error
        self._gate.server = (address, self._server.port)

    def show(self, message: StandardMessage) -> None:
        """Sends a message to the topic's subscribers; later subscribers get the last message."""
        if self._messages is None:
            return
        if message.topic not in self._channels:
            self._channels[message.topic] = self._channel(message, self._messages)
        stamp_ns = round(message.stamp_s * 1e9)
        data = self._geojson(message.data) if message.kind == GEOJSON else message.data
        self._last[message.topic] = (data, stamp_ns)
        self._channels[message.topic].log(data, log_time=stamp_ns)

    def _channel(self, message: StandardMessage, messages: StandardMessages) -> Any:
        if message.kind == GEOJSON:
            from foxglove.channels import GeoJsonChannel

            return GeoJsonChannel(message.topic, context=self._context)
        definition = messages.definition(message.kind).encode()
        schema = self._foxglove.Schema(name=message.kind, encoding="ros2msg", data=definition)
        return self._foxglove.Channel(message.topic, schema=schema, message_encoding="cdr", context=self._context)

    def _geojson(self, text: bytes) -> Any:
        from foxglove.messages import GeoJson

        return GeoJson(geojson=text.decode())

    def repeat(self, topic: str) -> None:
        """Sends the last message of a topic again."""
        if topic in self._last and topic in self._channels:
            data, stamp_ns = self._last[topic]
            self._channels[topic].log(data, log_time=stamp_ns)

    def control(self, request: Any) -> Any:
        """Handles a request of the viewer's time bar; returns the new playback state."""
        from foxglove.websocket import PlaybackCommand, PlaybackState, PlaybackStatus

        playback = self._playback
        playback.playing = request.playback_command == PlaybackCommand.Play
        playback.rate = float(request.playback_speed) or playback.rate
        sought = request.seek_time is not None
        if sought:
            playback.seek(request.seek_time * 1e-9)
        return PlaybackState(
            status=PlaybackStatus.Playing if playback.playing else PlaybackStatus.Paused,
            current_time=request.seek_time if sought else round(playback.t * 1e9),
            playback_speed=playback.rate,
            did_seek=sought,
            request_id=request.request_id,
        )

    def close(self) -> None:
        """Closes the port and stops the server."""
        self._gate.close()
        self._stop()

    def _stop(self) -> None:
        if self._server is not None:
            self._server.stop()
            self._server = None
        self._channels.clear()
        self._last.clear()


def _listener(viewer: FoxgloveViewer) -> Any:
    """The object that the SDK calls from its own threads."""
    from foxglove.websocket import ServerListener

    class Listener(ServerListener):  # type: ignore[misc]  # the SDK's class is untyped without its stubs
        def on_subscribe(self, client: Any, channel: Any) -> None:
            viewer.repeat(channel.topic)

        def on_playback_control_request(self, playback_control_request: Any) -> Any:
            return viewer.control(playback_control_request)

    return Listener()
