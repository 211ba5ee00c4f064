"""A session with one vehicle: OpenSSH runs `auv_lse vehicle-side` there, and both talk over its standard streams.

ssh is called as a program, so keys, agents, jump hosts and `~/.ssh/config` work as people have them. Its multiplexing
is off: a master whose link hangs would take every later session with it.
"""

import contextlib
import os
import re
import shlex
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from auv_lse_run.remote.session import Stream
from auv_lse_run.remote.wire import PROTOCOL, WireError, decoded, encoded
from auv_lse_shore.remote.fleet_file import RemoteVehicle

#: Time (s) to connect, between signs of life, and number of missing ones after which a link is dead.
_CONNECT_S, _ALIVE_S, _ALIVE_COUNT = 10, 5, 3
#: Time (s) for the hello: a small computer imports Python packages for seconds.
_HELLO_S = 60.0
#: Lines before the hello: what a login shell prints.
_MAX_PREAMBLE = 200
_END_S = 2.0


class LinkError(RuntimeError):
    """The vehicle cannot be reached, or the link was lost. Repeating may help."""


class VehicleError(RuntimeError):
    """The vehicle answers, but a person must fix what is wrong. Its text ends with the cure."""


class RemoteSession:
    """A session with a vehicle, from its hello to its end."""

    def __init__(self, stream: Stream, errors: IO[bytes], vehicle: RemoteVehicle, process: Any) -> None:
        self._stream, self._errors, self._vehicle, self._process = stream, errors, vehicle, process
        self.version = ""

    def greet(self) -> None:
        """Waits for the vehicle's hello, over what its shell prints before.

        Raises:
            LinkError, VehicleError: if there is none.
        """
        for _ in range(_MAX_PREAMBLE):
            line = self._line(_HELLO_S)
            with contextlib.suppress(WireError):
                hello = decoded(line)
                if "hello" in hello:
                    self._check_hello(hello)
                    return
        raise VehicleError(f"auv_lse does not answer there, only text. Try: {self._vehicle.login} true")

    def ask(self, what: str, wait_s: float, data: bytes = b"", **values: Any) -> dict[str, Any]:
        """Asks, and returns the answer; bytes that follow it are its value "data".

        Args:
            wait_s: Longest time without a byte of the answer.
            data: Bytes that follow the request.
            **values: Its values.

        Raises:
            LinkError: if the link is lost.
            VehicleError: if the answer is an error.
        """
        self._send(encoded({"ask": what, **values} | ({"bytes": len(data)} if data else {})) + data)
        answer = self._message(wait_s)
        if "error" in answer:
            raise VehicleError(str(answer["error"]))
        if size := int(answer.get("bytes", 0)):
            answer["data"] = self._stream.block(size, wait_s)
            if len(answer["data"]) < size:
                raise LinkError(self._why())
        return answer

    def bytes_of(self, path: str, offset: int, wait_s: float) -> Iterator[bytes]:
        """The bytes of a recording from an offset on, in blocks.

        Raises:
            LinkError, VehicleError: as `ask`; blocks before are good.
        """
        self._send(encoded({"ask": "get", "path": path, "offset": offset}))
        answer = self._message(wait_s)
        if "error" in answer:
            raise VehicleError(str(answer["error"]))
        left = int(answer.get("bytes", 0))
        while left:
            block = self._stream.block(min(left, 1 << 18), wait_s)
            if not block:
                raise LinkError(self._why())
            left -= len(block)
            yield block

    def _check_hello(self, hello: Mapping[str, Any]) -> None:
        self.version = str(hello.get("version", "?"))
        if hello["hello"] != PROTOCOL:
            raise VehicleError(
                f"auv_lse {self.version} there does not fit the laptop's. Install one version on both (scripts/setup)."
            )

    def _send(self, data: bytes) -> None:
        try:
            self._stream.send(data)
        except OSError as error:
            raise LinkError(self._why()) from error

    def _message(self, wait_s: float) -> dict[str, Any]:
        try:
            return decoded(self._line(wait_s))
        except WireError as error:
            raise LinkError(str(error)) from error

    def _line(self, wait_s: float) -> bytes:
        line = self._stream.line(wait_s)
        if not line:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_S)
            code = self._process.poll()
            if code is None:
                raise LinkError(f"no answer within {wait_s:g} s")
            raise failure(self._vehicle, code, _text(self._errors))
        return line

    def _why(self) -> str:
        """The last words of ssh."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        lines = _text(self._errors).strip().splitlines()
        return lines[-1] if lines else "the link was lost"


def ssh_command(vehicle: RemoteVehicle, ssh_config: Path | None) -> list[str]:
    """The command line that runs the vehicle's side over SSH."""
    remote = (
        f"{vehicle.command} vehicle-side {vehicle.name} --domain {vehicle.domain} --folder {_quoted(vehicle.folder)}"
    )
    options = {
        "BatchMode": "yes",
        "ConnectTimeout": _CONNECT_S,
        "ServerAliveInterval": _ALIVE_S,
        "ServerAliveCountMax": _ALIVE_COUNT,
        "ControlMaster": "no",
        "ControlPath": "none",
        "RemoteCommand": "none",
    }
    return [
        "ssh",
        "-T",
        *(("-F", str(ssh_config)) if ssh_config else ()),
        *(word for name, value in options.items() for word in ("-o", f"{name}={value}")),
        *(("-p", str(vehicle.port)) if vehicle.port else ()),
        "--",
        vehicle.address,
        remote,
    ]


