"""Distinguishes two sounders of different frequencies from one that changes its frequency, such as with the depth."""

from array import array

import numpy as np

from auv_lse_shore.survey_import.log_content import Clock, LogContent, Sounder

#: A sounder changes its frequency at no more than this share of its pings; depths may then step by this (m) more.
_RARE_CHANGES, _SAME_GROUND_M = 0.05, 0.1


def join_frequencies(content: LogContent) -> None:
    """Joins sounders that took turns: they changed seldom, and found the same ground where they did.

    Sounders that ping at the same time or alternately stay separate.
    """
    names = sorted(name for name, own in content.sounders.items() if "frequency" in name.lower() and len(own.pings))
    if len(names) < 2 or content.clock is Clock.NONE:
        return
    rows = np.concatenate([content.sounders[name].rows for name in names])
    numbers = np.repeat(np.arange(len(names)), [len(content.sounders[name].rows) for name in names])
    order = np.argsort(rows[:, 0], kind="stable")
    rows, numbers = rows[order], numbers[order]
    changes, steps_m = np.diff(numbers) != 0, np.abs(np.diff(rows[:, 1]))
    if changes.mean() > _RARE_CHANGES:
        return
    if np.median(steps_m[changes]) > 3.0 * np.median(steps_m[~changes]) + _SAME_GROUND_M:
        return
    first = content.sounders[names[0]]
    for name in names:
        del content.sounders[name]
    content.sounders["depth" if "depth" not in content.sounders else names[0]] = Sounder(
        reference=first.reference,
        quality_scale=first.quality_scale,
        offset_m=first.offset_m,
        pings=array("d", rows.ravel()),
    )
    listed = ", ".join(f'"{name}"' for name in names)
    content.notes.append(f"one sounder that changes its frequency: {listed} (--sounder takes only one of them)")
