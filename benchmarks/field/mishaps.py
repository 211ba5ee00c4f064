"""Mishaps of a field day over Wi-Fi: outages, new addresses, reboots, laptops that die during a command."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

from auv_lse_shore.remote.watching import Watch
from benchmarks.field.namespace import Namespace, Radio
from benchmarks.field.side import STATE
from benchmarks.field.sshd import Computer, Field

#: Time (s) between two mishaps, and that a computer needs to boot.
_EVERY_S, _BOOT_S = 20.0, 3.0
KINDS = ("outage", "address", "reboot")


class _BackgroundWork:
    """Work in a thread of its own, beside a block of code: a context, at whose end the last piece of work is over."""

    def __init__(self, work: Callable[[], None]) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=work, daemon=True)

    def __enter__(self) -> Self:
        """Begins."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Ends."""
        self._over.set()
        self._thread.join()


class Mishaps(_BackgroundWork):
    """Makes mishaps happen to one vehicle after another.

    Attributes:
        counts: Mishaps by kind.
    """

    def __init__(
        self, field: Field, radio: Radio, there: Sequence[tuple[Namespace, Computer]], outage_s: float, seed: int
    ) -> None:
        """Sets up the mishaps; the context starts them.

        Args:
            there: Namespace and computer of auv1, auv2, ...
            outage_s: Length of an outage (s).
            seed: Chooses vehicles and moments.
        """
        self._field, self._radio, self._there, self._outage_s = field, radio, there, outage_s
        super().__init__(self._happen)
        self._chance = random.Random(seed)
        self.counts: Counter[str] = Counter()

    def _happen(self) -> None:
        turn = 0
        while not self._over.wait(self._chance.uniform(0.5, 1.5) * _EVERY_S):
            self.one(KINDS[turn % len(KINDS)], self._chance.randrange(len(self._there)))
            turn += 1

    def one(self, kind: str, k: int) -> None:
        """Makes one mishap happen to the k-th vehicle; returns when it is over. It leaves connections half open."""
        own, computer = self._there[k]
        if kind == "outage":
            self._radio.set(k, up=False)
            time.sleep(self._outage_s)
            self._radio.set(k, up=True)
        elif kind == "address":
            own.move()
            self._field.place(f"auv{k + 1}", own.address)
        else:
            own.kill_all()
            time.sleep(_BOOT_S)
            computer.start()
        self.counts[kind] += 1


def killed_laptop(file: Path, words: Sequence[str], after_s: float) -> None:
    """Runs `auv_lse fleet` and kills it after a while, as a laptop whose battery is empty."""
    command = [sys.executable, "-m", "auv_lse_run", "fleet", str(file), *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
                               start_new_session=True)  # fmt: skip
    time.sleep(after_s)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()


class AgeCheck(_BackgroundWork):
    """Compares the age that `watch` shows of each vehicle's state with its true age, twice a second.

    Attributes:
        margins_s: Shown age less true age (s), of each comparison. None may be negative.
    """

    def __init__(self, watch: Watch, computers: Sequence[Computer]) -> None:
        """Compares nothing yet; `watch` must be running."""
        super().__init__(self._compare)
        self._watch, self._computers = watch, computers
        self.margins_s: list[float] = []

    def _compare(self) -> None:
        while not self._over.wait(0.5):
            for view in self._watch.views.values():
                stamp_s, now_s = view.part("mission").get("stamp_s"), time.monotonic()
                shown_s = view.age_s("mission", now_s)
                if stamp_s is not None and shown_s is not None:
                    self.margins_s.append(shown_s - (now_s - float(stamp_s)))
            for computer in self._computers:
                write_state(computer)


def write_state(computer: Computer) -> None:
    """Makes a vehicle's nodes report a state that is new now."""
    stamped = {"stamp_s": time.monotonic()}
    state = {
        "mission": {"state": "RUNNING", "reason": "", "limits": [], "warnings": [], **stamped},
        "position": {"north_m": 1.0, "east_m": 2.0, "depth_m": 0.1, "speed_mps": 1.0, **stamped},
        "autopilot": {"heard": True, "armed": True, "battery": 0.9, **stamped},
        "path": None,
        "health": [],
    }
    part = computer.folder / f"{STATE}.part"
    part.write_text(json.dumps(state))
    part.replace(computer.folder / STATE)
