"""The options of `auv_lse bench planners`, and the names of planners and roles; loads nothing heavy."""

import argparse
from pathlib import Path
from typing import Any

from auv_lse_common.support.option_types import whole_from

#: Methods of ours by name: parameters of the mission file. In the whole simulation all have corrected positions but
#: `plain_uncorrected`, which is dead-reckoned as in the paper, with a map that ignores the uncertainty of positions.
OURS: dict[str, dict[str, Any]] = {
    "goal_line": {"mission.goal": "line"},
    "line": {"planner.method": "line"},
    "tour": {"planner.method": "tour"},
    "plain": {"planner.method": "plain"},
    "plain_uncorrected": {"planner.method": "plain", "positions.correct": False, "packet.navigation": False},
    "augmented": {"planner.method": "augmented"},
    "fitted_lanes": {"planner.method": "lawnmower"},
    "covering_lanes": {"planner.method": "lawnmower", "planner.naive_paths": [250, 251, 252, 253, 254]},
}
#: Names of the rivals that need sgptools' environment, of all rivals, and of the row of hindsight.
PEER_NAMES = ("continuous_sgp", "gcb_cover")
RIVAL_NAMES = (
    "straddle", "randomized_straddle", "level_set_ucb", "level_set_ucb_3", "truvar", "global_sur", "eavc", "dec_mcts",
    "dec_mcts_wide", *PEER_NAMES,
)  # fmt: skip
HINDSIGHT = "hindsight"
#: What a ground may be used for. A figure that is reported comes from grounds that nothing was tuned or chosen on.
ROLES = ("tuning", "choosing", "reporting")
#: Planners that are flown, and those that others are compared with, unless options name them.
PLANNERS = ["line", "plain", "tour", "fitted_lanes"]
AGAINST = PLANNERS[1:]
#: The grounds; data of real lakes are not part of the project.
MANIFEST = Path(__file__).resolve().parents[3] / "config" / "planner_grounds.yaml"


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of `auv_lse bench planners`."""
    group = parser.add_argument_group("options of `bench planners`")
    known = ", ".join([*OURS, *RIVAL_NAMES, HINDSIGHT])
    group.add_argument(
        "--planners", nargs="+", default=PLANNERS, metavar="NAME",
        help=f"any of {known}, an entry point of auv_lse.planners, or a Python file (default: "
        f"{' '.join(PLANNERS)})",
    )  # fmt: skip
    group.add_argument("--grounds", type=Path, default=MANIFEST, metavar="FILE",
                       help="manifest (default: config/planner_grounds.yaml of the checkout)")  # fmt: skip
    group.add_argument("--data", type=Path, metavar="FOLDER", help="folder of the manifest's files (default: its own)")
    group.add_argument("--environment", type=Path, metavar="FOLDER",
                       help=f"of sgptools, for {' and '.join(PEER_NAMES)}; made if it is not there (3 GB)")  # fmt: skip
    group.add_argument("--role", choices=ROLES, default="reporting", help="grounds to fly (default: %(default)s)")
    group.add_argument("--only", nargs="+", metavar="GROUND", help="of these, by name")
    group.add_argument(
        "--vehicles", type=whole_from(1), nargs="+", default=[1], metavar="K", help="sizes of team (default: 1)"
    )
    group.add_argument(
        "--seeds", type=whole_from(1), default=1, metavar="N", help="missions on each ground (default: 1)"
    )
    group.add_argument("--legs", type=whole_from(1), default=100, help="legs of each vehicle (default: %(default)s)")
    group.add_argument("--against", nargs="+", metavar="NAME",
                       help=f"planners that others are compared with (default: {' '.join(AGAINST)})")  # fmt: skip
    group.add_argument(
        "--whole",
        action="store_true",
        help="fly in the whole simulation: drift, corrected positions, surfacings, acoustic channel",
    )
    out = Path("runs/benchmarks/planners.jsonl")
    group.add_argument("--out", type=Path, default=out, metavar="FILE", help="missions, continued (%(default)s)")
    group.add_argument("--page", type=Path, metavar="FILE.md", help="write the page here (default: print it)")
    group.add_argument(
        "--processes", type=whole_from(1), default=2, help="missions flown at once (default: %(default)s)"
    )
