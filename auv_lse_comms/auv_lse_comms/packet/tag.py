"""Optional tag at a packet's end: keyed BLAKE2s over the packet, its sender and the dive (RFC 7693).

The mission step is among the hashed bytes. A receiver accepts from each sender only steps that do not decrease, and
each packet of one step once. So forged, altered and replayed packets are refused. The tag does not encrypt. It also
accepts a packet that an attacker withheld and replays before a newer one arrives: that packet is still what the sender
sent.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
from pathlib import Path

from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.packet.fields import HEADER, HEADER_STRUCT, PACKET_BYTES

_CONTEXT = b"auv_lse1"  # 8 bytes, the size of BLAKE2s's personalization


class KeyFileError(ValueError):
    """A key file that cannot be used. Its message never holds the content."""


def read_key(path: str | Path) -> bytes:
    """Reads the team's key.

    Args:
        path: File of 32 to 64 hexadecimal digits (16 to 32 bytes), owned by this user (or root) and closed to group
            and others.

    Raises:
        KeyFileError: naming the file and what is wrong with it.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise KeyFileError(f"{path}: not a regular file; expected a file with the key")
            if status.st_mode & 0o077:
                mode = stat.S_IMODE(status.st_mode)
                raise KeyFileError(
                    f"{path}: mode {mode:04o} gives others access to the key; expected 0600: chmod 600 {path}"
                )
            if status.st_uid not in (0, os.geteuid()):
                raise KeyFileError(f"{path}: belongs to user {status.st_uid}; expected this user or root")
            text = file.read(4096)
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be read: {error.strerror or type(error).__name__}") from None
    try:
        key = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        raise KeyFileError(f"{path}: not hexadecimal; make one with: openssl rand -hex 32 > {path}") from None
    if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
        raise KeyFileError(f"{path}: {len(key)} bytes; expected 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
    return key


class Tagger:
    """Signs own packets and checks those of others; remembers which it has accepted of each sender."""

    def __init__(self, key: bytes, size: int, session: str = "") -> None:
        """Takes the key, which no text of this object shows.

        Args:
            key: 16 to 32 bytes.
            size: Bytes of the tag.
            session: Name of the dive; packets of another one are refused.

        Raises:
            ValueError: if the key or the tag has a length that is not allowed.
        """
        if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
            raise ValueError(f"a key of {len(key)} bytes: expected 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
        if not 1 <= size <= hashlib.blake2s.MAX_DIGEST_SIZE:
            raise ValueError(f"a tag of {size} bytes: expected 1 to {hashlib.blake2s.MAX_DIGEST_SIZE}")
        self.size = size
        self._session = session.encode()
        self._key = key
        self._accepted: dict[int, tuple[int, set[bytes]]] = {}

    def __repr__(self) -> str:
        """Without the key."""
        return f"Tagger(size={self.size})"

    def _tag(self, source: int, body: bytes) -> bytes:
        # every part but the last has a fixed length or its length before it: no two inputs hash the same bytes
        prefix = source.to_bytes(2, "little") + bytes([len(self._session)]) + self._session
        return hashlib.blake2s(prefix + body, key=self._key, digest_size=self.size, person=_CONTEXT).digest()

    def seal(self, data: bytes, source: int) -> bytes:
        """The packet with the tag in its last bytes.

        Args:
            data: Packet from `encode(..., reserve=size)`.
            source: Number of the sender.
        """
        body = data[: PACKET_BYTES - self.size]
        return body + self._tag(source, body)

    def check(self, data: bytes, source: int) -> None:
        """Accepts a packet, once.

        Args:
            data: Packet of 252 bytes from the water.
            source: Sender's number according to the modem.

        Raises:
            PacketError: "length"; "tag" if the tag is not that of these bytes from this sender; "replay" if the
                packet was accepted before or its step is lower than the last accepted from this sender.
        """
        if len(data) != PACKET_BYTES:
            raise PacketError("length", f"{len(data)} bytes: expected {PACKET_BYTES}")
        body, tag = data[: PACKET_BYTES - self.size], data[PACKET_BYTES - self.size :]
        if not hmac.compare_digest(tag, self._tag(source, body)):
            raise PacketError("tag", f"the tag is not that of vehicle {source}, these bytes and this team's key")
        step = int(HEADER_STRUCT.unpack_from(data)[0])
        last, seen = self._accepted.get(source, (-1, set()))
        if step < last:
            raise PacketError("replay", f"{HEADER[0].name} {step} of vehicle {source}: {last} was received before")
        if step == last and tag in seen:
            raise PacketError("replay", f"this packet of vehicle {source}, step {step}, was received before")
        self._accepted[source] = (step, {tag} if step > last else seen | {tag})
