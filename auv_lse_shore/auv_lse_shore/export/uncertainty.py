"""Total uncertainties of soundings and cells, and the order of IHO S-44 that they meet.

S-44 Edition 6.1.0 (October 2022), table 1, limits the total horizontal and vertical uncertainty at 95 % confidence:
THU to c + d * depth, TVU to sqrt(a^2 + (b * depth)^2). Orders 1a and 1b differ in feature detection and coverage only.
An order here means these two limits; detection of features and coverage are not claimed.
"""

from typing import NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.export.survey import Survey, vehicle_depth_m
from auv_lse_shore.judge.team_map import TeamMap

Codes = Ints

#: The edition whose limits are used.
EDITION = "IHO S-44 Edition 6.1.0"
#: 95 % of a normal distribution lies within this many standard deviations.
SIGMAS_95 = 1.96


class Order(NamedTuple):
    """An order's limits at 95 %: THU c + d * depth (m), TVU sqrt(a^2 + (b * depth)^2) (m)."""

    name: str
    a_m: float
    b: float
    c_m: float
    d: float


#: From the least demanding; an order's code is its position, 0 is none.
ORDERS = (
    Order("none", np.inf, 0.0, np.inf, 0.0),
    Order("2", 1.0, 0.023, 20.0, 0.10),
    Order("1a/1b", 0.5, 0.013, 5.0, 0.05),
    Order("special", 0.25, 0.0075, 2.0, 0.0),
    Order("exclusive", 0.15, 0.0075, 1.0, 0.0),
)


def orders_met(thu_m: Array, tvu_m: Array, depth_m: Array) -> Codes:
    """Code of the most demanding order whose limits hold, shape of the arguments; unknown (NaN) uncertainties: 0."""
    codes = np.zeros(np.shape(depth_m), dtype=np.int64)
    depth = np.maximum(depth_m, 0.0)
    for code, order in enumerate(ORDERS[1:], 1):
        met = (thu_m <= order.c_m + order.d * depth) & (tvu_m <= np.hypot(order.a_m, order.b * depth))
        codes[met] = code
    return codes


class SoundingUncertainty(NamedTuple):
    """Uncertainties of soundings, each (n,).

    Attributes:
        thu_m: Total horizontal uncertainty (95 %); NaN where the position's is unknown.
        tvu_m: Total vertical uncertainty (95 %).
        order: Code of the order of S-44.
    """

    thu_m: Array
    tvu_m: Array
    order: Codes


def sounding_uncertainty(run: RunData, vehicle: VehicleRun, survey: Survey, noise_std_m: float) -> SoundingUncertainty:
    """Uncertainties of a vehicle's soundings.

    THU is 1.96 times the root of the position's summed variances. Whatever their correlation, at least 95 % lie within.
    TVU adds the variances of sounder, pressure, sound speed (in proportion to the range) and water level.

    Args:
        survey: The corrections with their uncertainties.
        noise_std_m: Noise of the sounder, where the survey does not give it.
    """
    soundings: Soundings = vehicle.soundings
    position_std, std = vehicle.position_std_at(soundings.stamp_s), survey.std
    range_m = np.maximum(soundings.depth_m - vehicle_depth_m(run, vehicle), 0.0)
    speed = survey.sounder_speed_mps if survey.sound_speed is None else float(survey.sound_speed[:, 1].mean())
    sounder = noise_std_m if std.sounder_m is None else std.sounder_m
    variance = sounder**2 + std.pressure_m**2 + (range_m * std.sound_speed_mps / speed) ** 2 + std.water_level_m**2
    thu, tvu = SIGMAS_95 * np.sqrt((position_std**2).sum(axis=1)), SIGMAS_95 * np.sqrt(variance)
    return SoundingUncertainty(thu, tvu, orders_met(thu, tvu, soundings.depth_m))


def cell_tvu_m(team: TeamMap, survey: Survey) -> Array:
    """Total vertical uncertainty (95 %) of the map's cells, shape (ny, nx).

    To the map's standard deviation, which includes noise and positions of the soundings, it adds what all soundings
    share: water level, pressure and sound speed. A cell's location is exact.
    """
    field, std = team.field, survey.std
    speed = survey.sounder_speed_mps if survey.sound_speed is None else float(survey.sound_speed[:, 1].mean())
    stretched = np.maximum(field.mean_m, 0.0) * std.sound_speed_mps / speed
    return SIGMAS_95 * np.sqrt(field.std_m**2 + std.water_level_m**2 + std.pressure_m**2 + stretched**2)
