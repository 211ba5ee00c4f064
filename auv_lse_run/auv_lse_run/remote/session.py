"""One session of a laptop with a vehicle: takes requests line by line, and answers each."""

import contextlib
import errno
import os
import select
import shutil
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.installed_copy import copy_of
from auv_lse_common.support.user_error import error_text
from auv_lse_run.process.domain import has_participants, vehicle_on
from auv_lse_run.remote import dive_process
from auv_lse_run.remote.facts import facts
from auv_lse_run.remote.mission_link import MissionLink
from auv_lse_run.remote.order_store import OrderStore
from auv_lse_run.remote.orders import ALWAYS, REFUSED, UNRECORDED, Answer, Order, OrderError
from auv_lse_run.remote.vehicle_folder import MAX_SENT, FolderError, VehicleFolder, blocks, sha256_of
from auv_lse_run.remote.wire import MAX_LINE, PROTOCOL, WireError, decoded, encoded

#: Time (s) without a request after which a session ends: its laptop is gone.
IDLE_S = 60.0
#: Longest wait (s) for another session that executes an order; an abort does not wait for it.
_WAIT_S, _ABORT_WAIT_S = 40.0, 2.0


class NodeActor:
    """Executes orders with the vehicle's own nodes."""

    def __init__(self, folder: Path, number: int, domain: int) -> None:
        """Opens nothing yet."""
        self._folder, self._name, self._number, self._domain = folder, f"auv{number}", number, domain
        self._link = MissionLink(self._name, domain)

    def act(self, order: Order) -> tuple[str, str]:
        """Starts or ends the nodes, or gives them the order."""
        if order.verb == "start":
            return dive_process.start(self._folder, self._name, self._domain)
        if order.verb == "stop":
            return dive_process.stop(self._name, self._domain)
        if not self._nodes_run():
            return REFUSED, "its nodes do not run; start them: auv_lse fleet FILE start"
        return self._link.give(order)

    def state(self) -> dict[str, Any]:
        """The newest messages of the nodes, if they run."""
        return self._link.state() if self._nodes_run() else {}

    def close(self) -> None:
        """Leaves the ROS domain."""
        self._link.close()

    def _nodes_run(self) -> bool:
        """Whether nodes run in the domain, also without `auv_lse vehicle`."""
        return vehicle_on(self._domain, self._number) is not None or has_participants(self._domain)


class Stream:
    """Lines and blocks of bytes over two descriptors, such as those of a pipe."""

    def __init__(self, read: int, write: int) -> None:
        self._read, self._write, self._left = read, write, bytearray()

    def line(self, wait_s: float) -> bytes:
        """The next line; b"" if none comes in time, or the other side has closed.

        Raises:
            WireError: if it is too long.
        """
        while (end := self._left.find(b"\n")) < 0:
            if len(self._left) > MAX_LINE:
                raise WireError("the other side sent a line without an end")
            if not self._more(wait_s):
                return b""
        return self._taken(end + 1)[:-1]

    def block(self, size: int, wait_s: float) -> bytes:
        """The next `size` bytes; fewer if no more come in time."""
        while len(self._left) < size and self._more(wait_s):
            pass
        return self._taken(size)

    def send(self, data: bytes) -> None:
        """Writes all bytes.

        Raises:
            OSError: if the other side has closed.
        """
        view = memoryview(data)
        while view:
            view = view[os.write(self._write, view) :]

    def _taken(self, size: int) -> bytes:
        found = bytes(self._left[:size])
        del self._left[:size]
        return found

    def _more(self, wait_s: float) -> bool:
        if not select.select([self._read], [], [], wait_s)[0]:
            return False
        found = os.read(self._read, 1 << 16)
        self._left += found
        return bool(found)


