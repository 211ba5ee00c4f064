"""ROS domains of this machine: one for each mission, and environments that keep DDS on this machine."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

#: Domains whose UDP ports stay below Linux's ephemeral range.
DOMAINS = range(1, 102)
_MOST = 232
#: Variables with which a user sets the range of DDS.
RANGE_VARIABLES = (
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "CYCLONEDDS_URI",
)


class DomainError(RuntimeError):
    """No ROS domain is free, or an invalid domain."""


def lock_file(domain: int) -> Path:
    """The file that a mission locks while it uses `domain`."""
    return Path(tempfile.gettempdir()) / f"auv_lse_domain_{domain}.lock"


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no other mission on this machine uses, for as long as the context lasts.

    Raises:
        DomainError: if all are in use.
    """
    start = os.getpid() % len(DOMAINS)
    for offset in range(len(DOMAINS)):
        domain = DOMAINS[(start + offset) % len(DOMAINS)]
        with contextlib.ExitStack() as stack:
            if stack.enter_context(_locked(domain)):
                yield domain
                return
    raise DomainError(f"all ROS domains {DOMAINS[0]}..{DOMAINS[-1]} are in use by missions on this machine")


@contextlib.contextmanager
def taken_domain(domain: int) -> Iterator[int]:
    """Marks the ROS domain `domain` as in use for as long as the context lasts.

    Raises:
        DomainError: if another mission on this machine uses it.
    """
    with _locked(domain) as mine:
        if not mine:
            raise DomainError(f"ROS domain {domain}: another mission on this machine uses it; expected a free one")
        yield domain


@contextlib.contextmanager
def _locked(domain: int) -> Iterator[bool]:
    """Tries to lock a domain until the context ends; the value is whether that succeeded."""
    path = lock_file(domain)
    try:
        file = path.open("a")
    except PermissionError:  # another user's
        yield False
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
            return
        if not _is_still(path, file):  # the last owner has removed the file; another mission may have a new one
            yield False
            return
        try:
            yield True
        finally:
            path.unlink(missing_ok=True)


def _is_still(path: Path, file: IO[str]) -> bool:
    """Whether an open file is still the one at `path`."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def busy_domains() -> list[int]:
    """The domains that missions on this machine use now."""
    busy = []
    for domain in range(_MOST + 1):
        try:
            with lock_file(domain).open("r") as file:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except FileNotFoundError:
            continue
        except OSError:  # locked, or another user's
            busy.append(domain)
    return busy


def note_run(domain: int, run: Path) -> None:
    """Notes the run folder of the mission on `domain`, for other commands."""
    lock_file(domain).write_text(f"{run}\n")


def run_on(domain: int) -> Path | None:
    """The noted run folder of the mission on `domain`; None if there is none."""
    try:
        text = lock_file(domain).read_text().strip()
    except OSError:
        return None
    return Path(text) if text else None


def domain_number(text: str) -> int:
    """A ROS domain from text, as in ROS_DOMAIN_ID.

    Raises:
        DomainError: if it is invalid.
    """
    if not text.strip().isdecimal() or int(text) > _MOST:
        raise DomainError(
            f"ROS domain: got {text!r}; expected a whole number from 0 to {_MOST} (1 to 101 are safe on Linux)"
        )
    return int(text)


def wanted_domain(option: str | None) -> int:
    """The ROS domain of a command line, else of ROS_DOMAIN_ID, else 0.

    Raises:
        DomainError: if it is invalid.
    """
    return domain_number(option or os.environ.get("ROS_DOMAIN_ID") or "0")


def local_environment(root: Path, domain: int) -> dict[str, str]:
    """This process's environment, with DDS kept to this machine and to `domain`.

    Args:
        root: The project's folder, which holds config/.
        domain: ROS domain.
    """
    environment = node_environment(domain)
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
    environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(root / "config" / "fastdds_localhost.xml")
    return environment


def vehicle_environment(root: Path, domain: int) -> dict[str, str]:
    """This process's environment for a vehicle's nodes: DDS kept to this machine, unless a variable sets its range.

    Args:
        root: The project's folder, which holds config/.
        domain: ROS domain.
    """
    if any(os.environ.get(name) for name in RANGE_VARIABLES):
        return node_environment(domain)
    environment = local_environment(root, domain)
    if os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp") != "rmw_fastrtps_cpp":
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # the profile is for Fast DDS
    return environment


@contextlib.contextmanager
def temporary_environment(environment: Mapping[str, str]) -> Iterator[None]:
    """Sets this process's environment variables for as long as the context lasts; DDS reads them when it starts."""
    before = dict(os.environ)
    os.environ.update(environment)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def node_environment(domain: int | None = None) -> dict[str, str]:
    """This process's environment for a node whose output goes to a file.

    Args:
        domain: ROS domain; None: that of the environment.
    """
    environment = dict(os.environ)
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    environment["RCUTILS_COLORIZED_OUTPUT"] = "0"
    environment["PYTHONUNBUFFERED"] = "1"
    environment["OMP_NUM_THREADS"] = "1"
    environment["OPENBLAS_NUM_THREADS"] = "1"
    return environment
