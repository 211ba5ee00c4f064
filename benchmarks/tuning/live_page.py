"""How fast the live page of a recording opens and moves in time, in a headless Chromium.

    python -m benchmarks.tuning.live_page RUN

Wall-clock times depend on other work of the machine, so processor times are printed beside them: of `scripts/live`, of
the whole browser, and of the page's own thread for a move.
"""

from __future__ import annotations

import os
import random
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command import end_with, parser_of

sys.path.append(str(Path(__file__).resolve().parents[2] / "auv_lse_shore" / "test"))
from browser import Browser  # the tests' own

#: Number of moves of each kind; seed of the positions of jumps; step (s) as by the key "right".
MOVES, SEED, STEP_S = 60, 1, 10.0
#: Wall clock (s) without another event after which the page has all.
QUIET_S = 5.0
#: Number of events on the page, maps unpacked; 0 until the pill says that it is a recording read to its end.
COUNT = """(() => {
  const { store } = window.liveView ?? {};
  if (!store?.facts) return [0, false];
  const all = [...store.lists.values()].reduce((sum, list) => sum + list.length, 0);
  return [all, document.getElementById("state").textContent === "recording" && store.packed === 0];
})()"""
#: Moves to a time; gives the milliseconds until the frame after the one that draws it.
MOVE = """void (window.moveTo = (t) => new Promise((done) => requestAnimationFrame(() => {
  const began = performance.now();
  liveView.player.seek(t);
  requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - began)));
})))"""


def processor_s(process: int) -> float:
    """Processor time (s) of a process and its descendants so far."""
    parents, used_s = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue  # it has ended
        number = int(folder.name)
        parents[number], used_s[number] = int(fields[1]), sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    family, size = {process}, 0
    while size < len(family):
        size = len(family)
        family |= {number for number, parent in parents.items() if parent in family}
    return sum(used_s.get(number, 0.0) for number in family)


def opened(browser: Browser, server: int, url: str, began_s: float) -> str:
    """Opens the page; describes when it had its first map and all events, since `began_s` (monotonic clock)."""
    processes = (server, browser._process.pid)
    before = [0.0 if began_s else processor_s(process) for process in processes]
    began_s = began_s or time.monotonic()
    browser.open(url)
    first_s, last_s, count, used = 0.0, time.monotonic(), 0, before
    while True:
        now, whole = browser.ask(COUNT)
        if now != count:
            count, last_s, used = now, time.monotonic(), [processor_s(process) for process in processes]
        if not first_s and browser.ask("!!window.liveView?.store.facts && liveView.store.list('map', 1).length > 0"):
            first_s = time.monotonic() - began_s
        if whole and time.monotonic() - last_s > QUIET_S:
            server_s, browser_s = (after - earlier for after, earlier in zip(used, before, strict=True))
            return (
                f"first map {first_s:.1f} s, all {count} events {last_s - began_s:.1f} s; "
                f"processor time: server {server_s:.1f} s, browser {browser_s:.1f} s"
            )
        time.sleep(0.1)


def moved(browser: Browser, times: Sequence[float]) -> str:
    """Moves to each of the times; describes how long that took."""

    def thread_ms() -> float:
        metrics = browser.call("Performance.getMetrics")["metrics"]
        return 1e3 * float(next(m["value"] for m in metrics if m["name"] == "TaskDuration"))

    wall_ms, used_ms = [], []
    for t in times:
        before = thread_ms()
        wall_ms.append(browser.ask(f"moveTo({t})"))
        used_ms.append(thread_ms() - before)
    return "; ".join(
        f"{name}: median {statistics.median(values):.0f} ms, longest {max(values):.0f} ms"
        for name, values in (("wall clock", wall_ms), ("processor time of the page's thread", used_ms))
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the figures. Returns the exit code."""
    p = parser_of("benchmarks.tuning.live_page", __doc__)
    p.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    run = p.parse_args(arguments).run
    began_s = time.monotonic()
    command = [sys.executable, "-m", "auv_lse_shore.live", str(run), "--port", "0", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            if found is None:
                return 2  # scripts/live has reported why
            url = found[0]
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Browser(Path(folder)) as browser:
                browser.call("Performance.enable", timeDomain="threadTicks")
                browser.size(1400, 900)
                print("opened at once, since scripts/live began:", opened(browser, server.pid, url, began_s))
                for _ in range(2):
                    browser.open("about:blank")
                    print("opened later:", opened(browser, server.pid, url, 0.0))
                browser.ask(MOVE)
                end_s, rng = browser.ask("liveView.store.lastS"), random.Random(SEED)
                print("jumps:", moved(browser, [rng.uniform(0.0, end_s) for _ in range(MOVES)]))
                for share in (0.5, 0.92):
                    at_s = [share * end_s + STEP_S * i for i in range(MOVES)]
                    print(f"steps of {STEP_S:g} s after {share:.0%}:", moved(browser, at_s))
        finally:
            server.terminate()
    print("load of the machine:", *(f"{load:.1f}" for load in os.getloadavg()))
    return 0


if __name__ == "__main__":
    end_with(main)
