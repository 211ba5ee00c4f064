"""The team's key, a file of hexadecimal digits that only its owner can read: creates and reads it."""

import argparse
import hashlib
import os
import secrets
import stat
from pathlib import Path

_KEY_BYTES = 32


class KeyFileError(ValueError):
    """A key file that cannot be used. Its message never contains the key."""


def new_nonce() -> int:
    """A random number, 1 to 2**63 - 1, that no recorded answer contains."""
    return 1 + secrets.randbelow(2**63 - 1)


def read_key(path: str | Path) -> bytes:
    """Reads the team's key.

    Args:
        path: File of 32 to 64 hexadecimal digits (16 to 32 bytes), owned by this user (or root) and inaccessible to
            group and others.

    Raises:
        KeyFileError: naming the file and the problem.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise KeyFileError(f"{path} is not a regular file; name a file with the key")
            if status.st_mode & 0o077:
                mode = stat.S_IMODE(status.st_mode)
                raise KeyFileError(
                    f"{path}: mode {mode:04o} gives others access to the key. Restrict it: chmod 600 {path}"
                )
            if status.st_uid not in (0, os.geteuid()):
                raise KeyFileError(f"{path} belongs to user {status.st_uid}; the key must be this user's or root's")
            text = file.read(4096)
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be read: {error.strerror or type(error).__name__}") from None
    try:
        key = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        raise KeyFileError(f"{path} is not hexadecimal; name a file made by auv_lse key") from None
    if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
        raise KeyFileError(f"{path} holds {len(key)} bytes; a key has 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
    return key


def make_key(path: str | Path) -> None:
    """Creates a key: a new file of 64 hexadecimal digits with mode 0600. It is written completely or not at all.

    Raises:
        KeyFileError: if the file exists, or cannot be written.
    """
    path = Path(path)
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise KeyFileError(
            f"{path} exists already. Choose a new file: overwriting a key loses it for the whole team"
        ) from None
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be created: {error.strerror or error}") from None
    try:
        with os.fdopen(number, "wb") as file:
            os.fchmod(number, 0o600)  # independent of the umask
            file.write(secrets.token_hex(_KEY_BYTES).encode() + b"\n")
            file.flush()
            os.fsync(number)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise KeyFileError(f"{path}: cannot be written: {error.strerror or error}") from None


ERRORS = (KeyFileError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse key."""
    p = argparse.ArgumentParser(
        prog="auv_lse key",
        description="Creates a key for authenticated packets (docs/design/comms.md): a new file of 64 hexadecimal "
        "digits that only you can read. Copy it to every vehicle of the team, and set packet.key_file.",
        epilog="Exit codes: 0 created; 2 the file exists or cannot be written.",
    )
    p.add_argument("file", type=Path, metavar="FILE", help="the new file, which must not exist yet")
    return p


def run(options: argparse.Namespace) -> None:
    """Creates a key."""
    make_key(options.file)
    print(f"{options.file}: new key of {_KEY_BYTES} bytes, mode 0600; copy the file to every vehicle")
