"""Builds the page: one self-contained HTML file from the files in `page_files/`."""

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path

from auv_lse_shore.live.sources.timeline import Event

_FOLDER = Path(__file__).parent / "page_files"

#: The page's modules; each follows the modules that it imports.
MODULES = (
    "format.js",
    "colors.js",
    "canvas.js",
    "store.js",
    "packets.js",
    "player.js",
    "link.js",
    "measure.js",
    "graticule.js",
    "map.js",
    "slots.js",
    "chart.js",
    "alarms.js",
    "vehicles.js",
    "commands.js",
    "team.js",
    "main.js",
)
_IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export ", re.MULTILINE)


def script_hash(page: str) -> str:
    """The hash of the page's script, as a Content-Security-Policy names it: no other script may run in the page."""
    script = page.split('<script type="module">', 1)[1].split("</script>", 1)[0]
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def live_page(events: Sequence[Event] | None = None) -> str:
    """The page as one HTML text.

    Args:
        events: A whole mission to embed, so that the page needs no server; None: the page connects to its server.
    """
    script = "\n".join(_EXPORT.sub("", _IMPORT.sub("", (_FOLDER / name).read_text())) for name in MODULES)
    # "<" is escaped, so that no text of a mission can close the script element.
    kept = "" if events is None else json.dumps(events, separators=(",", ":")).replace("<", "\\u003c")
    page = (_FOLDER / "index.html").read_text()
    for mark, text in (
        ("/* style.css */", (_FOLDER / "style.css").read_text()),
        ("/* events */", kept),
        ("/* modules */", script),
    ):
        page = page.replace(mark, text, 1)
    return page