class Session:
    """Answers the requests of one session."""

    def __init__(self, folder: Path, number: int, domain: int, actor: NodeActor | None = None) -> None:
        """Sets up the session; its time counts from here.

        Args:
            actor: Executes orders; None: the vehicle's nodes do.
        """
        self._folder, self._number, self._domain = VehicleFolder(folder), number, domain
        self._orders = OrderStore(folder)
        self._actor = actor or NodeActor(folder, number, domain)
        self._began_s = time.monotonic()
        self._requests: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "clock": lambda _: {"clock_s": datetime.now(UTC).timestamp(), "steady_s": time.monotonic()},
            "facts": self._facts,
            "state": self._state,
            "order": self._order,
            "cancel": self._cancel,
            "take_over": self._take_over,
            "put": self._put,
            "install": self._install,
            "list": lambda _: {"files": self._folder.recordings(self._running())},
            "hash": lambda asked: {"sha256": sha256_of(self._folder.recording(asked["path"]))},
            "remove": self._remove,
            "excerpt": self._excerpt,
        }

    def serve(self, stream: Stream) -> None:
        """Answers requests until the laptop closes, or asks nothing for a minute.

        Raises:
            WireError: if the input is not of this protocol.
            OSError: if the laptop has closed while it is answered.
        """
        copy = copy_of("auv_lse_run")
        hello = {"hello": PROTOCOL, "vehicle": f"auv{self._number}", "version": "?" if copy is None else copy.version}
        try:
            stream.send(encoded(hello))
            while line := stream.line(IDLE_S):
                asked = decoded(line)
                if size := asked.get("bytes", 0):
                    asked["data"] = stream.block(_size(size), IDLE_S)
                if asked.get("ask") == "get":
                    self._get(asked, stream)
                else:
                    answer = self.answer(asked)
                    data = answer.pop("data", b"")
                    stream.send(encoded(answer | ({"bytes": len(data)} if data else {})) + data)
        finally:
            self._actor.close()

    def answer(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a request; an error is one, too."""
        request = self._requests.get(str(asked.get("ask")))
        if request is None:
            return {"error": f"The vehicle's software does not know the request {asked.get('ask')!r}. Update it."}
        try:
            return request(asked)
        except (OSError, OrderError, FolderError, ParameterError, RuntimeError) as error:  # rclpy's are RuntimeErrors
            return {"error": error_text(error)}
        except (KeyError, TypeError, AttributeError) as error:
            return {"error": f"The request {asked.get('ask')!r} is incomplete ({error})."}

    def _running(self) -> str:
        running = vehicle_on(self._domain, self._number)
        return "" if running is None else (running[0] or str(self._folder.folder))

    def _facts(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        found = facts(self._folder, self._number, self._domain, asked.get("thorough") is True)
        return found | {"controller": self._controller(), "state": self._actor.state() if found["running"] else {}}

    def _state(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        running = vehicle_on(self._domain, self._number)
        found = {"running": running is not None, "controller": self._controller(), "state": self._actor.state()}
        return found | {"free_mb": shutil.disk_usage(self._folder.folder).free / 1e6}

    def _controller(self) -> dict[str, str]:
        try:
            return self._orders.read().controller
        except (OSError, OrderError):
            return {}

    def _order(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        order = Order.read(asked)
        wait_s = _ABORT_WAIT_S if order.verb == "abort" else _WAIT_S
        try:
            with self._orders.opened(wait_s) as book:
                answer = book.take(order, time.monotonic() - self._began_s, _now())
                if answer is None:
                    self._orders.write(book)
                    answer = self._executed(order)
                    if answer.is_final:
                        book.note(order, answer)
                        with contextlib.suppress(OSError):  # repeated, it would be executed again, which is harmless
                            self._orders.write(book)
        except (OSError, OrderError) as error:
            if order.verb not in ALWAYS:
                is_full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
                text = f"It cannot be recorded, so it is not executed: {error_text(error)}."
                return asdict(Answer(UNRECORDED, text + " Free space on the vehicle." * is_full, _now()))
            answer = self._executed(order)
            answer = Answer(answer.outcome, f"{answer.text} (not recorded: {error_text(error)})", answer.at)
        return asdict(answer) | {"controller": self._controller()}

    def _executed(self, order: Order) -> Answer:
        try:
            outcome, text = self._actor.act(order)
        except Exception as error:  # whatever broke in it: an order is answered
            outcome, text = REFUSED, f"{type(error).__name__}: {error}"
        return Answer(outcome, text, _now())

    def _cancel(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        order = Order.read(asked)
        with self._orders.opened(_WAIT_S) as book:
            answer = book.cancel(order, _now())
            self._orders.write(book)
        return asdict(answer)

    def _take_over(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        order = Order.read({**asked, "number": 1, "verb": "hold"})
        with self._orders.opened(_WAIT_S) as book:
            before = book.controller
            book.take_over(order.laptop, order.name, _now())
            self._orders.write(book)
        return {"before": before}

    def _put(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        self._writable()
        self._folder.receive(asked["name"], asked["sha256"], asked.get("data", b""))
        return {"done": True}

    def _install(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        self._writable()
        if self._running():
            raise FolderError("A dive is running; its files are not replaced. End it first: auv_lse fleet FILE stop")
        self._folder.install(asked["files"], f"auv{self._number}")
        return {"hashes": self._folder.hashes(asked["files"])}

    def _writable(self) -> None:
        if problem := self._folder.problem():
            raise FolderError(problem)

    def _remove(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        path = self._folder.recording(asked["path"])
        if (running := self._running()) and path.is_relative_to(Path(running).resolve()):
            raise FolderError(f"{asked['path']} belongs to the dive that runs.")
        self._folder.remove(asked["path"], asked["sha256"])
        return {"done": True}

    def _excerpt(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The messages that a chart needs, compressed, from the running dive's recording after the laptop's cursor.

        If the dive has ended, all the rest of its recording.
        """
        from auv_lse_record.excerpt import Cursor, excerpt
        from auv_lse_record.recording import RecordingError

        cursor = Cursor.read(asked["cursor"])
        running = self._running()
        dive = Path(running) if running else self._folder.dive(cursor.dive)
        if dive is None:
            return {"cursor": {}, "more": False}
        try:
            data, cursor, more = excerpt(dive, cursor, dict(asked["topics"]))
        except RecordingError as error:
            raise FolderError(f"Its recording cannot be read: {error}") from error
        return {"cursor": cursor.values(), "more": more, "data": zlib.compress(data) if data else b""}

    def _get(self, asked: Mapping[str, Any], stream: Stream) -> None:
        """Sends a file from an offset on: a line with the number of bytes, then these."""
        try:
            path, offset = self._folder.recording(asked["path"]), int(asked["offset"])
            size = path.stat().st_size - offset
            if offset < 0 or size < 0:
                raise FolderError(f"{asked['path']} has no byte {offset}.")
            with path.open("rb") as file:
                file.seek(offset)
                stream.send(encoded({"bytes": size}))
                for block in blocks(file, size):
                    stream.send(block)
        except (FolderError, KeyError, TypeError, ValueError) as error:
            stream.send(encoded({"error": str(error)}))


def _size(value: Any) -> int:
    if type(value) is not int or not 0 < value <= MAX_SENT:
        raise WireError(f"{value!r} is not a number of bytes that can be sent")
    return value


def _now() -> str:
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"
