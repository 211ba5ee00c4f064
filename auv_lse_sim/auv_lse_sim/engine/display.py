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

_LINE_PERIOD_S = 5.0


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
        bounds: Largest lower bound so far of each planner whose method has one, {vehicle: value}.
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
    bounds: dict[int, float] = field(default_factory=dict)

    @property
    def line(self) -> str:
        """The main figures in one line."""
        steps = " ".join(str(n) for n in self.steps) or "-"
        bound = f" bound {sum(self.bounds.values()):.0f}" if self.bounds else ""
        return (
            f"{clock(self.sim_s)}  steps {steps} of {self.steps_total}  packets {self.sent} sent {self.received} "
            f"received {self.lost} lost  reward {sum(self.rewards.values()):.0f}{bound}  {self.speed:.0f} x real time"
        )

    def table(self) -> Group:
        """The live table."""
        table = Table(box=None, pad_edge=False)
        for title, align in (
            ("vehicle", "left"),
            ("steps", "left"),
            ("", "right"),
            ("reward", "right"),
            ("bound", "right"),
        ):
            table.add_column(title, justify=align)
        for vehicle in range(1, self.vehicles + 1):
            done = self.steps[vehicle - 1] if len(self.steps) >= vehicle else 0
            table.add_row(
                f"auv{vehicle}",
                ProgressBar(total=self.steps_total, completed=done, width=30),
                f"{done}/{self.steps_total}",
                f"{self.rewards.get(vehicle, 0.0):.1f}",
                f"{self.bounds[vehicle]:.1f}" if vehicle in self.bounds else "-",
            )
        head = Text.assemble(
            (f"{self.phase}  ", "bold"), f"mission time {clock(self.sim_s)}   {self.speed:.0f} x real time"
        )
        bound = f", lower bound {sum(self.bounds.values()):.1f}" if self.bounds else ""
        foot = Text(
            f"packets: {self.sent} sent, {self.received} received, {self.lost} lost   team reward "
            f"{sum(self.rewards.values()):.1f}{bound} (drop of Bayes risk)"
        )
        return Group(head, table, foot)


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
