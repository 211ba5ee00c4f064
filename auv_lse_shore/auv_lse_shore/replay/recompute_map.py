"""Recomputes a vehicle's map from its recorded inputs."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.topics.map_codecs import steps_of
from auv_lse_common.topics.records import CentersReport, FieldReport
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition, DeadReckoning, Fix, MateNavigation
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.position_corrector import corrector_for
from auv_lse_shore.replay.inputs import Pending, VehicleInputs, ticks_of

#: Without lockstep a node may have received a sounding this much earlier (s) than the recorder.
_AHEAD_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MapStep:
    """A published map compared with the recomputed one; differences are the largest over the cells.

    Attributes:
        now_s: Mission time.
        centers: Number of kernel centers, recorded and recomputed.
        mean_m: Largest difference of the mean depth.
        std_m: Largest difference of its standard deviation.
        risk: Largest difference of the risk.
        at_m: North, east (m) of the largest difference of the mean.
        note: What else differs.
        differs: Whether the maps differ.
    """

    vehicle: int
    now_s: float
    centers: tuple[int, int]
    mean_m: float
    std_m: float
    risk: float
    at_m: tuple[float, float]
    note: str
    differs: bool

    TITLES = (
        "vehicle",
        "time (s)",
        "centers",
        "centers now",
        "mean differs by (m)",
        "std by (m)",
        "risk by",
        "at (m)",
        "note",
    )

    @property
    def cells(self) -> tuple[str, ...]:
        """One row of the table."""
        at = f"{self.at_m[0]:.0f}, {self.at_m[1]:.0f}" if self.mean_m > 0.0 else ""
        values = (f"{v:.3g}" for v in (self.mean_m, self.std_m, self.risk))
        counts = (str(n) for n in self.centers)
        return (f"auv{self.vehicle}", f"{self.now_s:.1f}", *counts, *values, at, self.note)


class RecomputedMap:
    """The map of one vehicle, advanced in time."""

    def __init__(
        self, inputs: VehicleInputs, settings: PlannerSettings, positions: PositionsConfig, lockstep: bool
    ) -> None:
        """Starts with the prior.

        Args:
            settings: The current parameters.
            lockstep: Whether the mission flew in lockstep.
        """
        self.map = DepthMap(settings.gp, settings.level_set, OperatingArea(settings.area))
        self._intake = MapIntake(self.map, corrector_for(inputs.vehicle, positions, self.map))
        self._lockstep = lockstep
        self._soundings, self._samples = Pending(inputs.soundings), Pending(inputs.samples)
        self._navigation = Pending(inputs.navigation)

    @property
    def position(self) -> CorrectedPosition | None:
        """The vehicle's corrected position; None while positions are not corrected."""
        return None if self._intake.corrector is None else self._intake.corrector.position

    def advance(self, now_s: float, revision: int | None = None) -> None:
        """Applies the inputs up to `now_s` (s); without lockstep, until the map has the recorded `revision`."""
        if self._lockstep:
            self._take(now_s)
            return
        while revision is None or self.map.revision < revision:
            next_s = min(self._soundings.next_s, self._samples.next_s)
            if next_s == math.inf or next_s > now_s + (_AHEAD_S if revision is not None else 0.0):
                return
            self._take(next_s)

    def _take(self, until_s: float) -> None:
        """One step of the node, with the inputs up to `until_s` (s)."""

        def is_due(received_s: float, value: object) -> bool:
            return received_s <= until_s + 1e-9

        for entry in self._navigation.take(is_due):
            match entry:
                case DeadReckoning():
                    self._intake.add_dead_reckoning(entry)
                case Fix():
                    self._intake.add_fix(entry)
                case MateNavigation():
                    self._intake.add_navigation(entry)
        self._intake.add_soundings(self._soundings.take(is_due))
        for samples in self._samples.take(is_due):
            for packet in samples.packets():
                self._intake.add_samples(float(packet.stamp_s[0]), int(packet.vehicle[0]), packet.points_m)
        self._intake.step(until_s)


