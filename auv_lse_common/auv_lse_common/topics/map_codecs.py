"""Encodes and decodes maps: kernel centers, the field on its grid, and messages for viewers."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.topics.codecs import Fields, columns_of, header_fields, time_fields
from auv_lse_common.topics.records import CentersReport, FieldReport
from auv_lse_common.vocabulary.stamps import seconds


def encode_centers(report: CentersReport, vehicle: int) -> Fields:
    """KernelCenters."""
    effect = report.position_effect_m
    return {
        "header": header_fields(report.stamp_s),
        "revision": report.revision,
        "north_m": report.locations_m[:, 0],
        "east_m": report.locations_m[:, 1],
        "depth_m": report.depths_m,
        "noise_std_m": report.noise_std_m,
        "position_modes": 0 if effect is None else effect.shape[1],
        "position_effect_m": np.zeros(0) if effect is None else effect.ravel(),
    }


def _field(message: Any, name: str, default: Any) -> Any:
    """A field of a message, also under its name in older recordings ("place_modes"); `default` if it has neither."""
    return getattr(message, name, getattr(message, name.replace("position", "place"), default))


def decode_centers(message: Any) -> CentersReport:
    """Kernel centers; older recordings have no effects of position errors.

    Raises:
        ValueError: if the message's fields differ in length.
    """
    north, east, depth, noise = columns_of(message, "KernelCenters", ("north_m", "east_m", "depth_m", "noise_std_m"))
    modes = int(_field(message, "position_modes", 0))
    effect = np.asarray(_field(message, "position_effect_m", ()), dtype=float)
    if len(effect) != modes * len(north):
        raise ValueError(
            f"KernelCenters: position_effect_m has {len(effect)} values, not position_modes = {modes} for each "
            f"of {len(north)} centers"
        )
    return CentersReport(
        stamp_s=seconds(message.header.stamp),
        revision=int(message.revision),
        locations_m=np.column_stack([north, east]),
        depths_m=depth,
        noise_std_m=noise,
        position_effect_m=effect.reshape(-1, modes) if modes else None,
    )


def _resolution(north_m: NDArray[Any], east_m: NDArray[Any]) -> float:
    axis = north_m if len(north_m) > 1 else east_m
    return float(axis[1] - axis[0])


#: Steps to which a published depth and its error (m) are rounded. Digits beyond them are noise, which no compression
#: shortens. Risk and probability are rounded to this share of the power of two above the layer's largest value.
DEPTH_STEP_M = 1.0 / 128.0
RISK_STEP = 1.0 / 512.0


def steps_of(field: Any) -> dict[str, float]:
    """The steps to which the layers of a map are rounded in messages, by name."""
    largest = float(np.nanmax(field.risk, initial=0.0))
    above = 2.0 ** math.ceil(math.log2(largest)) if largest > 0.0 else 1.0
    return {"mean_m": DEPTH_STEP_M, "std_m": DEPTH_STEP_M, "risk": RISK_STEP * above, "p_safe": RISK_STEP}


def encode_field(report: FieldReport, vehicle: int) -> Fields:
    """LevelSetField."""
    return {
        "header": header_fields(report.stamp_s),
        "south_m": float(report.north_m[0]),
        "west_m": float(report.east_m[0]),
        "resolution_m": _resolution(report.north_m, report.east_m),
        "rows": len(report.north_m),
        "columns": len(report.east_m),
        "level_m": report.level_m,
        "variance_scale": report.variance_scale,
        **{name: step * np.round(getattr(report, name).ravel() / step) for name, step in steps_of(report).items()},
    }


def decode_field(message: Any) -> FieldReport:
    """A map; in older recordings without `variance_scale` it is 1."""
    shape = (int(message.rows), int(message.columns))
    names = ("mean_m", "std_m", "risk", "p_safe")
    layers = {name: np.asarray(getattr(message, name), dtype=np.float32).reshape(shape) for name in names}
    return FieldReport(
        stamp_s=seconds(message.header.stamp),
        north_m=message.south_m + message.resolution_m * np.arange(shape[0]),
        east_m=message.west_m + message.resolution_m * np.arange(shape[1]),
        level_m=message.level_m,
        variance_scale=getattr(message, "variance_scale", 0.0) or 1.0,
        **layers,
    )


def encode_risk_map(value: tuple[FieldReport, float], vehicle: int) -> Fields:
    """OccupancyGrid of (a map, the largest possible risk): 0 no risk, 100 the largest risk, -1 outside the area."""
    field, largest_risk = value
    resolution = _resolution(field.north_m, field.east_m)
    percent = np.clip(np.round(100.0 * np.nan_to_num(field.risk) / largest_risk), 0, 100)
    corner = {"x": float(field.east_m[0]) - resolution / 2.0, "y": float(field.north_m[0]) - resolution / 2.0}
    return {
        "header": header_fields(field.stamp_s),
        "info": {
            "map_load_time": time_fields(field.stamp_s),
            "resolution": resolution,
            "width": len(field.east_m),
            "height": len(field.north_m),
            "origin": {"position": corner, "orientation": {"w": 1.0}},
        },
        "data": np.where(np.isnan(field.risk), -1, percent).astype(np.int8).ravel(),
    }


#: Markers of an isobath: attribute of the isobath, color (red, green, blue).
MARKERS = (("lines", (0.0, 0.0, 0.0)), ("shallow_edge", (0.9, 0.6, 0.0)), ("deep_edge", (0.0, 0.45, 0.7)))


def encode_isobath(value: tuple[float, int, Any, float], vehicle: int) -> Fields:
    """Marker (LINE_LIST at z = -level) of (stamp (s), index in `MARKERS`, isobath, level (m))."""
    stamp_s, index, isobath, level_m = value
    name, (red, green, blue) = MARKERS[index]
    points: list[Fields] = []
    for line in getattr(isobath, name):
        positions = [{"x": east, "y": north, "z": -level_m} for north, east in line.tolist()]
        points += [end for segment in pairwise(positions) for end in segment]
    return {
        "header": header_fields(stamp_s),
        "ns": name,
        "id": index,
        "type": 5,  # LINE_LIST
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": 1.0},
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
        "points": points,
    }
