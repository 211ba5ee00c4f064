"""ROS domains of this machine, reserved for missions and vehicles, and the environment of their nodes.

An entry point locks a file for its domain; the lock ends with the process. Commands that watch a mission join its
domain without a lock.
"""

import contextlib
import errno
import fcntl
import hashlib
import os
import pwd
import re
import socket
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO

from auv_lse_common.node.dive import SIMULATION, new_dive
from auv_lse_common.support.confinement import confine, confined, is_confined
from auv_lse_common.support.installed_copy import COPY_VARIABLE, own_copy

#: Domains of simulations and replays, and those recommended for vehicles: 80 plus the vehicle's number. The UDP ports
#: of both stay below Linux's ephemeral range. Vehicles may use any other domain, too, also ROS's default 0.
SIMULATOR_DOMAINS = range(1, 81)
VEHICLE_DOMAINS = range(81, 102)
_MOST = 232
#: UDP ports of RTPS (DDSI-RTPS 9.6.1): the first one, that of the next domain, that of its first and next participant.
_FIRST_PORT, _DOMAIN_GAIN, _PARTICIPANT, _PARTICIPANT_GAIN = 7400, 250, 10, 2
_PARTICIPANTS = 40
#: How long (s) this computer may take to reach itself.
_LOOPBACK_S = 2.0
#: Environment of a process whose linear algebra runs on one thread: a mission is many processes on few cores.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class DomainError(RuntimeError):
    """No ROS domain is free, or an invalid domain."""


def lock_file(domain: int, vehicle: int = 0) -> Path:
    """The file that is locked while `domain` is in use.

    Args:
        vehicle: Number of the vehicle whose nodes use it: vehicles may share a domain; 0: a simulation or a replay.
    """
    of_vehicle = f"_auv{vehicle}" if vehicle else ""
    try:
        folder = tempfile.gettempdir()
    except FileNotFoundError:  # the disk is full
        folder = "/tmp"
    return Path(folder) / f"auv_lse_domain_{domain}{of_vehicle}.lock"


@contextlib.contextmanager
def own_domain(domains: Sequence[int] = SIMULATOR_DOMAINS) -> Iterator[int]:
    """A ROS domain that nothing else on this machine uses, for as long as the context lasts.

    Args:
        domains: The domains to choose from.

    Raises:
        DomainError: if all are in use.
    """
    start = os.getpid() % len(domains)
    for offset in range(len(domains)):
        domain = domains[(start + offset) % len(domains)]
        with contextlib.ExitStack() as stack:
            if stack.enter_context(_locked(lock_file(domain))) and not has_participants(domain):
                yield domain
                return
    raise DomainError(f"all ROS domains {domains[0]}..{domains[-1]} are in use on this machine")


@contextlib.contextmanager
def simulation_domain(wanted: str | None, run: Path, vehicles: int = 0) -> Iterator[int]:
    """The ROS domain of a simulation, reserved for as long as the context lasts, with a note of its folder and new id.

    Args:
        wanted: As `simulator_domain` takes it.
        vehicles: Number of vehicles whose nodes the simulation runs itself: a second `auv1` is refused.

    Raises:
        DomainError: as `simulator_domain`.
    """
    with simulator_domain(wanted) as domain, contextlib.ExitStack() as taken:
        dive = new_dive(SIMULATION)
        note_run(domain, run, dive)
        for vehicle in range(1, vehicles + 1):
            taken.enter_context(_locked(lock_file(domain, vehicle)))
            note_run(domain, run, dive, vehicle)
        yield domain


