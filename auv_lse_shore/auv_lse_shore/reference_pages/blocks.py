"""Generated blocks in Markdown pages: found by their markers, written, compared.

A page marks a block with two comment lines; everything between them is generated:

    <!-- generated: topics -->
    <!-- end -->
"""

import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

_BLOCK = re.compile(r"^<!-- generated: (?P<name>[\w-]+) -->\n.*?^<!-- end -->$", re.MULTILINE | re.DOTALL)


def render(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """A page's text with every generated block renewed.

    Args:
        text: Markdown.
        blocks: What generates each block, by its name.

    Raises:
        ValueError: for a block that nothing generates.
    """

    def renewed(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in blocks:
            raise ValueError(f"{name!r} is not a generated block; use one of {', '.join(sorted(blocks))}")
        return f"<!-- generated: {name} -->\n{blocks[name]().strip()}\n<!-- end -->"

    return _BLOCK.sub(renewed, text)


def block_names(text: str) -> list[str]:
    """Names of the generated blocks in a page."""
    return [match["name"] for match in _BLOCK.finditer(text)]


def outdated(folder: Path, blocks: Mapping[str, Callable[[], str]]) -> dict[Path, str]:
    """Pages below `folder` whose generated blocks differ from the code, each with its new text."""
    found = {}
    for page in sorted(folder.rglob("*.md")):
        text = page.read_text()
        if (new := render(text, blocks)) != text:
            found[page] = new
    return found


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A Markdown table; bars inside a cell are escaped."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return "\n".join(line.replace("|  |", "| |").replace("|  |", "| |") for line in lines)


def code(name: object) -> str:
    """Text in backticks; "" stays empty."""
    return f"`{name}`" if str(name) else ""


def wrapped(text: str) -> str:
    """A paragraph in lines of at most 120 columns."""
    return "\n".join(textwrap.wrap(text, 120, break_on_hyphens=False, break_long_words=False))


def item(text: str) -> str:
    """A list item in lines of at most 120 columns."""
    return textwrap.fill(f"- {text}", 120, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)
