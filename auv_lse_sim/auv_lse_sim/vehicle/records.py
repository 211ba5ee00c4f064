"""Named records that the compiled motion model reads and writes: state, parameters, leg, draws, results.

Each is a NumPy record, so that compiled and plain code use the same names (`state.north`). Units: metres, seconds,
radians; north, east and headings clockwise from north; surge ahead and sway to starboard over ground.
"""

from typing import Any, NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array


def _record(*names: str) -> np.dtype[Any]:
    return np.dtype((np.record, [(name, np.float64) for name in names]))


#: One leg: an arc at the turning radius, then a straight.
LEG = _record("heading", "north", "east", "turn", "radius", "straight")

#: The vehicle's true state and what the model keeps between sub-steps.
STATE = _record(
    "north",
    "east",
    "heading",
    "yaw_rate",  # rad/s
    "speed",  # through the water, m/s
    "depth",
    "surge",
    "sway",
    "along",  # m along the leg
    "mode",  # WAITING, ON_RAILS or STEERED
    "wobble",  # depth keeping error, m
    "dropout",  # seconds left without pings
    "lock_loss",  # seconds left without bottom lock
    "compass_age",  # seconds since the last compass reading
    "gps_age",
    "gyro_bias",  # the true errors of the instruments
    "compass_bias",
    "dvl_scale",
    "compass_sin",  # true harmonics of the compass
    "compass_cos",
    "surface_age",  # seconds since the last surfacing ended
    "travelled",  # m over ground
    "under_way",  # seconds since it set out, stopped or resumed
    "refused",  # DVL pings that the filter refused in a row
    "refused_raw",  # the same for the filter without fixes
    "surfacing",  # NOT_SURFACING, TO_SURFACE or TO_DEPTH
    "time_up",  # seconds spent at the surface in this surfacing
    "dived",  # 1 once it has been below the antenna's depth: later fixes are fixes under way
    "raw_differs",  # 1 once the dead-reckoned position differs from the filter's
    "gps_error_north",  # error of the last GPS reading
    "gps_error_east",
    "gps_north",  # that reading
    "gps_east",
    "north_at_gps",  # the filter's position after it took that reading
    "east_at_gps",
    "raw_north_at_gps",  # the dead-reckoned position at that time
    "raw_east_at_gps",
    "fix_information",  # this surfacing's mean reading minus the dead-reckoned position: inverse variance (1/m^2) ...
    "fix_north",  # ... and weighted sums
    "fix_east",
    "fix_step",  # sub-step, from 1, in which a fix was complete; 0: none
)

#: Parameters from the mission file (`motion_parameters`). `speed` is the true speed through the water when commanded;
#: gyro noise is in rad/sqrt(s), its walk in rad/s/sqrt(s), rates in 1/s; `gps_depth` is the vehicle's depth at which
#: the antenna goes under, `gps_time` the correlation time of the GPS error.
PARAMETERS = _record(
    "dt", "speed", "yaw_rate_max", "yaw_time", "speed_time", "lookahead", "gain", "ideal_motion", "ideal_navigation",
    "depth", "climb_rate", "wobble", "wobble_time", "gyro_noise", "gyro_walk", "compass_noise", "compass_walk",
    "compass_interval", "dvl_noise", "dvl_outlier_share", "dvl_outlier", "dropout_rate", "dropout_min", "dropout_max",
    "lock_loss_rate", "lock_loss_min", "lock_loss_max", "gps_noise", "gps_interval", "gps_depth", "surface_every",
    "surface_time", "gyro_ideal", "compass_ideal", "dvl_ideal", "gps_ideal", "gps_time",
)  # fmt: skip

#: Standard normal numbers of one sub-step.
NORMALS = _record(
    "gyro", "compass", "dvl_surge", "dvl_sway", "gps_north", "gps_east", "wobble", "gyro_walk", "compass_walk",
    "outlier_surge", "outlier_sway",
)  # fmt: skip

#: Uniform numbers in [0, 1) of one sub-step.
UNIFORMS = _record("dropout", "dropout_length", "lock_loss", "lock_loss_length", "outlier")


class Results(NamedTuple):
    """Results of sub-steps by column, an array (n,) each: truth, estimate, and the estimate without fixes ("raw").

    `ping` is 1 where the DVL can ping.
    """

    north: Array
    east: Array
    heading: Array
    depth: Array
    est_north: Array
    est_east: Array
    est_heading: Array
    est_speed: Array
    ping: Array
    travelled: Array
    along: Array
    raw_north: Array
    raw_east: Array
    raw_heading: Array


#: Result of one sub-step.
RESULT = _record(*Results._fields)


class Filter(NamedTuple):
    """The navigation filter: state (10,) and covariance (10, 10), see `navigation.py`; both are changed in place."""

    x: Array
    p: Array


class Model(NamedTuple):
    """State, filters and parameters of a vehicle's motion model.

    Attributes:
        state: Record `STATE`, changed in place.
        estimate: The filter that takes every fix.
        raw: The filter that takes no fix under way, used once the two differ.
        params: Record `PARAMETERS`.
        noise: The filter's process noise (5,).
    """

    state: Any
    estimate: Filter
    raw: Filter
    params: Any
    noise: Array


class Draws(NamedTuple):
    """Random numbers and currents of a tick's sub-steps.

    Attributes:
        normals: Records `NORMALS` (n,).
        uniforms: Records `UNIFORMS` (n,).
        currents: Current north, east (n, 2), m/s.
    """

    normals: Any
    uniforms: Any
    currents: Array


def new_record(kind: np.dtype[Any], *values: float) -> Any:
    """A record of zeros, or of `values` in the order of its fields."""
    record = np.zeros(1, kind).view(np.recarray)[0]
    for name, value in zip(kind.names or (), values, strict=False):
        record[name] = value
    return record


def columns(rows: Any) -> Results:
    """Records `RESULT` (n,) as plain columns: attributes of NumPy's record arrays are slow."""
    return Results(*rows.view(np.float64).view(np.ndarray).reshape(len(rows), len(Results._fields)).T)


def as_records(numbers: Array, kind: np.dtype[Any]) -> Any:
    """Rows (n, fields) of numbers as records (n,), without a copy."""
    return numbers.view(kind).reshape(len(numbers)).view(np.recarray)
