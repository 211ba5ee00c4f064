"""The conversation between `auv_lse fleet` and `auv_lse vehicle-side`: JSON, a line each, and the bytes of files.

The vehicle speaks first, with its hello. The laptop then asks, one line at a time, and each line gets one answer. A
request or answer with the key `bytes` is followed by that many bytes.
"""

import json
from collections.abc import Mapping
from typing import Any

#: Version of the conversation. Both sides must have the same.
PROTOCOL = 1
#: Longest line (bytes): a list of the files of many dives.
MAX_LINE = 4_000_000


class WireError(ValueError):
    """A line that is not of this protocol."""


def encoded(message: Mapping[str, Any]) -> bytes:
    """A message as a line."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def decoded(line: bytes) -> dict[str, Any]:
    """The message of a line.

    Raises:
        WireError: if it is not a message.
    """
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):  # also text that is not UTF-8
        found = None
    if not isinstance(found, dict):
        raise WireError(f"the other side sent a line that is not a message: {line[:80]!r}")
    return found
