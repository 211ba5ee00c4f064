"""auv_lse nodes list."""

from types import SimpleNamespace
from typing import Any

import pytest

from auv_lse_run.inspect import nodes


def test_a_node_that_is_there_twice_is_named_and_several_live_views_are_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = ["/auv1/gp_node", "/auv1/gp_node", "/live_view", "/live_view"]
    graph: Any = SimpleNamespace(nodes=lambda hidden: names, require_nodes=lambda: None)
    options: Any = SimpleNamespace(all=False, count_nodes=False)
    assert nodes.run_list(options, graph) == 0
    printed = capsys.readouterr()
    assert printed.out.split() == names
    assert printed.err == "warning: 2 nodes have the name /auv1/gp_node; one of them may be left over\n"
