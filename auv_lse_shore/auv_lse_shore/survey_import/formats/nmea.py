"""NMEA 0183 from plotters, multiplexers and GPS receivers: GGA, RMC, GLL or GNS with DPT, DBT, DBS or DBK."""

from auv_lse_common.support.text import encoding_of, text_of
from auv_lse_shore.survey_import.log_content import LogContent
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.sentences import ANY_SENTENCE, SentenceReader

#: Bytes that are read at once, and how far a piece reaches into the next one to end with a line.
_PIECE = 8_000_000

#: Logs of other formats contain sentences, too.
ASKED_LAST = True


def recognizes(file: LogFile) -> bool:
    """Whether the beginning has NMEA sentences, whatever stands between them."""
    return len(ANY_SENTENCE.findall(_plain(file.head))) >= min(3, max(1, file.head.count(b"\n")))


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a log.

    Raises:
        LogError: if the file is too large.
        OSError: if it cannot be read.
    """
    content = LogContent(file.path.name)
    options.used.add("accept_checksums")
    reader = SentenceReader(content, options.accept_checksums)
    data, start = _plain(file.data), 0
    while start < len(data):
        end = data.find(b"\n", start + _PIECE)
        end = len(data) if end < 0 else end
        reader.take(data[start:end])
        start = end
        file.progress(start / len(data))
    reader.finish()
    return [content]


def _plain(data: bytes) -> bytes:
    """The log as ASCII bytes without zeros."""
    if encoding_of(data) != "utf-8":
        data = text_of(data).encode("ascii", errors="replace")
    return data.replace(b"\0", b"")