@contextlib.contextmanager
def session(vehicle: RemoteVehicle, ssh_config: Path | None = None) -> Iterator[RemoteSession]:
    """A context with a session; ssh ends with it.

    Args:
        ssh_config: SSH's configuration; None: its default.

    Raises:
        LinkError: if the vehicle cannot be reached.
        VehicleError: if something there needs a person.
    """
    with tempfile.TemporaryFile() as errors:
        try:
            process = subprocess.Popen(
                ssh_command(vehicle, ssh_config),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                start_new_session=True,  # Ctrl-C ends this command, which then ends ssh
            )
        except FileNotFoundError as error:
            raise VehicleError(
                "The program ssh is missing on this laptop. Install it: sudo apt install openssh-client"
            ) from error
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            stream = Stream(process.stdout.fileno(), process.stdin.fileno())
            found = RemoteSession(stream, errors, vehicle, process)
            found.greet()
            yield found
        finally:
            with contextlib.suppress(OSError):
                process.stdin.close()
            _end(process)
            process.stdout.close()


def _end(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(0.3)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


#: Causes by the output of ssh, or of the shell on the vehicle; whether repeating may help; and the cure.
_CAUSES: tuple[tuple[str, bool, str], ...] = (
    (
        r"REMOTE HOST IDENTIFICATION HAS CHANGED",
        False,
        "It shows another host key than before. If its computer was reinstalled: ssh-keygen -R {known}, then {login}. "
        "If not, another computer has its address.",
    ),
    (
        r"Host key verification failed|No .* host key is known",
        False,
        "Its host key is not known on this laptop. Log in once and compare the key: {login}",
    ),
    (
        r"Permission denied \(|Too many authentication failures",
        False,
        "It refuses this laptop's key. Copy the key there: ssh-copy-id{port} {address}",
    ),
    (r"has no verb vehicle-side", False, "An old version of auv_lse is there. Install the laptop's (scripts/setup)."),
    (r"needs the package auv_lse_run|No module named", False, "auv_lse there is incomplete. Run scripts/setup there."),
    (
        r"command not found|: not found|No such file or directory|No such container|is not running",
        False,
        "auv_lse is not found there by a login without a terminal. Set 'command' of {name} in the fleet file.",
    ),
    (r"Could not resolve hostname", True, "Its name {host} is not found. Is the Wi-Fi up? Else write its address."),
    (r"Connection refused", True, "Its computer answers, but SSH does not run there (yet): sudo systemctl start ssh"),
    (r"timed out|No route to host|unreachable|not responding", True, "It is out of reach or off."),
    (r"Connection (closed|reset)|Broken pipe|kex_exchange", True, "The link was lost."),
)


def failure(vehicle: RemoteVehicle, code: int, errors: str) -> LinkError | VehicleError:
    """Why a session did not come about, in words that end with the cure."""
    known = f"'[{vehicle.host}]:{vehicle.port}'" if vehicle.port not in (0, 22) else vehicle.host
    for pattern, may_help, text in _CAUSES:
        if re.search(pattern, errors):
            port = f" -p {vehicle.port}" if vehicle.port else ""
            filled = text.format(
                known=known,
                login=vehicle.login,
                port=port,
                address=vehicle.address,
                name=vehicle.name,
                host=vehicle.host,
            )
            return (LinkError if may_help else VehicleError)(filled)
    lines = errors.strip().splitlines()
    if code in (0, 255) or not lines:
        return LinkError(lines[-1] if lines else "The link was lost.")
    return VehicleError(
        f"{lines[-1]} (exit code {code}). Try: {vehicle.login} {shlex.quote(vehicle.command)} --version"
    )


def _quoted(folder: str) -> str:
    """A folder for the shell on the vehicle, which still expands a leading ~."""
    if folder.startswith("~/"):
        return "~/" + shlex.quote(folder[2:])
    return shlex.quote(folder)


def _text(file: IO[bytes]) -> str:
    # a descriptor of its own position: ssh still writes at its own
    size = os.fstat(file.fileno()).st_size
    return os.pread(file.fileno(), size, 0).decode(errors="replace")
