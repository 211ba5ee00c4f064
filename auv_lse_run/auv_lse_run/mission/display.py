"""Progress of a running mission: a live table in a terminal, elsewhere a line every few seconds."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.settings import Settings

_LINE_PERIOD_S = 5.0

#: Values of `MissionProgress.reward`.
MAP_REWARD, PATH_REWARD, LINE_REWARD = "map", "path", "line"
#: The rewards that each vehicle estimates for the whole team, and the unit of each reward.
TEAM_REWARDS = (MAP_REWARD, LINE_REWARD)
UNITS = {MAP_REWARD: "drop of Bayes risk", PATH_REWARD: "drop of Bayes risk", LINE_REWARD: "m of isobath located"}


@dataclass(slots=True)
class MissionProgress:
    """Progress of a mission.

    Attributes:
        steps_total: Legs of each vehicle.
        phase: "starting", "running" or "finished".
        started_s: Wall-clock time since the start (s).
        sim_s: Mission time (s).
        steps: Completed legs of each vehicle.
        sent: Packets sent by all.
        received: Packets received by all.
        lost: Receptions lost by the channel.
        speed: Simulated seconds per wall-clock second.
        rewards: Reward so far, by each planner's map, {vehicle: value}.
        expected: Expected reward at the mission's end, {vehicle: value}.
        bounds: Largest lower bound so far, of planners with a path reward, {vehicle: value}. The bound of the map's
            reward needs all soundings, so only the report has it.
        reward: `MAP_REWARD`, `LINE_REWARD`: each vehicle estimates the whole team's reward; `PATH_REWARD`: the
            paper's, a sum over the vehicles; "": the method maximizes neither.
        held: The vehicles that wait or hold, and why; "" if none does.
        until: The quality at which the mission ends.
        qualities: Quality of each vehicle's map judged last: share found, length undiscovered (m), deviation (m).
        battery_legs: Legs that each vehicle's battery lasts before the way to its recovery position, {vehicle: legs}.
    """

    vehicles: int
    steps_total: int
    phase: str = "starting"
    started_s: float = 0.0
    sim_s: float = 0.0
    steps: list[int] = field(default_factory=list)
    sent: int = 0
    received: int = 0
    lost: int = 0
    speed: float = 0.0
    rewards: dict[int, float] = field(default_factory=dict)
    expected: dict[int, float] = field(default_factory=dict)
    bounds: dict[int, float] = field(default_factory=dict)
    reward: str = MAP_REWARD
    held: str = ""
    until: UntilConfig = field(default_factory=UntilConfig)
    qualities: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    battery_legs: dict[int, int] = field(default_factory=dict)

    @property
    def _quality_text(self) -> str:
        """The worst quality of the vehicles' maps beside the required one; "" if none is required or judged yet."""
        known = [quality for quality in self.qualities.values() if not math.isnan(quality[0])]
        if not (self.until.is_asked and known):
            return ""
        found, undiscovered_m, deviation_m = zip(*known, strict=True)
        parts = []
        if self.until.found is not None:
            parts.append(f"{100.0 * min(found):.0f} % found (required {100.0 * self.until.found:g} %)")
        if self.until.undiscovered_m is not None:
            parts.append(f"at most {max(undiscovered_m):.0f} m undiscovered (required {self.until.undiscovered_m:g} m)")
        if self.until.deviation_m is not None and not any(map(math.isnan, deviation_m)):
            parts.append(f"line within {max(deviation_m):.1f} m (required {self.until.deviation_m:g} m)")
        return f"quality: {', '.join(parts)}" if parts else ""

    @property
    def _rewards_text(self) -> str:
        """The team's reward, expected reward and bound; "" if there is none.

        Negative rewards are left out: the first soundings often raise the map's risk before it drops.
        """
        if not (self.reward and self.rewards):
            return ""
        totals = [(name, self._of_team(values)) for name, values in self._columns() if values]
        texts = [f"{name} {total:.0f}" for name, total in totals if total >= 0.0]
        return f"{self.reward} reward: {', '.join(texts)}" if texts else ""

    @property
    def _battery_text(self) -> str:
        """The legs left by battery beside those planned; "" if no battery is known."""
        if not self.battery_legs:
            return ""
        left = " ".join(self._legs_left(vehicle).partition(" ")[0] for vehicle in range(1, self.vehicles + 1))
        return f"legs left by battery {left}"

    def _legs_left(self, vehicle: int) -> str:
        """The legs that a vehicle's battery still allows, and those that it still has to travel."""
        done = self.steps[vehicle - 1] if len(self.steps) >= vehicle else 0
        legs = self.battery_legs.get(vehicle)
        return "-" if legs is None else f"{legs} ({self.steps_total - done} planned)"

    def _columns(self) -> tuple[tuple[str, dict[int, float]], ...]:
        if not self.reward:
            return ()
        counted = (("so far", self.rewards), ("expected", self.expected))
        return counted if self.reward in TEAM_REWARDS else (*counted, ("bound", self.bounds))

    def _of_team(self, values: dict[int, float]) -> float:
        """The team's value: the mean of the vehicles' map rewards, or the sum of their path rewards."""
        return sum(values.values()) / (len(values) if self.reward in TEAM_REWARDS else 1)

    @property
    def _start(self) -> str:
        return f"starting: loading the nodes, {self.started_s:.0f} s"

    @property
    def line(self) -> str:
        """The progress in one line."""
        if self.phase == "starting":
            return self._start
        steps = " ".join(str(n) for n in self.steps) or "-"
        held = f"held: {self.held}" if self.held else ""
        texts = (self._battery_text, self._rewards_text, self._quality_text, held)
        rewards = "".join(f"  {text}" for text in texts if text)
        return (
            f"{clock(self.sim_s)}  legs {steps} of {self.steps_total}  packets: {self.sent:,} sent, {self.received:,} "
            f"received, {self.lost:,} lost{rewards}  {self.speed:.0f} x real time"
        )

    def table(self) -> Group:
        """The live table; before the first tick one line."""
        if self.phase == "starting":
            return Group(Text(self._start))
        table = Table(box=None, pad_edge=False)
        for title, align in (("vehicle", "left"), ("legs", "left"), ("", "right")):
            table.add_column(title, justify=align)
        for title, _ in self._columns():
            table.add_column(title, justify="right")
        if self.battery_legs:
            table.add_column("legs left by battery", justify="right")
        for vehicle in range(1, self.vehicles + 1):
            done = self.steps[vehicle - 1] if len(self.steps) >= vehicle else 0
            table.add_row(
                f"auv{vehicle}",
                ProgressBar(total=self.steps_total, completed=done, width=30, finished_style="green"),
                f"{done}/{self.steps_total}",
                *(_gained(values.get(vehicle)) for _, values in self._columns()),
                *([self._legs_left(vehicle)] if self.battery_legs else []),
            )
        head = Text.assemble(
            (f"{self.phase}  ", "bold"), f"mission time {clock(self.sim_s)}   {self.speed:.0f} x real time"
        )
        rewards = f"   {self._rewards_text} ({UNITS[self.reward]})" if self._rewards_text else ""
        foot = [Text(f"packets: {self.sent:,} sent, {self.received:,} received, {self.lost:,} lost{rewards}")]
        if self._quality_text:
            foot.append(Text(self._quality_text))
        if self.held:
            foot.append(Text(f"held: {self.held}", "yellow"))
        return Group(head, table, *foot)


