"""gp_node: maintains a vehicle's map from soundings and team samples; publishes centers, field, risk and isobath."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import time
from pathlib import Path

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import UNWATCHED_PERIODS, GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.mission_file.sections.positions import positions_of
from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.periodic import Periodic
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.support import compiled
from auv_lse_common.support.free_memory import return_free_memory
from auv_lse_common.topics.map_codecs import MARKERS
from auv_lse_common.topics.records import CentersReport, FieldReport, RunReport
from auv_lse_common.vocabulary.health import Recent
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.compiled.modules import compiled_gp, compiled_risk
from auv_lse_gp.health import map_health, map_totals
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_gp.map.quality_watch import QualityWatch, slices
from auv_lse_gp.positions.position_corrector import corrector_for
from auv_lse_gp.soundings import origin_problem

#: Lockstep: time (s) between the slices of a judgement, for the node to handle messages.
_SLICES_S = 0.001


class GpNode(VehicleNode):
    """gp_node: the map of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        super().__init__("gp_node")
        config = section(GpConfig, self.parameters, "gp", self.where)
        level_set = section(LevelSetConfig, self.parameters, "level_set", self.where)
        area = section(AreaConfig, self.parameters, "area", self.where)
        operating_area = OperatingArea(area)
        self._map = DepthMap(config, level_set, operating_area)
        if config.mean == "survey" and (problem := origin_problem(Path(config.survey_file), area)):
            raise ParameterError(f"{self.where}: gp.survey_file: {problem}")
        positions = positions_of(self.parameters, self.where)
        until = section(MissionConfig, self.parameters, "mission", self.where).until
        watch = QualityWatch.of(config, level_set, operating_area, until)
        self._intake = MapIntake(self._map, corrector_for(self.vehicle, positions, self._map), watch)
        self._is_running = False  # whether the mission is running
        self._slices_per_step = slices(section(SimConfig, self.parameters, "sim", self.where).tick_s)
        self._slices = 0  # lockstep: slices of a judgement still to be done in this tick
        self._judged = 0  # number of judgements published
        self._maps = Periodic(self._map.publish_period_s)
        self._unwatched_maps = Periodic(UNWATCHED_PERIODS * self._map.publish_period_s)
        self._reports = Periodic(config.publish_period_s)
        self._maps_took_s = 0.0
        self._is_over = self._is_final_map_due = False  # the mission is over; its final map is not published yet
        self.show_parameters({"gp": config, "level_set": level_set, "area": area, "positions": positions})
        recording = section(RecordConfig, self.parameters, "record", self.where)
        self._is_rationed = recording.map_bytes_per_s > 0.0
        self._revisions = 0  # number of revisions published, which count from 0
        self._positions = 0  # number of corrected positions published
        self._placed_s = -float("inf")
        self._update_s = 0.0
        self._recent = Recent()
        self._centers = self.publisher("kernel_centers")
        self._corrected = self.publisher("corrected")
        self._quality = self.publisher("map/quality")
        self._field = self.publisher("field")
        self._risk = self.publisher("risk_map")
        self._isobath = self.publisher("isobath")
        self.listen("sounding", lambda sounding: self._intake.add_soundings([sounding]), needed=True)
        self.listen("dead_reckoning", self._intake.add_dead_reckoning, needed=self._intake.corrector is not None)
        self.listen("fix", self._intake.add_fix)
        self.listen("team/navigation", self._intake.add_navigation)
        self.listen("team/samples", self._on_samples)
        self.listen("mission/state", self._on_state)
        self.phase("gp", self.step, lambda: (self._revisions, self._positions, self._judged))
        self._slicer = self.create_timer(_SLICES_S, self._judge_on)
        self._slicer.cancel()
        with self.journal.restoring():
            self._intake.restore(self.journal.records)
        self.begin()

    def _on_samples(self, samples: Soundings) -> None:
        for packet in samples.packets():
            self._intake.add_samples(float(packet.stamp_s[0]), int(packet.vehicle[0]), packet.points_m)

    def _on_state(self, report: RunReport) -> None:
        self._is_running = report.status.state is RunState.RUNNING
        is_over = report.status.state in (RunState.ENDED, RunState.ABORTED)
        self._is_final_map_due |= is_over and not self._is_over
        self._is_over = is_over

    def step(self, now_s: float) -> None:
        """Applies new inputs and publishes changes."""
        began = time.perf_counter()
        write = self.journal.write if self.journal.kept else None
        taken = self._intake.step(now_s) if write is None else self._intake.step_in_journal(now_s, write)
        # only a recorder reads the centers in another process, and it needs them with a map only
        keep_back = self.lockstep and self._is_rationed and self._centers.readers <= self.recorded
        if self._map.revision + 1 != self._revisions:
            self._revisions = self._map.revision + 1
            self._centers.publish(_centers_report(now_s, self._map), keep_back=keep_back)
        elif not keep_back:  # there is another reader now
            self._centers.send_kept_back()
        position = None if self._intake.corrector is None else self._intake.corrector.position
        if position is not None and position.stamp_s != self._placed_s:
            self._placed_s, self._positions = position.stamp_s, self._positions + 1
            self._corrected.publish(position)
        if taken:
            self._update_s = time.perf_counter() - began
        self._judge(now_s)
        if self._is_final_map_due or self._is_map_due(now_s):
            self._maps.done(now_s)
            self._unwatched_maps.done(now_s)
            self._is_final_map_due = False
            self._publish_maps(now_s)
        if self._reports.is_due(now_s):
            self._reports.done(now_s)
            self._publish_health(now_s)

    def _judge(self, now_s: float) -> None:
        """Does one slice of a judgement of the map; in lockstep this tick's other slices follow in other callbacks."""
        quality = self._intake.judge(now_s, self._is_running, self.journal.write if self.journal.kept else None)
        if quality is not None:
            self._judged += 1
            self._quality.publish(quality)
        if self.lockstep and self._intake.watch is not None and self._intake.watch.is_judging:
            self._slices = self._slices_per_step - 1
            self._slicer.reset()

    def _judge_on(self) -> None:
        """Does one more slice in this tick of lockstep."""
        self._slices -= 1
        quality = self._intake.judge(self.now_s(), self._is_running)
        if quality is not None:
            self._judged += 1
            self._quality.publish(quality)
            self._slices = 0
        if self._slices <= 0:
            self._slicer.cancel()
            self.wake()

    def settled(self) -> bool:
        """Lockstep: whether this tick's share of a judgement is done."""
        return self._slices <= 0

    def _is_map_due(self, now_s: float) -> bool:
        """Whether to compute a map now: not without readers, and less often for the recorder alone."""
        if not self._maps.is_due(now_s):
            return False
        readers = max(publisher.readers for publisher in (self._field, self._risk, self._isobath))
        if readers > self.recorded:
            return True
        return bool(readers) and self._unwatched_maps.is_due(now_s)

    def _publish_maps(self, now_s: float) -> None:
        began = time.perf_counter()
        field, level_set = self._map.field() if self._is_over else self._map.recent_field(), self._map.level_set
        report = _field_report(now_s, field, level_set.level_m)
        self._centers.send_kept_back()
        self._field.publish(report)
        self._risk.publish((report, level_set.largest_risk))
        if self._isobath.has_readers():
            isobath = self._map.isobath(field)
            for index in range(len(MARKERS)):
                self._isobath.publish((now_s, index, isobath, level_set.level_m))
        return_free_memory()  # also that of this process's other nodes
        self._maps_took_s = time.perf_counter() - began

    def _publish_health(self, now_s: float) -> None:
        intake = self._intake
        recent = self._recent.of(now_s, map_totals(self._map, intake.gate.counts))
        quiet_s = now_s - intake.sounded_s
        health = map_health(
            self._map, self._update_s, self._maps_took_s, intake.gate.counts, recent, intake.corrector, quiet_s
        )
        self.publish_health(now_s, health)


def _centers_report(now_s: float, depth_map: DepthMap) -> CentersReport:
    centers = depth_map.centers
    return CentersReport(
        stamp_s=now_s,
        revision=depth_map.revision,
        locations_m=centers.locations_m,
        depths_m=centers.depths_m,
        noise_std_m=centers.noise_std_m,
        position_effect_m=centers.position_effect_m,
    )


def _field_report(now_s: float, field: DepthField, level_m: float) -> FieldReport:
    return FieldReport(
        stamp_s=now_s,
        north_m=field.grid.north_m,
        east_m=field.grid.east_m,
        level_m=level_m,
        variance_scale=field.variance_scale,
        mean_m=field.mean_m,
        std_m=field.std_m,
        risk=field.risk,
        p_safe=field.p_safe,
    )


def prepare() -> None:
    """Loads the compiled code, so that processes forked later have it."""
    if compiled.USE_NUMBA:
        compiled_gp()
        compiled_risk()


#: Entry point of `ros2 run auv_lse_gp gp_node`.
main = Main(GpNode)