@contextlib.contextmanager
def simulator_domain(wanted: str | None) -> Iterator[int]:
    """The ROS domain of a simulation or a replay, reserved for as long as the context lasts.

    Args:
        wanted: The domain; None: a free one.

    Raises:
        DomainError: if it is invalid, a vehicle's, or in use, or if this computer cannot reach itself.
    """
    if problem := loopback_problem():
        raise DomainError(problem)
    if wanted is None:
        with own_domain() as domain:
            yield domain
        return
    domain = domain_number(wanted)
    if domain not in SIMULATOR_DOMAINS:
        raise DomainError(
            f"ROS domain {domain} is for vehicles; a simulation or a replay uses {_shown(SIMULATOR_DOMAINS)}. "
            "Leave it out to use a free one"
        )
    with _locked(lock_file(domain)) as mine:
        if not mine:
            _refuse_left_over(lock_file(domain))
            raise DomainError(f"ROS domain {domain} is in use by {user_of(domain)}. {_CHOOSE}")
        if has_participants(domain):
            raise DomainError(
                f"ROS domain {domain} has other nodes of this machine. End them (list them with: auv_lse nodes "
                f"list --domain {domain}). {_CHOOSE}"
            )
        yield domain


_CHOOSE = "Leave the domain out to use a free one"


@contextlib.contextmanager
def vehicle_domain(domain: int, vehicle: int, simulated: bool) -> Iterator[int]:
    """The ROS domain of a vehicle's nodes, reserved for as long as the context lasts.

    Several vehicles may share a domain, but not two with one number. A simulated vehicle joins its simulator.

    Args:
        simulated: Whether the nodes follow a simulator.

    Raises:
        DomainError: if the domain is a simulator's and the vehicle is not, or the other way round, or if another
            vehicle of that number uses it.
    """
    if domain in SIMULATOR_DOMAINS and not simulated:
        raise DomainError(
            f"ROS domain {domain} is for simulations, as all of {_shown(SIMULATOR_DOMAINS)}; a vehicle uses "
            f"{_shown(VEHICLE_DOMAINS)} or 0. {_free(vehicle)}"
        )
    if simulated and dive_on(domain) is None:
        raise DomainError(
            f"ROS domain {domain} has no simulator of this machine. Start auv_lse sim first, and use the "
            "commands that it prints"
        )
    with _locked(lock_file(domain, vehicle)) as mine:
        if not mine:
            _refuse_left_over(lock_file(domain, vehicle))
            raise DomainError(
                f"ROS domain {domain} already has the nodes of auv{vehicle} ({user_of(domain, vehicle)}). End "
                "them, or use another domain"
            )
        yield domain


def _free(vehicle: int) -> str:
    """Which domain a vehicle may use on this machine, if possible 80 plus its number."""
    wanted = VEHICLE_DOMAINS[0] - 1 + vehicle
    choice = (wanted, *VEHICLE_DOMAINS) if wanted in VEHICLE_DOMAINS else VEHICLE_DOMAINS
    free = [domain for domain in choice if not has_participants(domain)]
    return f"{free[0]} is free: --domain {free[0]}" if free else "None of them is free now"


def _shown(domains: range) -> str:
    return f"{domains[0]} to {domains[-1]}"


def user_of(domain: int, vehicle: int = 0) -> str:
    """What uses a domain, as far as it is noted: its dive and its folder."""
    run, dive = _notes(domain, vehicle)
    if not dive and not vehicle:  # vehicles without a simulation
        name = lock_file(domain, 1).name.replace("_auv1.", "_auv*.")
        held = filter(_is_held, sorted(lock_file(domain).parent.glob(name)))
        found = (re.search(r"_auv(\d+)\.lock$", path.name) for path in held)
        if users := [user_of(domain, int(match[1])) for match in found if match is not None]:
            return ", ".join(users)
    return " ".join(filter(None, (dive, f"in {run}" if run else ""))) or "another mission"


def check_own(domain: int) -> None:
    """Checks that commands to a domain that the user did not name reach no simulation of another user.

    Vehicles' domains pass: on a vehicle's computer, a service may fly and an operator command.

    Raises:
        DomainError: naming the user and the simulation.
    """
    if owner := _other_owner(lock_file(domain)):
        raise DomainError(
            f"The only mission on this machine is {user_of(domain)}, started by {owner} (ROS domain {domain}). To "
            f"command it: --domain {domain}"
        )


