"""The display of a running mission: a live table in a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from auv_lse_common.mission_file.sections.planner import PlannerConfig

_LINE_PERIOD_S = 5.0

#: Whose reward a planner counts: see `MissionProgress.reward`.
OF_THE_MAP, OF_THE_PATH = "map", "paths"


@dataclass(slots=True)
class MissionProgress:
    """The progress of a mission, as the display shows it.

    Attributes:
        vehicles: Number of vehicles.
        steps_total: Legs each of them travels.
        phase: What the mission is doing, for a person.
        sim_s: Mission time (s).
        steps: Legs travelled, per vehicle.
        sent: Packets sent by all.
        received: Packets received by all.
        lost: Receptions that the channel lost.
        speed: Simulated seconds per second of wall clock.
        rewards: Reward so far, as each planner counts it, {vehicle: value}.
        expected: Reward that each planner expects by the mission's end, {vehicle: value}.
        bounds: Largest lower bound so far, of each planner that counts its path, {vehicle: value}. The map's bound
            holds for the map of all soundings, which nobody has under way: the report tells how it ended.
        reward: Whose reward that is: `OF_THE_MAP`, which every vehicle counts over the whole map for the whole team;
            `OF_THE_PATH`, the paper's, which adds up over vehicles; "" for a method that maximizes neither.
    """

    vehicles: int
    steps_total: int
    phase: str = "starting"
    sim_s: float = 0.0
    steps: list[int] = field(default_factory=list)
    sent: int = 0
    received: int = 0
    lost: int = 0
    speed: float = 0.0
    rewards: dict[int, float] = field(default_factory=dict)
    expected: dict[int, float] = field(default_factory=dict)
    bounds: dict[int, float] = field(default_factory=dict)
    reward: str = OF_THE_MAP

    @property
    def _account(self) -> str:
        """Reward, what is expected of the end, and its bound, of the team; "" where that says nothing.

        A reward below zero is left out: the first soundings often show ground that is nearer to the level than the
        prior had it, so that the map's risk rises before it drops.
        """
        if not (self.reward and self.rewards):
            return ""
        totals = [(name, self._of_team(values)) for name, values in self._columns() if values]
        texts = [f"{name} {total:.0f}" for name, total in totals if total >= 0.0]
        return f"{self.reward}: {', '.join(texts)}" if texts else ""

    def _columns(self) -> tuple[tuple[str, dict[int, float]], ...]:
        if not self.reward:
            return ()
        counted = (("so far", self.rewards), ("expected", self.expected))
        return counted if self.reward == OF_THE_MAP else (*counted, ("bound", self.bounds))

    def _of_team(self, values: dict[int, float]) -> float:
        """The team's value: the vehicles' mean, where each counts the whole map; else their sum."""
        return sum(values.values()) / (len(values) if self.reward == OF_THE_MAP else 1)

    @property
    def line(self) -> str:
        """The main figures in one line."""
        steps = " ".join(str(n) for n in self.steps) or "-"
        account = f"  {self._account}" if self._account else ""
        return (
            f"{clock(self.sim_s)}  steps {steps} of {self.steps_total}  packets {self.sent} sent {self.received} "
            f"received {self.lost} lost{account}  {self.speed:.0f} x real time"
        )

    def table(self) -> Group:
        """The live table."""
        table = Table(box=None, pad_edge=False)
        for title, align in (("vehicle", "left"), ("steps", "left"), ("", "right")):
            table.add_column(title, justify=align)
        for title, _ in self._columns():
            table.add_column(title, justify="right")
        for vehicle in range(1, self.vehicles + 1):
            done = self.steps[vehicle - 1] if len(self.steps) >= vehicle else 0
            table.add_row(
                f"auv{vehicle}",
                ProgressBar(total=self.steps_total, completed=done, width=30),
                f"{done}/{self.steps_total}",
                *(_gained(values.get(vehicle)) for _, values in self._columns()),
            )
        head = Text.assemble(
            (f"{self.phase}  ", "bold"), f"mission time {clock(self.sim_s)}   {self.speed:.0f} x real time"
        )
        account = f"   {self._account} (drop of Bayes risk)" if self._account else ""
        foot = Text(f"packets: {self.sent} sent, {self.received} received, {self.lost} lost{account}")
        return Group(head, table, foot)


def reward_shown(planner: PlannerConfig) -> str:
    """Whose reward the account counts: the map's, the paths' (the paper's methods), or "" for one that says little."""
    if planner.family.bound_of == "map":
        return OF_THE_MAP
    return OF_THE_PATH if planner.entry.of_paper else ""


def _gained(reward: float | None) -> str:
    """A reward in the table; "-" while there is none."""
    return "-" if reward is None or reward < 0.0 else f"{reward:.1f}"


def clock(seconds: float) -> str:
    """Seconds as m:ss, or h:mm:ss."""
    whole = int(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"


class Display:
    """Shows a MissionProgress until its context ends."""

    def __init__(self, progress: MissionProgress, console: Console) -> None:
        """Shows nothing yet."""
        self._progress = progress
        self._console = console
        self._live = Live(console=console, refresh_per_second=4, transient=False) if console.is_terminal else None
        self._line_at_s = 0.0

    def __enter__(self) -> Display:
        """Starts the live table."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves the last state on the screen."""
        if self._live is not None:
            self._live.update(self._progress.table())
            self._live.stop()
        else:
            self._console.print(self._progress.line, highlight=False, soft_wrap=True)

    def refresh(self) -> None:
        """Shows the progress as it is now."""
        now = time.monotonic()
        if self._live is not None:
            self._live.update(self._progress.table())
        elif now - self._line_at_s >= _LINE_PERIOD_S:
            self._line_at_s = now
            self._console.print(self._progress.line, highlight=False, soft_wrap=True)
