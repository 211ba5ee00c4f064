"""A headless Chromium for the tests of a page, spoken to by its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
from PIL import Image
from tornado.websocket import WebSocketClientConnection, websocket_connect

from auv_lse_record.recording import recording_in
from auv_lse_record.run_writer import write_run
from auv_lse_shore.live.sources.follow import RecordingFollower
from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers.server import LiveServer

#: Latitude and longitude of the runs served.
ORIGIN = (46.5, -6.6)

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
_OPTIONS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
]


class Browser:
    """One tab; a context manager. Everything that the page reports as an error is kept in `errors`."""

    def __init__(self, folder: Path) -> None:
        """Starts nothing yet; the browser's profile goes to `folder`."""
        self._folder = folder
        self._count = 0
        self.errors: list[str] = []

    def __enter__(self) -> Browser:
        """Starts the browser with an empty tab."""
        command = [CHROMIUM, *_OPTIONS, f"--user-data-dir={self._folder}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            self._connect()
        except BaseException:
            self._end()
            raise
        return self

    def _connect(self) -> None:
        port_file, until = self._folder / "DevToolsActivePort", time.monotonic() + 30.0
        while not (port_file.is_file() and len(port_file.read_text().splitlines()) == 2):
            assert time.monotonic() < until, "Chromium has not opened its DevTools port in 30 s"
            time.sleep(0.05)
        port = int(port_file.read_text().splitlines()[0])
        with urlopen(Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT"), timeout=10) as answer:
            address = json.load(answer)["webSocketDebuggerUrl"]

        async def connected() -> WebSocketClientConnection:
            return await websocket_connect(address, max_message_size=1 << 28)

        self._loop = asyncio.new_event_loop()
        self._socket = self._loop.run_until_complete(connected())
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __exit__(self, *_: object) -> None:
        """Ends the browser."""
        self.call("Browser.close")
        self._loop.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)  # it removes its temporary folder
        self._end()

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(5)

    def call(self, method: str, **parameters: Any) -> Any:
        """Calls a method of the protocol and gives its result."""
        self._count += 1
        number = self._count

        async def answer() -> Any:
            await self._socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
            while True:
                text = await asyncio.wait_for(self._socket.read_message(), 30)
                assert text is not None, "the browser has gone"
                message = json.loads(text)
                self._note(message)
                if message.get("id") == number:
                    assert "error" not in message, message["error"]
                    return message["result"]

        return self._loop.run_until_complete(answer())

    def _note(self, message: dict[str, Any]) -> None:
        parameters = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif message.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])

    def open(self, url: str) -> None:
        """Goes to an address."""
        self.call("Page.navigate", url=url)

    def size(self, width: int, height: int, *, mobile: bool = False, scale: float = 1.0) -> None:
        """Sets the size of the window (CSS pixels)."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=mobile
        )

    def media(self, **features: str) -> None:
        """Sets media features, as prefers_color_scheme="dark"."""
        pairs = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.call("Emulation.setEmulatedMedia", features=pairs)

    def ask(self, expression: str) -> Any:
        """The value of a JavaScript expression (JSON)."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, expression: str, what: str = "", limit_s: float = 20.0, good: Callable[[Any], bool] = bool) -> Any:
        """Waits until an expression is true, and gives its value."""
        until = time.monotonic() + limit_s
        while not good(value := self.ask(expression)):
            assert time.monotonic() < until, f"{what or expression}: {value!r} after {limit_s} s; {self.errors}"
            time.sleep(0.05)
        return value

    def press(self, key: str, *, shift: bool = False) -> None:
        """Presses a key."""
        text: dict[str, Any] = {"text": key} if len(key) == 1 else {}
        # what the browser itself does with a key goes by its character or its number
        text |= {"Enter": {"text": "\r"}, "Escape": {"windowsVirtualKeyCode": 27}}.get(key, {})
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0, **text)

    def picture(self, path: Path) -> None:
        """Writes what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


class Serving:
    """A server on a thread of its own, as `auv_lse live` runs it; may be stopped and started again on its port."""

    def __init__(self, timeline, commands=None):
        self.timeline, self.commands, self.port = timeline, commands, 0
        self.start()

    def start(self):
        ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(ready)), daemon=True)
        self._thread.start()
        assert ready.wait(10)

    async def _serve(self, ready):
        server = LiveServer(self.timeline, self.port, self.commands)
        self.port, self.url = server.port, server.url
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        ready.set()
        await self._ended.wait()
        await server.close()

    def stop(self):
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(10)


def serving_of(run, folder, commands=None):
    """A server of the recording of a run, which gets an origin; it is read to its end."""
    run.parameters["/**"]["area"] |= {"origin_lat_deg": ORIGIN[0], "origin_lon_deg": ORIGIN[1]}
    write_run(run, folder)
    serving = Serving(Timeline(), commands)
    RecordingFollower(recording_in(folder), serving.timeline).follow(threading.Event())
    return serving


def at(browser, t):
    """Shows the moment `t` (s) and waits until it is drawn."""
    browser.ask(f"liveView.player.seek({t})")
    frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
    assert browser.ask(frames)


def text(browser, name):
    return browser.ask(f"document.getElementById('{name}').textContent")


def pixels(browser, name):
    """What a canvas shows, shape (rows, columns, 4)."""
    url = browser.ask(f"document.getElementById('{name}').toDataURL('image/png')")
    return np.asarray(Image.open(BytesIO(base64.b64decode(url.split(",", 1)[1]))).convert("RGBA")).astype(int)


def seen(browser, color):
    """The color (red, green, blue) in which the window shows a CSS color, through an emulated vision deficiency."""
    style = f"position:fixed;left:0;top:0;width:40px;height:40px;z-index:99;background:{color}"
    browser.ask(f"document.body.insertAdjacentHTML('beforeend', '<div id=swatch style=\\'{style}\\'></div>')")
    clip = {"x": 0, "y": 0, "width": 40, "height": 40, "scale": 1}
    data = browser.call("Page.captureScreenshot", format="png", clip=clip)["data"]
    browser.ask("document.getElementById('swatch').remove()")
    return np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)[20, 20]
