"""The positions and depths of one log, as its reader found them.

A log may hold several kinds of positions and depths. The reader collects all of them, and `Sources.log` takes the first
kind in an order of preference that has any, so that no ping counts twice.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.vocabulary.water import depth_of

Array = NDArray[np.float64]

#: Takes the share of a log that has been read, 0 to 1.
Progress = Callable[[float], None]

#: Share of the lowest pressures of a log whose largest counts as the pressure at the surface.
_SURFACE_SHARE = 0.01


class LogError(ValueError):
    """A log that cannot be imported; names the file and what was expected."""


@dataclass(slots=True, kw_only=True)
class SurveyLog:
    """One log.

    Attributes:
        positions: Rows (time s, latitude deg, longitude deg), or (time s, north m, east m) if not `is_geodetic`.
        depths: Rows (time s, depth of water below the transducer m).
        immersion: Rows (time s, depth of the vehicle m); no rows for a boat.
        is_geodetic: Whether positions are degrees.
        has_time: Whether the log has times; else they only number the soundings.
        position_std_m: Standard deviations north and east (m) that the log states for its positions, (n, 2), NaN where
            unknown; None if it states none. They are of estimated positions, whose errors have much in common.
        depth_std_m: Largest standard deviation (m) that it states for a depth; 0 if it states none.
        left_out: Number of positions and depths that were left out, by reason.
        notes: What the numbers were read from.
    """

    name: str
    positions: Array
    depths: Array
    immersion: Array = field(default_factory=lambda: np.empty((0, 2)))
    is_geodetic: bool = True
    has_time: bool = True
    position_std_m: Array | None = None
    depth_std_m: float = 0.0
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


class Sources:
    """Everything in a log that may be a position, a depth or a pressure.

    Attributes:
        left_out: Number of positions and depths left out, by reason.
        is_submarine: Whether the log is of a vehicle under water, whose own depth has to be added.
    """

    def __init__(self) -> None:
        self._positions: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
        self._depths: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._pressures: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._refused: dict[str, Counter[str]] = defaultdict(Counter)
        self.left_out: Counter[str] = Counter()
        self.is_submarine = False

    def position(self, kind: str, stamp_s: float, lat_deg: float, lon_deg: float) -> None:
        """Adds a position; 0, 0 means none."""
        if lat_deg == 0.0 and lon_deg == 0.0:
            self.refuse(kind, "positions without a fix")
        else:
            self._positions[kind].append((stamp_s, lat_deg, lon_deg))

    def depth(self, kind: str, stamp_s: float, depth_m: float) -> None:
        """Adds a depth below the transducer (m)."""
        self._depths[kind].append((stamp_s, depth_m))

    def pressure(self, kind: str, stamp_s: float, pressure_pa: float) -> None:
        """Adds an absolute pressure (Pa)."""
        self._pressures[kind].append((stamp_s, pressure_pa))

    def refuse(self, kind: str, reason: str) -> None:
        """Counts a value of a kind that is left out."""
        self._refused[kind][reason] += 1

    def log(self, path: Path, positions: Sequence[str], depths: Sequence[str], density_kgpm3: float) -> SurveyLog:
        """The log, from the first kind of positions and of depths that there is.

        Args:
            path: The file.
            positions: Kinds of positions, in order of preference.
            depths: Kinds of depths, in order of preference.
            density_kgpm3: Density of the water, for the depth of a vehicle.

        Raises:
            LogError: if there are no positions or no depths.
        """
        position = _first(path, "positions", positions, self._positions, self._refused)
        ping = _first(path, "depths", depths, self._depths, self._refused)
        fixes = _table(self._positions[position], 3)
        immersion, notes = np.empty((0, 2)), [f"positions from {position}", f"depths from {ping}"]
        if self.is_submarine:
            immersion, gauge = self._immersion(path, float(np.median(fixes[:, 1])), density_kgpm3)
            notes.append(f"the vehicle's own depth from {gauge}, with the lowest pressure as the surface")
        return SurveyLog(
            name=path.name,
            positions=fixes,
            depths=_table(self._depths[ping], 2),
            immersion=immersion,
            left_out=self.left_out + self._refused[position] + self._refused[ping],
            notes=notes,
        )

    def _immersion(self, path: Path, lat_deg: float, density_kgpm3: float) -> tuple[Array, str]:
        """The vehicle's depth from the barometer whose pressure varies most: the water's."""
        tables = {kind: _table(rows, 2) for kind, rows in self._pressures.items()}
        if not tables:
            raise LogError(
                f"{path}: got a submarine's log without pressures; expected BARO or SCALED_PRESSURE messages, because "
                "the vehicle's own depth is part of the water's. Log them"
            )
        kind = max(tables, key=lambda name: float(np.ptp(tables[name][:, 1])))
        found = tables[kind]
        surface_pa = float(np.quantile(found[:, 1], _SURFACE_SHARE))
        depths = [max(depth_of(pa - surface_pa, density_kgpm3, lat_deg), 0.0) for pa in found[:, 1].tolist()]
        return np.column_stack([found[:, 0], depths]), kind


def _first(
    path: Path,
    what: str,
    kinds: Sequence[str],
    found: dict[str, list[tuple[float, float, float]]] | dict[str, list[tuple[float, float]]],
    refused: dict[str, Counter[str]],
) -> str:
    for kind in kinds:
        if found.get(kind):
            return kind
    reasons = [f"{count} {reason}" for kind in kinds for reason, count in refused[kind].items()]
    instead = f" ({', '.join(reasons)})" if reasons else ""
    raise LogError(f"{path}: got no {what}{instead}; expected {' or '.join(kinds)}. Nothing can be mapped without them")


def _table(rows: ArrayLike, columns: int) -> Array:
    """Rows in order of time."""
    table = np.asarray(rows, dtype=float).reshape(-1, columns)
    return table[np.argsort(table[:, 0], kind="stable")]
