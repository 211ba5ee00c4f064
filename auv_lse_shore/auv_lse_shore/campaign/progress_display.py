"""Progress of a campaign: a live bar on a terminal, otherwise a line every ten seconds."""

import contextlib
import time
from collections.abc import Callable, Iterator

from auv_lse_shore.campaign.runner import CampaignState


@contextlib.contextmanager
def progress_display() -> Iterator[Callable[[CampaignState], None]]:
    """Yields a function that shows a campaign's state, to be called after each mission."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    console = Console()
    if not console.is_terminal or console.is_dumb_terminal:
        last = [0.0]

        def line(state: CampaignState) -> None:
            done = state.before + state.done
            if time.monotonic() - last[0] > 10.0 or done == state.total:
                last[0] = time.monotonic()
                print(f"{state.progress}, {state.failed} failed, {left(state)}", flush=True)

        yield line
        return
    bars = Bars(
        BarColumn(finished_style="green"), TextColumn("{task.description}, {task.fields[left]}"), console=console
    )
    with bars:
        task = bars.add_task("missions", total=None, left="starting")

        def bar(state: CampaignState) -> None:
            failed = f", {state.failed} failed" if state.failed else ""
            text = f"{left(state)}{failed}"
            done = state.before + state.done
            bars.update(task, description=state.progress, total=state.total, completed=done, left=text)

        yield bar


def left(state: CampaignState) -> str:
    """The time left, or why it is unknown."""
    waits = not state.threads and state.before + state.done < state.total
    return "waiting: the cluster has no worker" if waits else f"{duration(state.left_s)} left"


def duration(seconds: float) -> str:
    """A time for readers: 45 s, 12 min, 3 h 20 min."""
    if seconds != seconds:
        return "unknown time"
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
