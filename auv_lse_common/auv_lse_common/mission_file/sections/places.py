"""Parameters of the correction of places: the section `places` of a mission file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from auv_lse_common.mission_file.methods import unless_paper_method
from auv_lse_common.mission_file.parameters import parameter, section


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class PlacesConfig:
    """What is corrected, and how well dead reckoning, clocks and instruments are known before a mission."""

    correct: bool | None = parameter(
        None,
        help="Whether soundings are booked anew where fixes, ranges and the terrain say that they were taken. Left "
        "out: yes, but not with the paper's methods (planner.method augmented, exponential_quadratic, plain).",
    )
    terrain: bool = parameter(True, help="Whether crossings of tracks count: the same ground has the same depth.")
    interval_s: float = parameter(30.0, above=0.0, unit="s", help="Time between corrections.")
    moved_m: float = parameter(
        1.0, low=0.0, unit="m", help="Soundings are booked anew when a correction moves one of them by more than this."
    )
    start_std_m: float = parameter(
        1.0, above=0.0, unit="m", help="Standard deviation of the raw place at the start, each axis (GPS before it)."
    )
    heading_std_deg: float = parameter(
        0.71,
        above=0.0,
        unit="deg",
        help="The same of the heading's bias under way: 0.71 of the compass's, whose start is fixed by it.",
    )
    harmonic_std_deg: float = parameter(
        1.0,
        above=0.0,
        unit="deg",
        help="The same of the heading's errors that go with its sine and cosine (iron aboard).",
    )
    scale_std: float = parameter(0.003, above=0.0, high=0.5, help="The same of the DVL's scale.")
    heading_walk_deg_rth: float = parameter(
        0.5, low=0.0, unit="deg/sqrt(h)", help="Random walk of the heading's error; 0: none."
    )
    place_walk_m_rts: float = parameter(
        0.02, low=0.0, unit="m/sqrt(s)", help="Random walk of the raw place beyond all of this; 0: none."
    )
    knot_s: float = parameter(200.0, above=0.0, unit="s", help="Time between the knots of these two walks.")
    fix_std_m: float = parameter(
        1.0, above=0.0, unit="m", help="Standard deviation of a fix, each axis; one surfacing counts as one fix."
    )
    range_std_m: float = parameter(1.0, above=0.0, unit="m", help="Standard deviation of one range between vehicles.")
    clock_std_s: float = parameter(
        1e-3, above=0.0, high=10.0, unit="s", help="Standard deviation of one vehicle's clock at the start."
    )
    clock_drift_std_ppm: float = parameter(
        1.0, above=0.0, high=1000.0, unit="ppm", help="Standard deviation of one clock's rate."
    )
    sound_speed_mps: float = parameter(
        1500.0, low=1300.0, high=1700.0, unit="m/s", help="Speed of sound that travel times are made ranges with."
    )
    sound_speed_std: float = parameter(
        0.003, above=0.0, high=0.1, help="Standard deviation of its error, as a share of it."
    )


def places_of(parameters: Mapping[str, Any], where: str) -> PlacesConfig:
    """The section `places` of nested parameters, with `correct` as it is in force.

    Raises:
        ParameterError: naming the parameter that cannot be used.
    """
    return in_force(section(PlacesConfig, parameters, "places", where), parameters)


def in_force(config: PlacesConfig, parameters: Mapping[str, Any]) -> PlacesConfig:
    """The section with `correct` as it is in force where `parameters` name the method."""
    return dataclasses.replace(config, correct=unless_paper_method(config.correct, parameters))
