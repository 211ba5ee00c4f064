"""The figures of merit of a mission, `summary.json`: each with its unit and meaning.

First the isobath and the map, then what explains them, last the paper's reward.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def figure(unit: str, help: str) -> Any:
    """A field of `Summary` with its unit ("" for a plain number) and meaning."""
    return dataclasses.field(metadata={"unit": unit, "help": help})


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The figures of merit of a mission; None if unknown.

    Unknown are comparisons with a truth, a naive part or a bound that does not exist. A mission that ended before its
    last step keeps no bound, because bounds are those of a complete mission.
    """

    vehicles: int = figure("", "number of vehicles (K)")
    steps: int = figure("", "legs travelled by the vehicle with most of them")
    method: str = figure("", "planner.method of the mission")
    goal: str = figure("", "mission.goal: chart or line")
    seed: int = figure("", "mission.seed")
    quality_asked: str | None = figure("", "mission.until in words")
    quality_reached: bool = figure("", "whether it ended with that quality")
    isobath_found_m: float = figure(
        "m", "length of the estimated isobath that is found: within 20 m with 95 % certainty"
    )
    isobath_likely_m: float = figure("m", "length that is likely")
    isobath_guessed_m: float = figure("m", "length that is guessed: the data hardly support it")
    isobath_found_within_m: float | None = figure(
        "m", "distance within which 95 % of the line found is expected of the true isobath"
    )
    isobath_undiscovered_m: float = figure("m", "expected length of isobath farther than 10 m from the part found")
    isobath_undiscovered_limit_m: float = figure("m", "upper limit of that length with 95 % probability")
    isobath_not_visited_m: float = figure(
        "m", "length not found because no vehicle measured near it, or on one side only"
    )
    isobath_positions_uncertain_m: float = figure(
        "m", "length not found because the vehicles' positions were uncertain"
    )
    isobath_flat_m: float = figure("m", "length not found because the ground there is too flat")
    isobath_found: float | None = figure("", "share of the true isobath within 10 m of the part found")
    isobath_found_error_m: float | None = figure("m", "mean distance of the part found from the true isobath")
    isobath_found_error_p95_m: float | None = figure("m", "95th percentile of that distance")
    isobath_made_up: float | None = figure("", "share of the part found farther than 10 m from any true isobath")
    isobath_true_m: float | None = figure("m", "length of the true isobath")
    isobath_error_m: float | None = figure(
        "m",
        "mean distance between the whole estimate, guesses included, and the true isobath, in both directions; missing "
        "and invented pieces count, so use it to compare methods",
    )
    isobath_error_p95_m: float | None = figure("m", "95th percentile of those distances")
    isobath_length_m: float = figure("m", "length of the whole estimate")
    risk_before: float = figure("cost/location", "map risk, the mean Bayes risk over the map, before the mission")
    risk_third: float | None = figure(
        "cost/location", "map risk after a third of the steps (over part of the locations)"
    )
    risk_after: float = figure(
        "cost/location",
        "map risk given the soundings of all vehicles, with the prior's standard deviation, which planners and the "
        "lawnmower bound use",
    )
    mowing_risk: float | None = figure(
        "cost/location",
        "lawnmower bound: map risk expected of a lawnmower mission; of its first steps, if it ended early; null for "
        "part of a team (over part of the locations; beyond 1,000 legs tile by tile)",
    )
    flown_risk: float | None = figure("cost/location", "map risk that the prior expected of the path flown")
    map_bound_promised: bool = figure("", "whether the method guarantees this bound; false if it ended early")
    map_bound_kept: bool | None = figure("", "whether risk_after is at most mowing_risk; null if it ended early")
    loss_expected: float = figure(
        "cost/location",
        "expected loss: mean Bayes risk of the final map with the standard deviation that the soundings show "
        "(gp.std_soundings), as in the published map",
    )
    loss_after: float | None = figure(
        "cost/location",
        "actual loss: mean cost of the final map's wrong calls; equals loss_expected if it is calibrated",
    )
    reliability_error: float | None = figure(
        "", "mean over locations of |share safe - mean P(deep enough)| in the location's class; 0: calibrated"
    )
    reliability_cells: tuple[int, ...] | None = figure(
        "",
        "locations in each class of P(deep enough), the probability of being at least the level deep: tenths, finer "
        "at both ends",
    )
    reliability_expected: tuple[float, ...] | None = figure("", "expected number of safe locations in each class")
    reliability_safe: tuple[int, ...] | None = figure("", "actual number of safe locations in each class")
    deep_m2: float = figure("m2", "area that is at least the level deep with at least 95 % probability")
    shallow_m2: float = figure("m2", "area that is shallower with at least 95 % probability")
    unsure_m2: float = figure("m2", "rest of the area")
    f1: float | None = figure("", "F1 score of 'at least the level deep', on the map from all soundings")
    misclassified_m2: float | None = figure("m2", "area on the wrong side of the level")
    false_safe_m2: float | None = figure("m2", "area called at least the level deep that is shallower")
    false_unsafe_m2: float | None = figure("m2", "area called shallower than the level that is not")
    depth_rmse_m: float | None = figure("m", "root mean square error of the map's depth")
    area_m2: float = figure("m2", "area evaluated: inside the operating area, of known depth")
    unreachable_m2: float = figure("m2", "area left out because vehicles cannot reach it from their starts")
    local_risk: tuple[float, ...] = figure(
        "cost/location",
        "map risk of each vehicle's own final map; from 1,000 centers on, the rest of its mates' samples is taken "
        "together",
    )
    alone_risk: tuple[float, ...] = figure(
        "cost/location", "the same from its own soundings only (over part of the locations)"
    )
    local_risk_error: tuple[float, ...] = figure(
        "cost/location", "per vehicle: mean over the map of |own posterior risk - risk given all soundings|"
    )
    local_f1: tuple[float, ...] | None = figure("", "F1 score of each vehicle's own final map")
    navigation_error_m: tuple[float, ...] | None = figure("m", "per vehicle: RMS horizontal error of its odometry")
    navigation_error_end_m: tuple[float, ...] | None = figure("m", "per vehicle: that error at the end")
    position_error_m: tuple[float, ...] | None = figure(
        "m", "per vehicle: RMS horizontal error of its soundings' positions in the map"
    )
    error_over_std: float | None = figure(
        "", "mean over the map of ((mean - true depth) / standard deviation)^2; 1 is calibrated, less is conservative"
    )
    f1_true_positions: float | None = figure("", "f1 with the soundings at their true positions")
    misclassified_true_positions_m2: float | None = figure("m2", "misclassified_m2 with true positions")
    isobath_error_true_positions_m: float | None = figure("m", "isobath_error_m with true positions")
    distance_m: tuple[float, ...] = figure("m", "per vehicle: distance travelled")
    void_plans: tuple[int, ...] | None = figure("", "per vehicle: plans discarded because impossible")
    outside_s: tuple[float, ...] = figure("s", "per vehicle: time outside the area")
    outside_max_m: tuple[float, ...] = figure("m", "per vehicle: farthest outside")
    min_separation_m: float | None = figure("m", "least horizontal distance of vehicles after 60 s")
    soundings: int = figure("", "soundings of all vehicles")
    samples_received: int = figure("", "samples received from other vehicles")
    packets_sent: int = figure("", "packets sent by all vehicles")
    packets_received: int = figure("", "receptions by all vehicles (each packet can be received by K - 1)")
    packets_lost: int = figure("", "receptions that failed; packets still under way at the end do not count")
    delivery: float | None = figure("", "packets_received / (packets_received + packets_lost); null without packets")
    team_reward: float = figure(
        "cost", "the paper's reward, stepwise: sum of each leg's drop of risk at its own location"
    )
    lower_bound: float | None = figure(
        "cost",
        "the paper's bound on it: running maximum of reward so far + naive part of Jbar (the paper's methods only)",
    )
    bound_kept: bool | None = figure("", "whether team_reward is at least lower_bound (the paper's methods only)")
    path_reward: float = figure(
        "cost",
        "the paper's reward, whole path: drop of risk from no data to all data, summed over the paths' locations",
    )
    path_bound_start: float | None = figure("cost", "path_reward expected of the plans at the start (first joint Jbar)")
    path_bound_max: float | None = figure("cost", "largest path_reward expected of the plans before the last leg")
    lawnmower_value: float = figure("cost", "path_reward expected of a lawnmower mission at the start")
    path_bound_kept: bool | None = figure(
        "", "whether path_reward is at least lawnmower_value (the paper's methods only)"
    )
    planning_median_s: float | None = figure("s", "median wall-clock time of a decision")
    planning_max_s: float | None = figure("s", "longest wall-clock time of a decision")
    sim_s: float = figure("s", "mission time")
    wall_s: float | None = figure("s", "wall-clock time of the mission")

    @classmethod
    def of_known(cls, values: Mapping[str, Any]) -> Summary:
        """A summary in which every key that is missing in `values`, NaN or infinite is None."""
        known: dict[str, Any] = dict.fromkeys(field.name for field in dataclasses.fields(cls))
        known |= {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}
        return cls(**known)

    def to_json(self) -> str:
        """The summary as JSON: NaN and infinity become null."""
        return json.dumps({k: _plain(v) for k, v in dataclasses.asdict(self).items()}, indent=2, allow_nan=False) + "\n"

    def write(self, path: Path) -> None:
        """Writes `summary.json`."""
        path.write_text(self.to_json())


def table() -> list[tuple[str, str, str]]:
    """Rows (key, unit, meaning) of every key, in order."""
    return [(f.name, f.metadata["unit"], f.metadata["help"]) for f in dataclasses.fields(Summary)]


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
