"""Encodes a vehicle's map compactly: one byte per cell and layer, as the compressed change since the last map."""

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array

Bytes = NDArray[np.uint8]

#: The byte of a cell outside of the operating area.
OUTSIDE = 255
#: Maximum number of cells of a map on the page; larger maps are thinned.
_MAX_CELLS = 40_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Maps bytes to values: low + byte * step, for bytes 0..254.

    Attributes:
        low: Value of byte 0.
        step: Difference of neighboring bytes' values.
    """

    low: float
    step: float
    unit: str

    def to_bytes(self, values: Array) -> Bytes:
        """The nearest bytes; values beyond the scale take its end, NaN is `OUTSIDE`."""
        steps = np.round((np.nan_to_num(values) - self.low) / self.step)
        return np.where(np.isfinite(values), np.clip(steps, 0, OUTSIDE - 1), OUTSIDE).astype(np.uint8)


def scales_of(level_m: float, largest_risk: float) -> dict[str, Scale]:
    """The scale of each layer of a map.

    Args:
        largest_risk: The largest Bayes risk that a position can have.
    """
    depth_step_m = max(0.1, abs(level_m) / 100.0)
    return {
        "risk": Scale(low=0.0, step=largest_risk / 254.0, unit="cost"),
        "p_safe": Scale(low=0.0, step=1.0 / 254.0, unit=""),
        "depth": Scale(low=level_m - 127.0 * depth_step_m, step=depth_step_m, unit="m"),
        "std": Scale(low=0.0, step=max(0.02, abs(level_m) / 500.0), unit="m"),
    }


class LayerCoder:
    """Encodes the maps of one vehicle, one after another; a reader adds up the changes, modulo 256.

    After a change of size, coder and reader start again from zeros.
    """

    def __init__(self, scales: Mapping[str, Scale]) -> None:
        """Starts with maps of zeros."""
        self._scales = scales
        self._last: Bytes | None = None

    def code(self, layers: Mapping[str, Array]) -> str:
        """The changes of every layer since the last map, one layer after another, each row by row.

        Args:
            layers: Values (rows, columns) of each layer of `scales_of`.

        Returns:
            Base64 of the deflated bytes.
        """
        new = np.stack([scale.to_bytes(layers[name]) for name, scale in self._scales.items()])
        change = new - self._last if self._last is not None and self._last.shape == new.shape else new
        self._last = new
        return base64.b64encode(zlib.compress(change.tobytes(), 6)).decode()


def thinning(rows: int, columns: int) -> int:
    """The step with which rows and columns of a grid are sent to the page."""
    apart = 1
    while (rows // apart) * (columns // apart) > _MAX_CELLS:
        apart += 1
    return apart
