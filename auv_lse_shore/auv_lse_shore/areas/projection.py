"""Converts features from the CRS of their file to WGS84 degrees."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array
from auv_lse_shore.areas.features import Feature


def to_degrees(crs: str | None, where: str) -> Callable[[Feature], Feature]:
    """A conversion of features whose corners are (y, x) of `crs`; None: they are in WGS84 degrees.

    Raises:
        ParameterError: if the CRS is not understood.
    """
    if crs is None or crs.upper().replace("::", ":").endswith(("CRS84", "EPSG:4326")):
        return lambda feature: feature
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError

    try:
        transformer = Transformer.from_crs(CRS.from_user_input(crs), "EPSG:4326", always_xy=True)
    except CRSError as error:
        raise ParameterError(
            f"{where}: its coordinate reference system is {crs[:80]!r}, which is not understood. Export it as EPSG:4326"
        ) from error

    def degrees(corners: Array) -> Array:
        longitude, latitude = transformer.transform(corners[:, 1], corners[:, 0])
        return np.column_stack([latitude, longitude])

    def convert(feature: Feature) -> Feature:
        point = feature.point and degrees(np.array([feature.point]))[0]
        return replace(
            feature,
            rings=tuple(map(degrees, feature.rings)),
            line=None if feature.line is None else degrees(feature.line),
            point=None if point is None else (float(point[0]), float(point[1])),
        )

    return convert
