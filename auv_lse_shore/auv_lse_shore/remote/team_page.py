"""The page of `auv_lse fleet watch --page`: the team on one chart, on 127.0.0.1 only. It cannot command vehicles."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'"


@contextmanager
def team_page(picture: Callable[[], dict[str, Any]], port: int) -> Iterator[str]:
    """A context with a server of the page; the value is its address.

    Args:
        picture: What the page shows, as JSON can hold it: {"vehicles": [...], "lines": [...]}.
        port: Port on 127.0.0.1; 0: any.

    Raises:
        OSError: if the port is in use.
    """

    class Handler(BaseHTTPRequestHandler):
        """Answers the page and its data, to this computer's own name only: no other page may read them."""

        def do_GET(self) -> None:
            """Answers a request."""
            own = {f"{name}:{server.server_port}" for name in ("127.0.0.1", "localhost")}
            if self.headers.get("Host") not in own or self.path not in ("/", "/team.json"):
                self.send_error(404)
                return
            kind = "text/html" if self.path == "/" else "application/json"
            body = (_PAGE if self.path == "/" else json.dumps(picture())).encode()
            self.send_response(200)
            for name, value in (
                ("Content-Type", f"{kind}; charset=utf-8"),
                ("Content-Length", str(len(body))),
                ("Content-Security-Policy", _POLICY),
                ("Cache-Control", "no-store"),
                ("X-Frame-Options", "DENY"),
            ):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:
            """Logs nothing: the terminal has the table."""

    with ThreadingHTTPServer(("127.0.0.1", port), Handler) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Team</title><style>
body { font: 16px system-ui, sans-serif; margin: 1rem; background: #fff; color: #111; }
table { border-collapse: collapse; } td, th { padding: .2rem .8rem; text-align: left; }
#alarms { color: #b00020; font-weight: bold; white-space: pre-line; } #lost { background: #b00020; color: #fff; }
svg { width: 100%; height: 60vh; border: 1px solid #999; margin-top: 1rem; }
</style></head><body>
<p id="lost" hidden>auv_lse fleet watch does not answer: what is shown is old.</p>
<table><thead><tr><th>vehicle<th>state<th>depth<th>battery<th>age<th>link</tr></thead><tbody id="rows"></tbody></table>
<p id="alarms" role="alert"></p><button id="sound">sound on</button>
<svg id="chart" role="img" aria-label="Positions and plans of the team, north up"></svg>
<script>
"use strict";
const colors = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"], trails = {};
const byId = id => document.getElementById(id);
let audio = null, known = new Set();
byId("sound").onclick = () => { audio = audio || new AudioContext(); beep(); };
function beep() {
  if (!audio) return;
  const tone = audio.createOscillator(); tone.frequency.value = 880; tone.connect(audio.destination);
  tone.start(); tone.stop(audio.currentTime + 0.4);
}
function add(parent, name, attributes, text) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in attributes) node.setAttribute(key, attributes[key]);
  if (text !== undefined) node.textContent = text;
  parent.appendChild(node);
}
function draw(vehicles) {
  const chart = byId("chart"), width = chart.clientWidth, height = chart.clientHeight;
  const all = vehicles.flatMap(v => [...(v.position ? [v.position] : []), ...v.path, ...(trails[v.name] || [])]);
  chart.replaceChildren();
  if (!all.length) return;
  const range = k => [Math.min(...all.map(p => p[k])), Math.max(...all.map(p => p[k]))];
  const [south, north] = range(0), [west, east] = range(1);
  const scale = Math.min((height - 60) / Math.max(north - south, 20), (width - 60) / Math.max(east - west, 20));
  const x = p => width / 2 + (p[1] - (west + east) / 2) * scale;
  const y = p => height / 2 - (p[0] - (south + north) / 2) * scale;
  const line = (points, more) =>
    add(chart, "polyline", {points: points.map(p => `${x(p)},${y(p)}`).join(" "), fill: "none", ...more});
  vehicles.forEach((v, k) => {
    const color = colors[k % colors.length];
    line(trails[v.name] || [], {stroke: color, "stroke-width": 2});
    line(v.path, {stroke: color, "stroke-dasharray": "4 4"});
    if (!v.position) return;
    const fill = v.expected ? "none" : color, name = v.expected ? v.name + " expected" : v.name;
    add(chart, "circle", {cx: x(v.position), cy: y(v.position), r: 7, stroke: color, "stroke-width": 3, fill});
    add(chart, "text", {x: x(v.position) + 10, y: y(v.position) - 8, fill: color}, name);
  });
  const metres = 10 ** Math.floor(Math.log10(100 / scale));
  add(chart, "rect", {x: 20, y: height - 20, width: metres * scale, height: 4});
  add(chart, "text", {x: 20, y: height - 26}, metres + " m, north up");
}
async function step() {
  try {
    const team = await (await fetch("/team.json")).json(), rows = byId("rows");
    rows.replaceChildren();
    for (const v of team.vehicles) {
      const row = rows.insertRow();
      for (const cell of [v.name, ...v.cells]) row.insertCell().textContent = cell;
      if (v.position && !v.expected) (trails[v.name] = (trails[v.name] || []).slice(-3000)).push(v.position);
    }
    byId("alarms").textContent = team.lines.join("\\n");
    if (team.lines.some(text => !known.has(text))) beep();
    known = new Set(team.lines);
    byId("lost").hidden = true;
    draw(team.vehicles);
  } catch (error) { byId("lost").hidden = false; }
  setTimeout(step, 1000);
}
step();
</script></body></html>
"""