def _other_owner(path: Path) -> str:
    """The user who owns a file; "" if this one does, or there is none."""
    try:
        uid = path.stat().st_uid
    except OSError:
        return ""
    if uid == os.geteuid():
        return ""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"user {uid}"


def _refuse_left_over(path: Path) -> None:
    """Raises DomainError for a lock file that a killed process left and this user can neither lock nor remove."""
    if (owner := _other_owner(path)) and not _is_held(path):
        raise DomainError(f"{path} is left over from a process of {owner} that has ended. Remove it: sudo rm {path}")


def has_participants(domain: int) -> bool:
    """Whether nodes use `domain` on this machine, even unreserved: whether one of its UDP ports is in use."""
    first = _FIRST_PORT + _DOMAIN_GAIN * domain
    return any(
        _is_bound(port)
        for port in (first, *(first + _PARTICIPANT + _PARTICIPANT_GAIN * k for k in range(_PARTICIPANTS)))
    )


def domains_with_participants() -> list[int]:
    """The domains up to 101 that nodes on this machine use now, reserved or not.

    Ports of higher domains are in Linux's ephemeral range: any program may have them.
    """
    return [domain for domain in range(VEHICLE_DOMAINS[-1] + 1) if has_participants(domain)]


def confine_to(domain: int) -> None:
    """Gives this process the environment of `confined`, to watch or command what runs on `domain`.

    Raises:
        DomainError: if its traffic stays on this computer, which cannot reach itself.
    """
    confine(domain)
    if is_confined(os.environ) and (problem := loopback_problem()):
        raise DomainError(problem)


