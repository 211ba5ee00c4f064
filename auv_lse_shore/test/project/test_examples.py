"""The example pages: every block of code runs and prints what stands below it; a page imports only what it says."""

import contextlib
import io
import os
import re
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted((ROOT / "docs" / "reference" / "python").glob("*.md"))
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


LIBRARIES = ("auv_lse_gp", "auv_lse_planner", "auv_lse_comms", "auv_lse_record")

#: Times the imports of the faces, one by one.
FACES = "import sys, time\nbegan = time.perf_counter()\n__import__(sys.argv[1])\nprint(time.perf_counter() - began)"


@pytest.mark.skipif("AUV_LSE_SLOW" not in os.environ, reason="installs from PyPI; AUV_LSE_SLOW=1 runs it")
def test_wheels_run_the_example_pages_in_an_empty_environment(tmp_path: Path) -> None:
    environment = {
        name: text for name, text in os.environ.items() if name not in ("PYTHONPATH", "LD_LIBRARY_PATH", "AUV_LSE_SLOW")
    }
    environment = {**environment, "AUV_LSE_WHEELS": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}

    def run(*command: object) -> str:
        words = [str(word) for word in command]
        done = subprocess.run(words, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
        return done.stdout

    sources = [path.parent for path in sorted(ROOT.glob("auv_lse_*/setup.py"))]
    pip = (sys.executable, "-m", "pip")
    run(*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", tmp_path / "wheels", *sources)
    assert len(list((tmp_path / "wheels").glob("*.whl"))) == len(sources)
    venv.create(tmp_path / "empty", with_pip=False)
    python = tmp_path / "empty" / "bin" / "python"
    target = ("--python", python, "install", "-q", "--find-links", tmp_path / "wheels")
    run(*pip, *target, *LIBRARIES, "pytest")
    commands = {path.name for path in (tmp_path / "empty" / "bin").iterdir()}
    assert not {"fit", "vehicle", "gp_node", "planner_node", "modem_node", "recorder_node"} & commands
    for package in LIBRARIES:
        assert float(run(python, "-c", FACES, package)) < 0.3
        run(python, "-c", f"from {package} import *")
    run(python, "-m", "pytest", "-q", "-c", os.devnull, "--noconftest", "--import-mode=importlib", Path(__file__))
