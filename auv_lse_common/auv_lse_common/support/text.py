"""Decodes the text of users' files: tables, grids, areas and logs, in whatever encoding other programs write."""

import codecs

#: Byte order marks and their encodings; the longer first.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
#: Bytes by which UTF-16 without a mark is recognized, and the least share of zeros among every second of them.
_HEAD, _ZEROS = 4096, 0.7


def encoding_of(data: bytes) -> str:
    """The encoding that a mark or the pattern of zeros shows; "utf-8" if neither does."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return encoding
    head = data[:_HEAD]
    for start, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        half, other = head[start::2], head[1 - start :: 2]
        if half and half.count(0) > _ZEROS * len(half) and other.count(0) < (1.0 - _ZEROS) * len(other):
            return encoding
    return "utf-8"


def decoded(data: bytes) -> str:
    """Text from bytes: by mark, as UTF-8, or as Windows-1252."""
    encoding = encoding_of(data)
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return data.decode("cp1252" if encoding == "utf-8" else encoding, errors="replace")


def text_of(data: bytes) -> str:
    """As `decoded`, without the zeros that loggers leave between their lines."""
    return decoded(data).replace("\0", "")


def is_text(head: bytes) -> bool:
    """Whether the beginning of a file is text: hardly any control characters once it is decoded."""
    text = text_of(head)
    odd = sum(1 for character in text if (character < " " and character not in "\t\r\n\f\x1a") or character == "\ufffd")
    raw_zeros = head.count(0) if encoding_of(head) == "utf-8" else 0
    return bool(text.strip()) and odd + raw_zeros <= 0.05 * len(text)
