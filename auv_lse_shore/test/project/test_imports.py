"""The modules import each other in one direction, and what computes imports nothing that draws."""

import ast
import functools
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from auv_lse_shore.live.viewers import page

ROOT = Path(__file__).resolve().parents[3]
DRAWING = (
    "auv_lse_shore.report.figures",
    "auv_lse_shore.report.found_figure",
    "auv_lse_shore.report.reward_figures",
    "auv_lse_shore.report.report_figures",
    "auv_lse_shore.campaign.page",
    "auv_lse_shore.reproduce.study_figures",
)


def modules():
    names = {}
    for package in ROOT.glob("auv_lse_*/package.xml"):
        folder = package.parent
        for path in (folder / folder.name).rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            names[".".join(parts).removesuffix(".__init__")] = path
    return names


@functools.cache
def imports():
    """The modules of the project that each module imports."""
    paths = modules()
    graph = {}
    for name, path in paths.items():
        found = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                submodules = {f"{node.module}.{alias.name}" for alias in node.names} & paths.keys()
                found |= submodules or {node.module}
        graph[name] = found & paths.keys()
    return graph


def test_no_module_imports_itself_through_others():
    TopologicalSorter(imports()).prepare()  # raises CycleError, with the cycle


@pytest.mark.parametrize(
    "name",
    [
        "auv_lse_common.mission_file.settings",
        "auv_lse_sim.world",
        "auv_lse_sim.engine.fleet",
        "auv_lse_record.run_reader",
        "auv_lse_shore.live.command",
        "auv_lse_shore.judge.evaluation",
        "auv_lse_shore.campaign.runner",
        "auv_lse_shore.reproduce.claims",
        "auv_lse_shore.reproduce.study_runner",
        "auv_lse_shore.reproduce.study_results",
    ],
)
def test_what_computes_imports_nothing_that_draws(name):
    graph, seen, waiting = imports(), set(), [name]
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            waiting += graph[module]
    assert not seen & {*DRAWING}
    drawn = re.compile(r"^\s*(import|from) matplotlib", re.MULTILINE)
    assert not [module for module in seen if drawn.search(modules()[module].read_text())]


def test_the_pages_modules_import_each_other_in_one_direction_and_are_joined_in_that_order():
    folder = ROOT / "auv_lse_shore/auv_lse_shore/live/viewers/page_files"
    found = {path.name: re.findall(r'from "\./(\w+\.js)"', path.read_text()) for path in folder.glob("*.js")}
    order = page.MODULES
    assert sorted(order) == sorted(found)
    for position, name in enumerate(order):
        assert set(found[name]) <= set(order[:position]), name
