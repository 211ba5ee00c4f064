"""Reads the fenced blocks of the guide: what `test_guide.py` parses and runs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
GUIDE = sorted((ROOT / "docs" / "guide").glob("*.md"))
PAGES = [
    *(
        ROOT / name
        for name in ("README.md", "CONTRIBUTING.md", "docs/reference/hardware.md", "docs/extending/adding-a-driver.md")
    ),
    *GUIDE,
]

#: How a block begins that the tests only parse: it names what it needs, or how long it takes.
NOT_RUN = re.compile(r"# (needs|takes) ")


@dataclass(frozen=True, slots=True)
class Block:
    """One fenced block.

    Attributes:
        page: The page it is on.
        line: The number of its first line.
        language: What stands after the fence: sh, yaml, python.
        title: The file that the reader saves it as; "" if none.
        text: Its lines.
    """

    page: Path
    line: int
    language: str
    title: str
    text: str

    @property
    def runs(self) -> bool:
        """Whether the tests run it."""
        return self.language == "sh" and not NOT_RUN.match(self.text)

    def commands(self) -> Iterator[list[str]]:
        """The words of each command; redirections, comments and what follows `||` are left out."""
        for line in self.text.splitlines():
            for part in re.split(r"&&|;", line.partition("||")[0]):
                words = shlex.split(re.sub(r"[<>]\s*\S+", "", part), comments=True)
                if words:
                    yield words


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, from top to bottom."""
    found: list[Block] = []
    start, language, title, lines = 0, "", "", []
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if line.startswith("```") and not start:
            start, lines = number + 1, []
            language = line[3:].split(" ")[0]
            title = "".join(re.findall(r'title="([^"]+)"', line))
        elif line.startswith("```"):
            found.append(Block(page, start, language, title, "\n".join(lines) + "\n"))
            start = 0
        elif start:
            lines.append(line)
    assert not start, f"{page.name}:{start}: the fence is not closed"
    return found