def recompute_map(
    inputs: VehicleInputs,
    settings: PlannerSettings,
    positions: PositionsConfig,
    lockstep: bool,
    tolerance: float,
    show: Callable[[float], None],
) -> list[MapStep]:
    """Compares every published map with the one recomputed from the same inputs.

    Args:
        settings: The current parameters.
        lockstep: Whether the mission flew in lockstep.
        tolerance: Relative difference that is ignored, in addition to the rounding of published maps.
        show: Called with the share done, 0 to 1.
    """
    again, rows = RecomputedMap(inputs, settings, positions, lockstep), []
    recorded: CentersReport | None = None
    note = ""
    events: list[tuple[float, int, object]] = [(s, 0, entry) for s, entry in inputs.centers]
    events += [(m.stamp_s, 1, m) for m in inputs.maps]
    events += [(s, -1, None) for s in ticks_of(inputs)] if lockstep else []
    events.sort(key=lambda event: event[:2])
    for number, (now_s, _, event) in enumerate(events):
        show(number / len(events))
        if event is None:
            again.advance(now_s)
        elif isinstance(event, FieldReport):
            if not lockstep:
                again.advance(now_s, None if not inputs.centers else again.map.revision)
            rows.append(_compared(inputs.vehicle, event, again.map, recorded, note, tolerance))
            note = ""
        elif isinstance(event, CentersReport):
            recorded = event
            again.advance(now_s, recorded.revision)
            if lockstep:  # else a node may have taken several inputs at once, and only the maps can be compared
                note = note or _centers_note(now_s, recorded, again.map)
    return rows


def _centers_note(now_s: float, recorded: CentersReport, depth_map: DepthMap) -> str:
    """How the recomputed kernel centers differ from those published; "" if they do not."""
    now = depth_map.centers
    if len(now) == len(recorded.depths_m) and all(
        np.array_equal(getattr(now, name), getattr(recorded, name))
        for name in ("locations_m", "depths_m", "noise_std_m")
    ):
        return ""
    if len(now) != len(recorded.depths_m):
        return f"since {now_s:.1f} s: {len(now)} centers, not {len(recorded.depths_m)} (revision {recorded.revision})"
    apart = np.hypot(*(now.locations_m - recorded.locations_m).T)
    if not np.allclose(apart, 0.0, atol=1e-6):
        return f"since {now_s:.1f} s: a center is {apart.max():.2g} m off"
    off = np.abs(now.depths_m - recorded.depths_m).max() if len(now) else 0.0
    return f"since {now_s:.1f} s: a center's depth is {off:.2g} m off" if off > 1e-6 else ""


def _compared(
    vehicle: int,
    published: FieldReport,
    depth_map: DepthMap,
    recorded: CentersReport | None,
    note: str,
    tolerance: float,
) -> MapStep:
    field, centers = depth_map.field(), len(depth_map.centers)
    counts = (centers if recorded is None else len(recorded.depths_m), centers)
    if field.mean_m.shape != published.mean_m.shape:
        return MapStep(
            vehicle=vehicle, now_s=published.stamp_s, centers=counts, mean_m=np.inf, std_m=np.inf, risk=np.inf,
            at_m=(np.nan, np.nan), differs=True,
            note=f"{field.mean_m.shape} cells, not {published.mean_m.shape}",
        )  # fmt: skip
    largest, differs = {}, counts[0] != counts[1] or bool(note)
    at = (np.nan, np.nan)
    steps = steps_of(field)
    for name in ("mean_m", "std_m", "risk"):
        now, then = getattr(field, name).astype(np.float32), getattr(published, name)
        apart = np.where(np.isnan(now) & np.isnan(then), 0.0, np.abs(now.astype(float) - then.astype(float)))
        apart[np.isnan(apart)] = np.inf
        apart = np.maximum(apart - 0.5 * steps[name], 0.0)  # published maps are rounded
        allowed = (tolerance + np.finfo(np.float32).eps) * np.nanmax(np.abs(then), initial=1.0)
        largest[name] = float(apart.max())
        differs |= largest[name] > allowed
        if name == "mean_m":
            row, column = np.unravel_index(int(apart.argmax()), apart.shape)
            at = (float(field.grid.north_m[row]), float(field.grid.east_m[column]))
    return MapStep(
        vehicle=vehicle, now_s=published.stamp_s, centers=counts, at_m=at, note=note, differs=differs, **largest
    )
