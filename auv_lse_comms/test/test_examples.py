"""The example pages: every block of code runs, and prints what stands below it."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
_BLOCK = re.compile(r"```python\n(.*?)```\n(?:```text\n(.*?)```\n)?", re.DOTALL)


@pytest.mark.parametrize("page", ["packet.md", "drive_a_modem.md"])
def test_an_example_prints_what_its_page_shows(page: str) -> None:
    names: dict[str, Any] = {}
    blocks = _BLOCK.findall((EXAMPLES / page).read_text(encoding="utf-8"))
    assert len(blocks) >= 4
    for code, expected in blocks:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, page, "exec"), names)
        assert printed.getvalue() == expected, code
