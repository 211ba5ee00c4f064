"""The live view as a process beside a mission."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping

from auv_lse_run.process.processes import die_with_parent
from auv_lse_shore.live.viewers.server import DEFAULT_PORT, port_or_any


class LiveProcess:
    """Runs `auv_lse live` on a mission's domain while the context is open; the page keeps the events it has."""

    def __init__(self, domain: int, environment: Mapping[str, str], report: Callable[[str], None]) -> None:
        """Prepares the command.

        Args:
            report: Shows a line: the page's address, or the reason why there is no page.
        """
        port = port_or_any(DEFAULT_PORT)  # another mission's page may use it
        self._command = [sys.executable, "-m", "auv_lse_run", "live", "--domain", str(domain), "--port", str(port)]
        self._environment = dict(environment)
        self._report = report

    def __enter__(self) -> LiveProcess:
        """Starts the process."""
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self._environment,
            preexec_fn=die_with_parent,
            start_new_session=True,  # Ctrl-C goes to the mission, which then stops this process
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stops the process."""
        for number, patience_s in ((signal.SIGINT, 5.0), (signal.SIGKILL, 5.0)):
            if self._process.poll() is None:
                self._process.send_signal(number)
                try:
                    self._process.wait(patience_s)
                except subprocess.TimeoutExpired:
                    continue
        self._reader.join(1.0)

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self._report(line.removesuffix("\n").removesuffix("   (stop with Ctrl-C)"))
