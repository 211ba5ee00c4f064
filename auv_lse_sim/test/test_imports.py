"""The package's modules import each other in one direction, and what computes imports nothing that draws."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import auv_lse_sim

ROOT = Path(auv_lse_sim.__file__).parent
DRAWING = (
    "auv_lse_sim.judge.figures",
    "auv_lse_sim.judge.found_figure",
    "auv_lse_sim.judge.reward_figures",
    "auv_lse_sim.judge.report_figures",
    "auv_lse_sim.campaign.page",
    "auv_lse_sim.campaign.study_figures",
    "auv_lse_sim.campaign.tuning_figure",
)


def modules():
    names = {}
    for path in ROOT.rglob("*.py"):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        names[".".join(parts).removesuffix(".__init__")] = path
    return names


def imports():
    """The modules of the package that each of its modules imports."""
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
        "auv_lse_sim.settings",
        "auv_lse_sim.world.world",
        "auv_lse_sim.engine.fleet",
        "auv_lse_sim.record.bag",
        "auv_lse_sim.live.command",
        "auv_lse_sim.judge.evaluation",
        "auv_lse_sim.campaign.runner",
        "auv_lse_sim.campaign.claims",
        "auv_lse_sim.campaign.study_runner",
        "auv_lse_sim.campaign.study_results",
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
    assert all("matplotlib" not in modules()[module].read_text() for module in seen)
