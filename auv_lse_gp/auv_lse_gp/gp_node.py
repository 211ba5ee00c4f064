"""Keeps a vehicle's map: soundings and team samples in, kernel centres, field, risk and isobath out."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid
from visualization_msgs.msg import Marker

from auv_lse_common.lockstep import Gate
from auv_lse_common.params import section
from auv_lse_common.ros_conversions import EVERY, LATCHED, ConfiguredNode, diagnostics, run, seconds
from auv_lse_gp.area import AreaConfig, OperatingArea
from auv_lse_gp.config import GpConfig
from auv_lse_gp.depth_map import DepthMap
from auv_lse_gp.risk import LevelSet
from auv_lse_gp.ros_conversions import (
    centers_message,
    field_message,
    isobath_markers,
    risk_map_message,
    sample_rows,
    sounding_row,
)
from auv_lse_msgs.msg import KernelCenters, LevelSetField, LockstepDone, LockstepTick, SampleArray, Sounding

_STEP_PERIOD_S = 0.1


class GpNode(ConfiguredNode):
    """gp_node: the map of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the map from the parameters and wires the topics."""
        super().__init__("gp_node")
        config = section(GpConfig, self.parameters, "gp", self.where)
        level_set = section(LevelSet, self.parameters, "level_set", self.where)
        area = section(AreaConfig, self.parameters, "area", self.where)
        self._map = DepthMap(config, level_set, OperatingArea(area))
        self._period_s = config.publish_period_s
        self.show_parameters({"gp": config, "level_set": level_set, "area": area})

        self._soundings: list[Sounding] = []
        self._samples: list[SampleArray] = []
        self._published_revision = -1
        self._published_s = -float("inf")
        self._update_s = 0.0
        self._centers = self.create_publisher(KernelCenters, "kernel_centers", LATCHED)
        self._field = self.create_publisher(LevelSetField, "field", LATCHED)
        self._risk = self.create_publisher(OccupancyGrid, "risk_map", LATCHED)
        self._isobath = self.create_publisher(Marker, "isobath", EVERY)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", EVERY)
        self.create_subscription(Sounding, "sounding", self._on_sounding, EVERY)
        self.create_subscription(SampleArray, "team/samples", self._on_samples, EVERY)
        self._gate = Gate(("soundings", "samples"))
        self._tick_s: dict[int, float] = {}
        if self.lockstep:
            self._done = self.create_publisher(LockstepDone, "lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
            self.create_subscription(LockstepDone, "lockstep/done", self._on_done, EVERY)
            readers = {self._done: 4, self._centers: 1 + self.recorded, self._field: self.recorded}
            readers |= {self._risk: self.recorded, self._isobath: self.recorded, self._diagnostics: self.recorded}
            self.when_matched(readers, lambda: self._done.publish(LockstepDone(node="gp", vehicle=self.vehicle)))
        else:
            self.create_timer(_STEP_PERIOD_S, lambda: self.step(self.now_s()))

    def _on_sounding(self, message: Sounding) -> None:
        self._soundings.append(message)
        self._gate.count("soundings")
        self._advance()

    def _on_samples(self, message: SampleArray) -> None:
        self._samples.append(message)
        self._gate.count("samples")
        self._advance()

    def _on_tick(self, message: LockstepTick) -> None:
        self._tick_s[message.tick] = seconds(message.stamp)
        self._gate.announce(message.tick, "soundings", message.soundings[self.vehicle - 1])
        self._advance()

    def _on_done(self, message: LockstepDone) -> None:
        if message.node == "modem":
            self._gate.announce(message.tick, "samples", message.second)
            self._advance()

    def _advance(self) -> None:
        """Lockstep: handles the next tick once all that belongs to it is here."""
        tick = self._gate.ready() if self.lockstep else None
        if tick is not None:
            self.step(self._tick_s.pop(tick))
            self._gate.handled(tick)
            revisions = self._published_revision
            self._done.publish(LockstepDone(node="gp", vehicle=self.vehicle, tick=tick, first=revisions))

    def step(self, now_s: float) -> None:
        """Takes what has come in, own soundings first, and publishes what it changed."""
        began = time.perf_counter()
        taken = len(self._soundings) + len(self._samples)
        if self._soundings:
            self._map.add_soundings([sounding_row(m) for m in self._soundings])
            self._soundings.clear()
        for message in sorted(self._samples, key=lambda m: (seconds(m.header.stamp), m.source)):
            try:
                self._map.add_samples(sample_rows(message))
            except ValueError as error:
                self.get_logger().warning(str(error))
        self._samples.clear()
        if self._map.revision != self._published_revision:
            self._published_revision = self._map.revision
            self._centers.publish(centers_message(now_s, self._map.revision, self._map.centers))
        if taken:
            self._update_s = time.perf_counter() - began
        if now_s - self._published_s >= self._period_s or now_s < self._published_s:
            self._published_s = now_s
            self._publish_maps(now_s)

    def _publish_maps(self, now_s: float) -> None:
        began = time.perf_counter()
        field = self._map.field()
        level = self._map.level_set
        self._field.publish(field_message(now_s, field, level.level_m))
        largest = level.cost_false_safe * level.cost_false_unsafe / (level.cost_false_safe + level.cost_false_unsafe)
        self._risk.publish(risk_map_message(now_s, field, largest))
        for marker in isobath_markers(now_s, self._map.isobath(), level.level_m):
            self._isobath.publish(marker)
        counts = self._map.counts
        refused = counts.refused > 0
        values = {
            "centers": len(self._map.gp),
            "kept": counts.kept,
            "too_close": counts.too_close,
            "merged": counts.merged,
            "outliers": counts.outliers,
            "refused": counts.refused,
            "last_refused": self._map.last_problem,
            "update_ms": f"{1e3 * self._update_s:.2f}",
            "map_ms": f"{1e3 * (time.perf_counter() - began):.2f}",
        }
        level_of = DiagnosticStatus.WARN if refused else DiagnosticStatus.OK
        text = f"{counts.refused} soundings refused" if refused else "ok"
        self._diagnostics.publish(diagnostics(now_s, self.get_fully_qualified_name(), level_of, text, values))


def main() -> int:
    """Entry point of `ros2 run auv_lse_gp gp_node`."""
    return run(GpNode)
