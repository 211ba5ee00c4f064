"""The file of the laptop's ledger, beside the fleet file: locked while it changes, and kept before anything is sent."""

import contextlib
import fcntl
import getpass
import json
import os
import platform
import secrets
from collections.abc import Iterator
from pathlib import Path

from auv_lse_common.support.user_error import brief
from auv_lse_run.remote.order_store import write_durably
from auv_lse_shore.remote.ledger import Ledger, LedgerError


def laptop_name() -> str:
    """This laptop and its user, for people."""
    return f"{getpass.getuser()}@{platform.node()}"


class LedgerFile:
    """The ledger of a fleet file; several commands may use it at the same time."""

    def __init__(self, fleet_file: Path) -> None:
        """Reads nothing yet."""
        self.path = fleet_file.with_suffix(".orders.json")

    @contextlib.contextmanager
    def changed(self) -> Iterator[Ledger]:
        """A context with the ledger, whose changes are written at its end.

        Raises:
            OSError: if it cannot be written.
            LedgerError: if it is damaged.
        """
        lock = os.open(self.path.absolute().parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            ledger = self.read()
            before = ledger.values()
            yield ledger
            if ledger.values() != before or not self.path.exists():
                write_durably(self.path, json.dumps(ledger.values(), indent=1).encode())
        finally:
            os.close(lock)

    def read(self) -> Ledger:
        """Reads the ledger without a lock, to show it only.

        Raises:
            LedgerError: if it is damaged.
        """
        try:
            values = json.loads(self.path.read_bytes())
            return Ledger("", values)
        except FileNotFoundError:
            return Ledger(secrets.token_hex(8))
        except (ValueError, AttributeError) as error:
            what = str(error) if isinstance(error, LedgerError) else f"is damaged ({brief(error)})"
            raise LedgerError(
                f"{self.path} {what}. Move it away; what was pending is then unknown, and vehicles want --take-over."
            ) from error


class MemoryLedger:
    """A ledger that no file keeps: for an abort from a laptop whose disk is full. It has an id of its own."""

    def __init__(self) -> None:
        self._ledger = Ledger(secrets.token_hex(8))

    @contextlib.contextmanager
    def changed(self) -> Iterator[Ledger]:
        """A context with the ledger."""
        yield self._ledger


#: Where the ledger is kept.
Ledgers = LedgerFile | MemoryLedger
