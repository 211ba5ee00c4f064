"""The live view's server on a thread, and what a browser shows of its page."""

from __future__ import annotations

import asyncio
import base64
import threading
from io import BytesIO

import numpy as np
from PIL import Image

from auv_lse_shore.live.viewers.server import LiveServer


class Serving:
    """A server on a thread of its own, as `scripts/live` runs it; may be stopped and started again on its port."""

    def __init__(self, timeline, desk=None):
        self.timeline, self.desk, self.port = timeline, desk, 0
        self.start()

    def start(self):
        ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(ready)), daemon=True)
        self._thread.start()
        assert ready.wait(10)

    async def _serve(self, ready):
        server = LiveServer(self.timeline, self.port, self.desk)
        self.port, self.url = server.port, server.url
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        ready.set()
        await self._ended.wait()
        await server.close()

    def stop(self):
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(10)


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
