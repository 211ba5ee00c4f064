"""A file that a reader reads: its beginning, its bytes and its text; gzip is unpacked."""

import contextlib
import io
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

from auv_lse_common.support.text import text_of
from auv_lse_common.support.user_error import brief
from auv_lse_shore.survey_import.survey_log import LogError, Progress

#: Bytes of a file by which its format is recognized.
HEAD = 65_536
#: Largest file, and largest unpacked one.
MOST_BYTES = 300_000_000
_GZIP, _GZIP_WBITS = b"\x1f\x8b", 31


class LogFile:
    """One file.

    Attributes:
        progress: Called with the share that has been read, 0 to 1.
        is_cut_off: Whether the end of a gzip file is missing or damaged, once its data was read.
    """

    def __init__(self, path: Path, progress: Progress = lambda share: None) -> None:
        """Opens nothing yet."""
        self.path = path
        self.progress = progress
        self.is_cut_off = False

    @cached_property
    def _piped(self) -> bytes | None:
        """All bytes of a pipe, which can be read only once; None for a file."""
        if self.path.is_file() or not self.path.exists():
            return None
        with self.path.open("rb") as pipe:
            return pipe.read(MOST_BYTES + 1)

    def _opened(self) -> BinaryIO:
        return self.path.open("rb") if self._piped is None else io.BytesIO(self._piped)

    @cached_property
    def head(self) -> bytes:
        """The first `HEAD` bytes."""
        with self._opened() as file:
            head = file.read(HEAD)
        return self._unpacked(HEAD) if head.startswith(_GZIP) else head

    @cached_property
    def data(self) -> bytes:
        """All bytes.

        Raises:
            LogError: if there are too many, or the file is damaged.
            OSError: if it cannot be read.
        """
        size = self.path.stat().st_size if self._piped is None else len(self._piped)
        if size > MOST_BYTES:
            raise LogError(
                f"{self.path} has {size / 1e6:,.0f} MB, and {MOST_BYTES / 1e6:,.0f} MB can be read. Split it by day."
            )
        data = self.path.read_bytes() if self._piped is None else self._piped
        if not data.startswith(_GZIP):
            return data
        data = self._unpacked(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise LogError(f"{self.path} unpacks to more than {MOST_BYTES / 1e6:,.0f} MB. Split it by day.")
        return data

    @contextlib.contextmanager
    def unpacked(self) -> Iterator[Path]:
        """A context with a path to the unpacked file."""
        with tempfile.TemporaryDirectory() as folder:
            path = self.path
            if path.stat().st_size != len(self.data):  # it was packed
                path = Path(folder) / path.stem
                path.write_bytes(self.data)
            yield path

    @property
    def text(self) -> str:
        """All bytes as text, whatever their encoding."""
        return text_of(self.data)

    def _unpacked(self, most: int) -> bytes:
        """The first bytes of a gzip file, of all its parts, as far as it is intact."""
        unpacker, parts, size, packed = zlib.decompressobj(wbits=_GZIP_WBITS), [], 0, b""
        with self._opened() as file:
            while size < most:
                packed = packed or file.read(1 << 20)
                if unpacker.eof and (packed := packed.lstrip(b"\0")):  # another part; zeros pad a tape's block
                    unpacker = zlib.decompressobj(wbits=_GZIP_WBITS)
                if not packed:
                    self.is_cut_off = not unpacker.eof
                    break
                try:
                    parts.append(unpacker.decompress(packed, most - size))
                except zlib.error as error:
                    if not size:
                        raise LogError(
                            f"{self.path} is a damaged gzip file ({brief(error)}). Copy it again."
                        ) from error
                    self.is_cut_off = True
                    break
                size += len(parts[-1])
                packed = unpacker.unused_data if unpacker.eof else unpacker.unconsumed_tail
        return b"".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What the user knows about a log that the log does not show.

    Attributes:
        accept_checksums: Whether NMEA sentences with a wrong checksum are used.
        columns: Names of a table's columns; () if its header names them.
        depth_unit_m: Metres in a table's unit of depth; 0: as the header says, else metres.
        day_first: Whether 3/4/2026 is in April; None: as the dates show.
        surface_m: Elevation of the water surface, for tables of elevations; NaN: unknown.
        crs: Coordinate reference system of a table in metres; "" if unknown.
        today: The latest day of a date whose notation allows several.
        used: Names of those that some log needed.
    """

    accept_checksums: bool = False
    columns: tuple[str, ...] = ()
    depth_unit_m: float = 0.0
    day_first: bool | None = None
    surface_m: float = float("nan")
    crs: str = ""
    today: date = date.max
    used: set[str] = field(default_factory=set, compare=False)
