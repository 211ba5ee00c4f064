"""The example pages: every block of code runs and prints what stands below it; a page imports only what it says."""

import contextlib
import io
import re
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "docs" / "reference" / "python").glob("*.md"))
BLOCK = re.compile(r"```python\n(.*?)```\n(?:```text\n(.*?)```\n)?", re.DOTALL)


@pytest.mark.parametrize("page", EXAMPLES, ids=[page.name for page in EXAMPLES])
def test_an_example_prints_what_its_page_shows(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    blocks = BLOCK.findall(page.read_text())
    assert len(blocks) >= 3
    for code, expected in blocks:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, str(page), "exec"), names)
        assert printed.getvalue() == expected, code


@pytest.mark.parametrize("page", EXAMPLES, ids=[page.name for page in EXAMPLES])
def test_an_example_needs_only_the_packages_that_its_page_names(page):
    text = page.read_text()
    needed = re.search(r"^Needs (.*?): ", text, re.MULTILINE).group(1)
    imported = {
        name for code, _ in BLOCK.findall(text) for name in re.findall(r"^(?:from|import) (auv_lse_\w+)", code, re.M)
    }
    assert imported
    assert imported <= set(re.findall(r"auv_lse_\w+", needed))
