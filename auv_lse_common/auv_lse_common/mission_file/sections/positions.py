"""Parameters of the position correction: the section `positions` of a mission file."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from auv_lse_common.mission_file.methods import unless_paper_method
from auv_lse_common.mission_file.parameters import configuration, parameter, section


@configuration
class PositionsConfig:
    """Position correction, and the prior accuracy of dead reckoning, clocks and instruments."""

    correct: bool | None = parameter(
        None,
        help="Whether soundings move to positions corrected with fixes, ranges and terrain matching. Left out: yes, "
        "but not with the paper's methods",
    )
    terrain: bool = parameter(True, help="Whether to use terrain matching: tracks that cross measured the same depth")
    interval_s: float = parameter(
        30.0,
        above=0.0,
        high=1e6,
        unit="s",
        help="Time between corrections; twice as long once a mission has lasted 24 times `positions.knot_s`, "
        "unless a fix comes",
    )
    moved_m: float = parameter(
        1.0,
        low=0.0,
        high=1e3,
        unit="m",
        help="The map's centers follow a correction that moves one of them by more than this",
    )
    start_std_m: float = parameter(
        1.0,
        above=0.0,
        high=10e3,
        unit="m",
        help="Standard deviation of the dead-reckoned position at the start, each axis (GPS)",
    )
    heading_std_deg: float = parameter(
        0.71,
        above=0.0,
        high=180.0,
        unit="deg",
        help="Standard deviation of the heading bias: 0.71 times the compass's",
    )
    harmonic_std_deg: float = parameter(
        0.2,
        above=0.0,
        high=180.0,
        unit="deg",
        help="Standard deviation of the heading errors proportional to its sine and cosine (iron aboard): what the "
        "vehicle's filter leaves of them",
    )
    scale_std: float = parameter(0.003, above=0.0, high=0.5, help="Standard deviation of the DVL's scale error")
    heading_walk_deg_rth: float = parameter(
        0.5, low=0.0, high=1e3, unit="deg/sqrt(h)", help="Random walk of the heading error; 0: none"
    )
    position_walk_m_rts: float = parameter(
        0.1,
        low=0.0,
        high=100.0,
        unit="m/sqrt(s)",
        help="Random walk of the dead-reckoned position in addition; 0: none",
    )
    knot_s: float = parameter(200.0, above=0.0, high=1e6, unit="s", help="Time between the knots of these two walks")
    fix_std_m: float = parameter(
        1.0,
        above=0.0,
        high=10e3,
        unit="m",
        help="Standard deviation of a position fix, each axis; a surfacing counts as one",
    )
    range_std_m: float = parameter(
        1.0, above=0.0, high=10e3, unit="m", help="Standard deviation of a range between vehicles"
    )
    clock_std_s: float = parameter(
        1e-3, above=0.0, high=10.0, unit="s", help="Standard deviation of a vehicle's clock error at the start"
    )
    clock_drift_std_ppm: float = parameter(
        1.0, above=0.0, high=1000.0, unit="ppm", help="Standard deviation of a clock's rate error"
    )
    sound_speed_mps: float = parameter(
        1500.0, low=1300.0, high=1700.0, unit="m/s", help="Speed of sound that converts travel times to ranges"
    )
    sound_speed_std: float = parameter(
        0.003, above=0.0, high=0.1, help="Standard deviation of the relative error of the speed of sound"
    )


def positions_of(parameters: Mapping[str, Any], where: str) -> PositionsConfig:
    """The section `positions` of nested parameters, with the default of `correct` resolved.

    Raises:
        ParameterError: naming the invalid parameter.
    """
    return in_force(section(PositionsConfig, parameters, "positions", where), parameters)


def in_force(config: PositionsConfig, parameters: Mapping[str, Any]) -> PositionsConfig:
    """The section with the default of `correct` resolved for the planning method in `parameters`."""
    return dataclasses.replace(config, correct=unless_paper_method(config.correct, parameters))
