"""The figures of merit of a mission: `summary.json`, each with its unit and meaning.

First what a user wants, the isobath and the map; then what explains it; last the paper's own reward.
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
    """What a mission achieved. None: not known (no truth, no naive part, nothing to compare)."""

    vehicles: int = figure("", "number of vehicles (K)")
    steps: int = figure("", "legs travelled by the vehicle that did most")
    method: str = figure("", "planner.method of the mission")
    seed: int = figure("", "mission.seed")
    isobath_found_m: float = figure("m", "length of the estimated isobath that is found (`judge/certainty.py`)")
    isobath_likely_m: float = figure("m", "length that is likely")
    isobath_guessed_m: float = figure("m", "length that is guessed: the data hardly support it")
    isobath_not_visited_m: float = figure("m", "length not found because nobody measured near it")
    isobath_places_uncertain_m: float = figure("m", "length not found because the vehicles were unsure of their places")
    isobath_flat_m: float = figure("m", "length not found because the ground there is too flat to tell")
    isobath_found: float | None = figure("", "share of the true isobath within 10 m of what was found")
    isobath_found_error_m: float | None = figure("m", "mean distance of what was found from the true isobath")
    isobath_found_error_p95_m: float | None = figure("m", "95th percentile of that distance")
    isobath_made_up: float | None = figure("", "share of what was found farther than 10 m from any true isobath")
    isobath_true_m: float | None = figure("m", "length of the true isobath")
    isobath_error_m: float | None = figure(
        "m",
        "mean distance between the whole estimate, guesses included, and the true isobath, both directions: "
        "compares methods, since missing and made-up pieces count",
    )
    isobath_error_p95_m: float | None = figure("m", "95th percentile of those distances")
    isobath_length_m: float = figure("m", "length of the whole estimate")
    risk_before: float = figure("cost/place", "mean Bayes risk over the map before the mission")
    risk_third: float | None = figure("cost/place", "the same after a third of the steps (over a part of the places)")
    risk_after: float = figure(
        "cost/place",
        "mean Bayes risk over the map given the soundings of all vehicles, by the prior's standard deviation, as "
        "planners account for it and the bound speaks of it",
    )
    mowing_risk: float | None = figure(
        "cost/place", "risk_after as expected before the mission of all vehicles mowing the lawn: the bound"
    )
    map_bound_promised: bool = figure("", "whether the method promises this bound: its planners keep an account of it")
    map_bound_kept: bool | None = figure("", "whether risk_after is at most mowing_risk")
    loss_expected: float = figure(
        "cost/place",
        "what the final map expects its calls to cost: its mean Bayes risk by the standard deviation that the "
        "soundings show (gp.std_soundings), as maps are published and drawn",
    )
    loss_after: float | None = figure(
        "cost/place",
        "mean of the costs really incurred by the final calls; as large as loss_expected if that is honest",
    )
    reliability_error: float | None = figure(
        "", "mean over the map of |share that is safe - mean P(safe)| of a place's class of P(safe); 0 is honest"
    )
    reliability_cells: tuple[float, ...] | None = figure(
        "",
        "places of the map in each class of P(safe), the probability of being at least the level deep; the classes' "
        "limits are those of `judge/reliability.py`",
    )
    reliability_expected: tuple[float, ...] | None = figure("", "how many of them should be safe: their summed P(safe)")
    reliability_safe: tuple[float, ...] | None = figure("", "how many of them are safe")
    deep_m2: float = figure("m2", "area that is at least the level deep with a probability of at least 95 %")
    shallow_m2: float = figure("m2", "area that is shallower with a probability of at least 95 %")
    unsure_m2: float = figure("m2", "the rest of the area judged")
    f1: float | None = figure("", "F1 score of 'at least the level deep', on the map from all soundings")
    misclassified_m2: float | None = figure("m2", "area on the wrong side of the level")
    false_safe_m2: float | None = figure("m2", "area called at least the level deep that is shallower")
    false_unsafe_m2: float | None = figure("m2", "area called shallower than the level that is not")
    depth_rmse_m: float | None = figure("m", "root mean square error of the map's depth")
    area_m2: float = figure("m2", "area judged: inside the operating area, of known depth")
    local_risk: tuple[float, ...] = figure("cost/place", "mean Bayes risk of each vehicle's own final map")
    alone_risk: tuple[float, ...] = figure(
        "cost/place", "the same from its own soundings alone, as if it had heard nobody (over a part of the places)"
    )
    local_risk_error: tuple[float, ...] = figure(
        "cost/place", "per vehicle: mean over the map of |own posterior risk - risk given all soundings|"
    )
    local_f1: tuple[float, ...] | None = figure("", "per vehicle: F1 score of its own final map")
    navigation_error_m: tuple[float, ...] | None = figure("m", "per vehicle: RMS horizontal error of odometry")
    navigation_error_end_m: tuple[float, ...] | None = figure(
        "m", "per vehicle: horizontal error of odometry at the end"
    )
    place_error_m: tuple[float, ...] | None = figure(
        "m", "per vehicle: RMS distance of its soundings, as mapped, from where they were taken"
    )
    error_over_std: float | None = figure(
        "", "mean over the map of ((mean - true depth) / standard deviation)^2; 1 is honest, less is modest"
    )
    f1_true_positions: float | None = figure(
        "", "f1 with the soundings booked at their true positions: without navigation error"
    )
    misclassified_true_positions_m2: float | None = figure("m2", "misclassified_m2 without navigation error")
    isobath_error_true_positions_m: float | None = figure("m", "isobath_error_m without navigation error")
    distance_m: tuple[float, ...] = figure("m", "per vehicle: distance travelled")
    min_separation_m: float | None = figure("m", "least horizontal distance between two vehicles after 60 s")
    soundings: int = figure("", "soundings made by all vehicles")
    samples_received: int = figure("", "team-mates' samples received, all vehicles together")
    packets_sent: int = figure("", "packets sent by all vehicles")
    packets_received: int = figure("", "receptions by all vehicles (a packet can be received by K - 1)")
    delivery: float | None = figure("", "packets_received / (packets_sent (K - 1)); None for a lone vehicle")
    team_reward: float = figure(
        "cost",
        "the paper's reward, stepwise, its literal sum: each leg's drop of Bayes risk at its own place, summed over "
        "legs",
    )
    lower_bound: float | None = figure(
        "cost",
        "the paper's bound on it: running maximum of team reward so far + naive part of Jbar (the paper's methods "
        "only)",
    )
    bound_kept: bool | None = figure("", "whether team_reward is at least lower_bound (the paper's methods only)")
    path_reward: float = figure(
        "cost",
        "the paper's reward, whole path: drop of Bayes risk from no data to all data, summed over all places of the "
        "paths",
    )
    path_bound_start: float | None = figure(
        "cost", "expected path_reward of the plans in hand at the start (Jbar of the first joint plan)"
    )
    path_bound_max: float | None = figure(
        "cost", "largest expected path_reward of the plans in hand before the last leg"
    )
    lawnmower_value: float = figure("cost", "expected path_reward, at the start, of all vehicles mowing the lawn")
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
