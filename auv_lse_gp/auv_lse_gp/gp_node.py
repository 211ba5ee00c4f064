"""gp_node keeps a vehicle's map: soundings and team samples in; kernel centers, field, risk and isobath out."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from visualization_msgs.msg import Marker

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.places import places_of
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.support import compiled
from auv_lse_common.topics.ros_conversions import (
    dead_reckoning_from_message,
    dead_reckoning_message,
    diagnostics,
    fix_from_message,
    mate_navigation_from_message,
    raw_sounding_row,
    seconds,
)
from auv_lse_common.vocabulary.health import Recent
from auv_lse_gp.compiled.modules import compiled_gp, compiled_risk
from auv_lse_gp.health import map_health, map_totals
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.places.position_corrector import corrector_for
from auv_lse_gp.ros_conversions import (
    centers_message,
    field_message,
    isobath_markers,
    risk_map_message,
    sample_rows,
)
from auv_lse_msgs.msg import Fix, KernelCenters, LevelSetField, MateNavigation, SampleArray, Sounding


class GpNode(VehicleNode):
    """gp_node: the map of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the map from the parameters and wires the topics."""
        super().__init__("gp_node")
        config = section(GpConfig, self.parameters, "gp", self.where)
        level_set = section(LevelSet, self.parameters, "level_set", self.where)
        area = section(AreaConfig, self.parameters, "area", self.where)
        self._map = DepthMap(config, level_set, OperatingArea(area))
        places = places_of(self.parameters, self.where)
        self._intake = MapIntake(self._map, corrector_for(self.vehicle, places, self._map))
        self._period_s = config.publish_period_s
        self.show_parameters({"gp": config, "level_set": level_set, "area": area, "places": places})
        self._revisions = 0  # number of revisions published, which count from 0
        self._places = 0  # number of corrected positions published
        self._placed_s = -float("inf")
        self._published_s = -float("inf")
        self._update_s = 0.0
        self._recent = Recent()
        self._centers = self.publisher(KernelCenters, "kernel_centers")
        self._corrected = self.publisher(Odometry, "corrected")
        self._field = self.publisher(LevelSetField, "field")
        self._risk = self.publisher(OccupancyGrid, "risk_map")
        self._isobath = self.publisher(Marker, "isobath")
        self._diagnostics = self.publisher(DiagnosticArray, "diagnostics")
        self.listen(Sounding, "sounding", lambda m: self._intake.add_soundings([raw_sounding_row(m)]))
        self.listen(
            Odometry, "dead_reckoning", lambda m: self._intake.add_dead_reckoning(dead_reckoning_from_message(m))
        )
        self.listen(Fix, "fix", lambda m: self._intake.add_fix(fix_from_message(m)))
        self.listen(
            MateNavigation, "team/navigation", lambda m: self._intake.add_navigation(mate_navigation_from_message(m))
        )
        self.listen(SampleArray, "team/samples", self._on_samples)
        self.phase("gp", self.step, lambda: (self._revisions, self._places))
        for kind, *values in self.journal.records:
            if kind == "step":
                waiting, now_s = values
                self._intake.put_back(waiting)
                self._intake.step(now_s)
        self.begin()

    def _on_samples(self, message: SampleArray) -> None:
        try:
            self._intake.add_samples(seconds(message.header.stamp), message.source, sample_rows(message))
        except ValueError as error:
            self.get_logger().warning(str(error))

    def step(self, now_s: float) -> None:
        """Takes new inputs and publishes what changed."""
        began = time.perf_counter()
        waiting = self._intake.waiting() if self.journal.kept else {}
        taken = self._intake.step(now_s)
        if waiting:  # only now: inputs that crash the map must not come back at every start
            self.journal.write("step", waiting, now_s)
        if self._map.revision + 1 != self._revisions:
            self._revisions = self._map.revision + 1
            self._centers.publish(centers_message(now_s, self._map.revision, self._map.centers))
        place = None if self._intake.corrector is None else self._intake.corrector.place
        if place is not None and place.stamp_s != self._placed_s:
            self._placed_s, self._places = place.stamp_s, self._places + 1
            self._corrected.publish(dead_reckoning_message(place, self.vehicle))
        if taken:
            self._update_s = time.perf_counter() - began
        if now_s - self._published_s >= self._period_s or now_s < self._published_s:
            self._published_s = now_s
            self._publish_maps(now_s)

    def _publish_maps(self, now_s: float) -> None:
        began = time.perf_counter()
        field, level_set = self._map.field(), self._map.level_set
        self._field.publish(field_message(now_s, field, level_set.level_m))
        self._risk.publish(risk_map_message(now_s, field, level_set.largest_risk))
        for marker in isobath_markers(now_s, self._map.isobath(), level_set.level_m):
            self._isobath.publish(marker)
        took_s, intake = time.perf_counter() - began, self._intake
        recent = self._recent.of(now_s, map_totals(self._map, intake.gate.counts))
        quiet_s = now_s - intake.sounded_s
        health = map_health(self._map, self._update_s, took_s, intake.gate.counts, recent, intake.corrector, quiet_s)
        self._diagnostics.publish(diagnostics(now_s, self.get_fully_qualified_name(), self.with_journal(health)))


def prepare() -> None:
    """Loads the compiled code, so that processes forked later have it."""
    if compiled.USE_NUMBA:
        compiled_gp()
        compiled_risk()


#: Entry point of `ros2 run auv_lse_gp gp_node`.
main = Main(GpNode)
