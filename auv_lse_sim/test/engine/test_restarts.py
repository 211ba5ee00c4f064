"""What is killed and started again goes on as if nothing had happened: the cores, over their journals."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.node.journal import Journal
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_comms.bridge import ModemBridge, ModemFeatures
from auv_lse_gp.intake import MapIntake
from auv_lse_sim.engine.fleet import Fleet, VehicleCores
from auv_lse_sim.ground.ground_source import ground_of

SMALL: dict[str, Any] = {
    "mission.vehicles": 2,
    "mission.steps": 10,
    "mission.seed": 3,
    "planner.iterations": 60,
    "tdma.slot_s": 10.0,
    "sim.channel.packet_loss": 0.2,
}


class Journalled(Fleet):
    """A fleet whose first vehicle keeps journals as its nodes do, and can be started again from them."""

    def __init__(self, settings: Settings, folder: Path) -> None:
        super().__init__(settings, ground_of(settings))
        self._folder = folder
        self.wear(self.cores[0])

    def wear(self, cores: VehicleCores) -> None:
        """Reads the journals into the cores, and has the cores write them."""
        gp, planner, modem = (Journal(self._folder / f"{name}.journal", {}) for name in ("gp", "planner", "modem"))
        to_map = cores._to_map
        to_map.restore(gp.records)
        self._journal_steps(to_map, gp)
        for kind, *values in planner.records:
            if kind == "heard":
                cores.planner.receive_plan(values[0], values[1], Plan.from_mapping(values[2]))
        decided = [values for kind, *values in planner.records if kind == "decided"]
        if decided:
            cores.planner.restore(decided[-1][0])
        judged = [values for kind, *values in planner.records if kind in ("decided", "judged")]
        if judged and "met" in judged[-1][0]:
            cores.planner.until.restore(judged[-1][0])
        cores.planner.resume_at(0, any(kind == "finished" for kind, *_ in planner.records))
        hear, decide, judged = cores.planner.receive_plan, cores.planner.decide, cores.planner.set_quality
        judge = to_map.judge

        def hear_and_write(now_s: float, vehicle: int, plan: Plan) -> None:
            hear(now_s, vehicle, plan)
            planner.write("heard", now_s, vehicle, dataclasses.asdict(plan))

        def decide_and_write(now_s: float, deadline: Callable[[], bool] | None = None) -> Any:
            decision = decide(now_s, deadline)
            planner.write("decided", cores.planner.snapshot())
            return decision

        def count_and_write(now_s: float, quality: Quality, is_current: bool = True) -> bool:
            if not judged(now_s, quality, is_current):
                return False
            planner.write("judged", cores.planner.until.snapshot())
            return True

        self._write_finish = lambda: planner.write("finished")
        cores.planner.receive_plan, cores.planner.decide = hear_and_write, decide_and_write
        cores.planner.set_quality = count_and_write
        to_map.judge = lambda now_s, is_running: judge(now_s, is_running, gp.write)
        cores.bridge.recall(modem.records)
        cores.bridge.remember = modem.write

    def _journal_steps(self, to_map: MapIntake, journal: Journal) -> None:
        step, step_in_journal = to_map.step, to_map.step_in_journal

        def step_and_write(now_s: float) -> bool:
            to_map.step = step
            taken = step_in_journal(now_s, journal.write)
            to_map.step = step_and_write
            return taken

        to_map.step = step_and_write

    def restart(self) -> None:
        """The first vehicle's processes die between two ticks, and come back."""
        if self.cores[0].planner.finished:
            self._write_finish()
        log = self.cores[0].log
        self.cores[0] = self._build_cores(1)
        self.cores[0].log = log
        self.wear(self.cores[0])


@pytest.mark.parametrize(
    "more",
    [
        {"planner.method": "tour"},
        {"planner.method": "tour", "mission.until.undiscovered_m": 5000.0, "mission.steps": 20},
        {"planner.method": "plain"},
    ],
    ids=lambda more: "-".join(map(str, more.values())),
)
def test_a_vehicle_started_again_flies_the_same_mission(tmp_path: Path, more: dict[str, Any]) -> None:
    settings = Settings.load(None, {**SMALL, **more})
    undisturbed = Fleet(settings, ground_of(settings)).run()
    fleet = Journalled(settings, tmp_path)
    ticks = 0
    while not fleet.finished:
        fleet.tick()
        ticks += 1
        if ticks % 23 == 0:  # in every part of a leg and of a cycle, and after the vehicle's end
            fleet.restart()
    run = fleet.run_data()
    assert ticks > 100
    for one, other in zip(run.vehicles, undisturbed.vehicles, strict=True):
        assert [(d.now_s, d.plan) for d in one.decisions] == [(d.now_s, d.plan) for d in other.decisions]
        for mine, theirs in zip(one.decisions, other.decisions, strict=True):
            # a map that is built in one go rounds otherwise than one that has grown
            assert mine.jbar == pytest.approx(theirs.jbar, rel=1e-9)
            assert mine.reward_so_far == pytest.approx(theirs.reward_so_far, rel=1e-9)
    assert [p.payload for p in run.sent] == [p.payload for p in undisturbed.sent]


def test_without_a_journal_the_mission_is_another_one(tmp_path: Path) -> None:
    """The test above can fail: what it compares depends on the journals."""
    settings = Settings.load(None, SMALL)
    fleet = Journalled(settings, tmp_path)
    for _ in range(60):
        fleet.tick()
    centers = len(fleet.cores[0].map.centers)
    for file in tmp_path.iterdir():
        os.unlink(file)
    fleet.restart()
    assert centers > 3
    assert len(fleet.cores[0].map.centers) == 0
    assert fleet.cores[0].planner.snapshot()["travel"]["decided"] == 0


def bridge(confirm_s: float) -> ModemBridge:

    made = ModemBridge(TdmaConfig(), PacketConfig(), 1, 2, modem=ModemFeatures(confirm_s=confirm_s))
    made.set_plan(Plan(step=4, heading_rad=0.5, north_m=10.0, east_m=20.0, actions=(1, 2, 3), naive_path=0xF1))
    return made


def test_what_the_modem_does_not_confirm_is_sent_again() -> None:
    one = bridge(11.0)
    one.add_soundings([(float(i), 1.0 * i, 0.0, 5.0) for i in range(10)])
    first = one.poll(1.0)
    assert one.unsent == 0
    one.poll(12.5)
    assert (one.unsent, one.unconfirmed, one.counts["slots.missed.modem"]) == (10, 1, 1)
    assert one.poll(21.0) == first
    one.confirm(21.0)
    one.poll(33.0)
    assert (one.unsent, one.unconfirmed, one.counts["sent"]) == (0, 0, 1)


def test_a_packet_that_was_not_confirmed_before_the_restart_is_sent_again(tmp_path: Path) -> None:
    one, journal = bridge(11.0), Journal(tmp_path / "modem.journal", {})
    one.remember = journal.write
    one.add_soundings([(float(i), 1.0 * i, 0.0, 5.0) for i in range(30)])
    assert one.poll(1.0) is not None
    one.confirm(1.0)
    assert one.poll(21.0) is not None
    again = bridge(11.0)
    again.recall(Journal(tmp_path / "modem.journal", {}).records)
    assert again.counts["sent"] == 2
    assert again.poll(22.0) is None, "one packet in a slot, also after a restart"
    again.poll(33.0)
    assert (again.unsent, one.unsent) == (11, 0)
    assert again.counts["sent"] == 1
