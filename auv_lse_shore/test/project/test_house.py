"""What keeps the code readable: sizes of functions, argument lists, modules and folders, and how errors are phrased."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SOURCES = sorted(path for path in ROOT.glob("auv_lse_*/auv_lse_*/**/*.py") if "egg-info" not in path.as_posix())

#: Inner loops that numba compiles may be longer and take more arguments.
COMPILED = ("compiled", "njit", "vectorize", "guvectorize")
#: "About fifteen" files or subpackages in one folder. Messages and commands are lists by nature.
MOST_ENTRIES = 20
LISTS = ("auv_lse_msgs/msg", "scripts", "docs/figures")


def functions():
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                decorators = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
                if not any(name in decorators for name in COMPILED):
                    yield f"{path.relative_to(ROOT)}:{node.lineno} {node.name}", node


def test_no_function_is_longer_than_60_lines():
    long = [name for name, node in functions() if node.end_lineno - node.lineno >= 60]
    assert not long


def test_no_function_takes_more_than_8_arguments():
    many = []
    for name, node in functions():
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        own = [argument for argument in arguments if argument.arg not in ("self", "cls")]
        if len(own) > 8:
            many.append(f"{name}: {len(own)}")
    assert not many


def test_no_module_is_longer_than_500_lines():
    assert not [path for path in SOURCES if len(path.read_text().splitlines()) > 500]


#: "depth_m: got 3; expected less": nothing is got or expected. `CONTRIBUTING.md` has the rule for errors.
TEMPLATE = re.compile(r"; expected\b|: expected (?:an?|at|both|one|[\d{(])")


def test_no_error_has_the_old_template():
    paths = [*SOURCES, *ROOT.glob("auv_lse_*/launch/*.py"), *ROOT.glob("benchmarks/**/*.py")]
    joined = {path: re.sub(r'"\s+f?"', "", path.read_text()) for path in paths}  # texts of several lines
    found = {str(path.relative_to(ROOT)): match[0] for path, text in joined.items() if (match := TEMPLATE.search(text))}
    assert not found, "say what is wrong, the value and the cure"


PARTS = [*sorted(path.parent.name for path in ROOT.glob("*/package.xml")), "docs", "benchmarks", "config"]


@pytest.mark.parametrize("top", PARTS)
def test_a_folder_can_be_taken_in_at_a_glance(top):
    folders = [ROOT / top, *(path for path in (ROOT / top).rglob("*") if path.is_dir() and not path.is_symlink())]
    full = []
    for folder in folders:
        name = folder.relative_to(ROOT).as_posix()
        entries = [path for path in folder.iterdir() if not path.name.startswith((".", "__")) and path.suffix != ".pyc"]
        entries = [path for path in entries if path.name != "verbs.py"]  # each package has one, as its __init__.py
        if len(entries) > MOST_ENTRIES and name not in LISTS and "__pycache__" not in name:
            full.append(f"{name}: {len(entries)}")
    assert not full