def progress_of(settings: Settings) -> MissionProgress:
    """The progress of a mission that has not begun."""
    return MissionProgress(
        vehicles=settings.mission.vehicles,
        steps_total=settings.mission.steps,
        reward=reward_shown(settings.planner_settings(1).planner),
        until=settings.mission.until,
    )


def reward_shown(planner: PlannerConfig) -> str:
    """The reward to show: of the map, the line, the path (the paper's methods), or "" for the other methods."""
    if planner.family.bound_of in TEAM_REWARDS:
        return planner.family.bound_of
    return PATH_REWARD if planner.entry.of_paper else ""


def _gained(reward: float | None) -> str:
    """A reward in the table; "-" if there is none yet."""
    return "-" if reward is None or reward < 0.0 else f"{reward:.1f}"


def clock(seconds: float) -> str:
    """Seconds as m:ss, or h:mm:ss."""
    whole = int(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"


class Display:
    """Shows a MissionProgress until its context ends."""

    def __init__(self, progress: MissionProgress, console: Console) -> None:
        self._progress = progress
        self._console = console
        renews = console.is_terminal and not console.is_dumb_terminal
        self._live = Live(console=console, refresh_per_second=4, transient=False) if renews else None
        self._line_at_s = 0.0

    def __enter__(self) -> Display:
        """Starts the live table."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Shows the final state."""
        if self._live is not None:
            self._live.update(self._progress.table())
            self._live.stop()
        else:
            self._console.print(self._progress.line, highlight=False, soft_wrap=True)

    def refresh(self) -> None:
        """Updates the display."""
        now = time.monotonic()
        if self._live is not None:
            self._live.update(self._progress.table())
        elif now - self._line_at_s >= _LINE_PERIOD_S:
            self._line_at_s = now
            self._console.print(self._progress.line, highlight=False, soft_wrap=True)
