"""The golden tree of the search: grown from a fixed seed, kept in golden_tree.txt.

    python auv_lse_planner/test/golden_tree.py > auv_lse_planner/test/golden_tree.txt

prints it anew. That is right only if the search is meant to change.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from planner_helpers import world

from auv_lse_planner.search.tree import FORBIDDEN, ActionTree
from auv_lse_planner.search.uct import run_search

GOLDEN = Path(__file__).with_suffix(".txt")
STATE = np.array([1.2, 30.0, 440.0])  # beside the border: not all actions are feasible


def worth(sequences: list[tuple[int, ...]]) -> np.ndarray:
    """A made-up value: whole numbers, so that it is the same on every machine."""
    return np.array([float(sum((a + 1) * (a + 3 * i) % 7 for i, a in enumerate(s))) for s in sequences])


def lines_of_the_tree() -> list[str]:
    """The tree after 120 iterations: a line for each node, its sequence and "visits, sum of values, choices"."""
    _, _, space, _ = world()
    tree = ActionTree(space, STATE, 5, 0.4)
    result = run_search(tree, worth, 5, 120, 8, np.random.default_rng(1), None, [(5, 5, 5), (4, 6)])
    lines = [f"best {result.actions}: {result.value:g} after {result.iterations} iterations"]
    nodes: list[tuple[tuple[int, ...], int]] = [((), 0)]
    while nodes:
        sequence, node = nodes.pop(0)
        children = tree._nodes.children[node]
        choices = int(np.count_nonzero(children != FORBIDDEN)) if len(sequence) < 5 else 0
        lines.append(f"{sequence}: {tree._nodes.visits[node]}, {tree._nodes.totals[node]:g}, {choices}")
        nodes += [((*sequence, a), int(child)) for a, child in enumerate(children) if child >= 0]
    return lines


if __name__ == "__main__":
    print("\n".join(lines_of_the_tree()))
