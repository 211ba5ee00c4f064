"""Real sshd processes on 127.0.0.1, with keys made for the occasion: the computers of vehicles."""

import contextlib
import getpass
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml

from auv_lse_common.support.atomic_files import write_whole

ROOT = Path(__file__).resolve().parents[2]
_SSHD = shutil.which("sshd") or shutil.which("/usr/sbin/sshd")
_CONFIG = """\
ListenAddress {address}
Port {port}
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/authorized_keys
PidFile none
StrictModes no
UsePAM no
PasswordAuthentication no
KbdInteractiveAuthentication no
MaxStartups 100
MaxSessions 100
"""
#: Domains of vehicles whose files give none: no test or mission on this machine uses them.
_FIRST_DOMAIN = 225


class FieldError(RuntimeError):
    """The field day cannot be set up here."""


def lacks_sshd() -> str:
    """Why no sshd can run here; "" if one can."""
    if _SSHD is None or shutil.which("ssh") is None:
        return "needs sshd and ssh (apt-get install openssh-server)"
    return ""


def free_port() -> int:
    """A TCP port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def side_command(side: str = "auv_lse_run") -> str:
    """The shell text that runs the vehicle's side from this checkout, as a fleet file's `command`.

    Args:
        side: The module that takes the arguments of auv_lse.
    """
    paths = [str(ROOT), *(str(path.parent) for path in sorted(ROOT.glob("auv_lse_*/package.xml")))]
    given = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    keep = {
        k: v for k, v in os.environ.items() if k in ("LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "AUV_LSE_ROOT", "HOME")
    }
    variables = {**keep, "PYTHONPATH": os.pathsep.join(dict.fromkeys([*given, *paths]))}
    return " ".join(["env", *(f"'{k}={v}'" for k, v in variables.items()), sys.executable, "-m", side])


class Computer:
    """The computer of one vehicle."""

    def __init__(self, port: int, folder: Path, command: list[str], log: Path) -> None:
        """Starts nothing yet.

        Args:
            port: Port of its sshd.
            command: What runs its sshd.
            log: What that prints.
        """
        self.port, self.folder, self._command, self._log = port, folder, command, log
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> subprocess.Popen[bytes]:
        """Starts its sshd, as booting does."""
        with self._log.open("a") as log:
            self._process = subprocess.Popen(self._command, stderr=log, stdin=subprocess.DEVNULL)
        return self._process

    def stop(self) -> None:
        """Ends its sshd; sessions go on."""
        assert self._process is not None
        self._process.terminate()
        self._process.wait()


class Field:
    """A laptop and the computers of vehicles.

    Attributes:
        folder: Everything is below it.
        ssh_config: The laptop's SSH configuration.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._key = folder / "id"
        _keygen(self._key)
        self.ssh_config = folder / "ssh_config"
        self.known_hosts = folder / "known_hosts"
        self._places: dict[str, str] = {}
        self._config = (
            f"Host *\n    IdentityFile {self._key}\n    IdentitiesOnly yes\n    UserKnownHostsFile {self.known_hosts}\n"
            "    StrictHostKeyChecking yes\n    LogLevel ERROR\n"
        )
        self.ssh_config.write_text(self._config)
        self.known_hosts.touch()

    @contextlib.contextmanager
    def computer(self, name: str, address: str = "127.0.0.1", prefix: tuple[str, ...] = ()) -> Iterator[Computer]:
        """A context with a vehicle's computer, whose host key the laptop does not know yet (`trust`).

        Args:
            name: "auv1".
            address: Where its sshd listens.
            prefix: Words before the command, such as those that enter a network namespace.
        """
        folder = self.folder / f"{name}.computer"
        folder.mkdir()
        _keygen(folder / "host_key")
        shutil.copy(f"{self._key}.pub", folder / "authorized_keys")
        port = free_port()
        (folder / "sshd_config").write_text(_CONFIG.format(address=address, port=port, folder=folder))
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)
        assert _SSHD is not None
        own = self.folder / name
        own.mkdir(exist_ok=True)
        command = [*prefix, _SSHD, "-D", "-e", "-f", str(folder / "sshd_config")]
        computer = Computer(port, own, command, folder / "sshd.log")
        process = computer.start()
        try:
            if not prefix:
                _wait_for(address, port, process)
            yield computer
        finally:
            computer.stop()

    def place(self, name: str, address: str) -> None:
        """Makes the laptop find a computer by its name at an address, as a name server does, and know its host key."""
        self._places[name] = address
        hosts = "".join(f"Host {k}\n    HostName {v}\n    HostKeyAlias {k}\n" for k, v in self._places.items())
        write_whole(self.ssh_config, hosts + self._config)
        key = (self.folder / f"{name}.computer" / "host_key.pub").read_text()
        if key not in self.known_hosts.read_text():
            with self.known_hosts.open("a") as file:
                file.write(f"{name} {key}")

    def trust(self, name: str, port: int) -> None:
        """Makes the laptop know a computer's host key at a port of this machine, as after a first login."""
        key = (self.folder / f"{name}.computer" / "host_key.pub").read_text()
        with self.known_hosts.open("a") as file:
            file.write(f"[127.0.0.1]:{port} {key}")

    def fleet_file(self, vehicles: Mapping[str, Mapping[str, object]], name: str = "fleet.yaml") -> Path:
        """Writes a fleet file; values replace those of a vehicle's own computer.

        Args:
            vehicles: Keys of each vehicle (port, folder, command, ...) by name.
        """
        path = self.folder / name
        entries = {
            vehicle: {"host": "127.0.0.1", "user": getpass.getuser(), "command": side_command(), "domain": k, **values}
            for k, (vehicle, values) in enumerate(vehicles.items(), _FIRST_DOMAIN)
        }
        path.write_text(yaml.safe_dump({"ssh_config": str(self.ssh_config), "vehicles": entries}, width=10_000))
        return path


def _keygen(path: Path) -> None:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(path)], check=True)


def _wait_for(address: str, port: int, process: subprocess.Popen[bytes]) -> None:
    end_s = time.monotonic() + 10.0
    while time.monotonic() < end_s and process.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection((address, port), 1.0):
            return
        time.sleep(0.02)
    raise FieldError(f"sshd does not listen on port {port}")