def loopback_problem() -> str:
    """Why nodes on this computer cannot reach each other by 127.0.0.1; "" if they can."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.settimeout(_LOOPBACK_S)
        try:
            own.bind(("127.0.0.1", 0))
            own.sendto(b"x", own.getsockname())
            own.recv(1)
        except OSError as error:
            return (
                f"The network of this computer itself (127.0.0.1, interface lo) is down ({error.strerror or error}). "
                "Its nodes cannot find each other. Bring it up: sudo ip link set lo up"
            )
    return ""


def _is_bound(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError as error:
            return error.errno == errno.EADDRINUSE
    return False


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Tries to lock a file until the context ends; the value is whether that succeeded."""
    try:
        file = path.open("a")
    except PermissionError:  # another user's
        yield False
        return
    except OSError:  # a full or read-only disk must stop no vehicle
        yield True
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
        with contextlib.suppress(OSError):
            file.truncate(0)  # a killed owner may have left its note
        try:
            yield True
        finally:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def _is_still(path: Path, file: IO[str]) -> bool:
    """Whether an open file is still the one at `path`."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def busy_domains() -> list[int]:
    """The domains that missions and vehicles on this machine use now."""
    paths = lock_file(0).parent.glob(lock_file(0).name.replace("_0.", "_*."))
    found = ((re.search(r"_(\d+)(?:_auv\d+)?\.lock$", path.name), path) for path in paths)
    return sorted({int(match[1]) for match, path in found if match is not None and _is_held(path)})


def _is_held(path: Path) -> bool:
    try:
        with path.open("r") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:  # locked, or another user's
        return True
    return False


def note_run(domain: int, run: Path, dive: str, vehicle: int = 0) -> None:
    """Notes who uses `domain`, for other commands.

    Args:
        run: The run folder of a simulation, or that of a vehicle's logs.
        vehicle: As `lock_file` takes it.

    Raises:
        DomainError: if the note cannot be written.
    """
    path = lock_file(domain, vehicle)
    try:
        path.write_text(f"{run}\n{dive}\n{os.getpid()}\n")
    except OSError as error:
        raise DomainError(
            f"{path}: the note for other commands cannot be written: {error.strerror}. Make space in {path.parent}."
        ) from error


def _notes(domain: int, vehicle: int = 0) -> tuple[str, str]:
    try:
        run, dive, *_ = [*lock_file(domain, vehicle).read_text().splitlines(), "", ""]
    except OSError:
        return "", ""
    return run, dive


def run_on(domain: int) -> Path | None:
    """The noted run folder of the simulation on `domain`; None if there is none."""
    run, _ = _notes(domain)
    return Path(run) if run else None


def dive_on(domain: int) -> str | None:
    """The id of the simulation that runs on `domain` now; None if none runs."""
    return _notes(domain)[1] if _is_held(lock_file(domain)) else None


def vehicle_on(domain: int, vehicle: int) -> tuple[str, str, int] | None:
    """Who runs a vehicle's nodes on `domain` now: folder of logs, id of the dive and process id; None if none runs.

    What is not noted, as on a full disk, is "" or 0.
    """
    path = lock_file(domain, vehicle)
    if not _is_held(path):
        return None
    try:
        lines = [*path.read_text().splitlines(), "", "", ""]
    except OSError:
        return "", "", 0
    return lines[0], lines[1], int(lines[2]) if lines[2].isdecimal() else 0


def refuse_running_dive(folder: Path, vehicle: int) -> None:
    """Refuses a second start of the dive in `folder`: two would command one vehicle, and write the same files.

    Raises:
        DomainError: if nodes of the vehicle run there now, in any domain.
    """
    for domain in busy_domains():
        found = vehicle_on(domain, vehicle)
        if found is not None and found[0] == str(folder):
            raise DomainError(
                f"{folder} has the dive of auv{vehicle} that runs now, in ROS domain {domain} (process {found[2]}). "
                "End it first, or choose another folder with --out"
            )


@contextlib.contextmanager
def own_records(paths: Iterable[Path], domain: int) -> Iterator[None]:
    """Reserves the records of a vehicle's dive: two dives at once would replace each other's state.

    Raises:
        DomainError: if a dive that runs now has one of them.
    """
    with contextlib.ExitStack() as stack:
        for path in dict.fromkeys(map(os.path.realpath, paths)):  # a copy may be the record itself
            key = hashlib.sha256(path.encode()).hexdigest()[:16]
            lock = lock_file(0).with_name(f"auv_lse_record_{key}.lock")
            if not stack.enter_context(_locked(lock)) and _is_held(lock):
                user = "of another user"
                with contextlib.suppress(OSError):
                    user = lock.read_text()
                raise DomainError(
                    f"{path} belongs to a running dive {user}. End it first, or choose another folder with --out, and "
                    "for second copies with safety.state_copies"
                )
            with contextlib.suppress(OSError):
                lock.write_text(f"in ROS domain {domain} (process {os.getpid()})")
        yield


def domain_number(text: str) -> int:
    """A ROS domain from text, as in ROS_DOMAIN_ID.

    Raises:
        DomainError: if it is invalid.
    """
    if not text.strip().isdecimal() or int(text) > _MOST:
        raise DomainError(
            f"ROS domain {text!r} is not a whole number from 0 to {_MOST} ({_shown(SIMULATOR_DOMAINS)} for "
            f"simulations, {_shown(VEHICLE_DOMAINS)} or 0 for vehicles)"
        )
    return int(text)


def wanted_domain(option: str | None) -> str | None:
    """The ROS domain that a user asks for, by a command line, else by ROS_DOMAIN_ID; None if by neither.

    A ROS_DOMAIN_ID of 0 is ROS's default, and counts as unset.
    """
    return option or (os.environ.get("ROS_DOMAIN_ID") or "0").strip().lstrip("0") or None


def simulator_of(run: Path) -> str | None:
    """The domain of the simulator whose run folder is `run`, as a command line names it; None if none runs."""
    return next((str(domain) for domain in busy_domains() if run_on(domain) == run), None)


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
    """The environment of a node whose output goes to a file: `confined`, without colours, on one thread.

    Args:
        domain: ROS domain; None: that of the environment.
    """
    own = {COPY_VARIABLE: own_copy(), "RCUTILS_COLORIZED_OUTPUT": "0", "PYTHONUNBUFFERED": "1"}
    return confined(domain) | own | ONE_THREAD
