"""Chooses one kind of position and one sounder of each log, and brings its depths to one reference, the surface.

Two sounders are never mixed. Without `--sounder`, the one with the most pings in all logs is taken, and the others are
named. Pings of low quality are left out by the log's own scale.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.support.plurals import counted, counted_as
from auv_lse_common.vocabulary.water import HIGHEST_AIR_PA, depth_of
from auv_lse_gp.no_data import APART_IN_LOGS, fill_values
from auv_lse_shore.survey_import.frequencies import join_frequencies
from auv_lse_shore.survey_import.log_content import Clock, LogContent, Reference, Sounder
from auv_lse_shore.survey_import.survey_log import LogError, SurveyLog

#: Quantile of a log's pressures that counts as the pressure at the surface.
_SURFACE_SHARE = 0.01
#: The pressure in a closed hull varies by less than this (Pa).
_HULL_PA = 5_000.0
#: Kinds of positions, the best first; NMEA kinds follow their talker.
_POSITIONS = ("POS", "GLOBAL_POSITION_INT", "GNS", "GGA", "RMC", "GLL", "GPS", "GPS_RAW_INT")
#: A kind of position with less than this share of the most frequent one's is not preferred to it.
_ENOUGH = 0.5
#: Positions of another kind are used where the chosen one has none within this time (s).
_FILL_S = 5.0
#: Depths with a stated reference are preferred in this order.
_REFERENCES = (Reference.SURFACE, Reference.TRANSDUCER, Reference.KEEL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The user's decisions.

    Attributes:
        sounder: Name of the sounder; "" for the one with the most pings.
        least_quality: Least quality (percent of the log's scale) of a ping.
        draught_m: Depth of the transducer (of the keel, for depths below the keel) below the surface or below a
            submarine's barometer; None if unknown.
        density_kgpm3: Density of the water, for the depth of a submarine.
    """

    sounder: str = ""
    least_quality: float = 40.0
    draught_m: float | None = None
    density_kgpm3: float = 998.0


def chosen_logs(contents: Sequence[LogContent], choice: Choice, all_named: bool) -> tuple[list[SurveyLog], list[str]]:
    """One log of each content, all of them with the same sounder where they have it; and what was left out.

    Args:
        all_named: Whether a log without positions or depths is an error; else it is left out.

    Raises:
        LogError: if a content has no positions or no depths, or no log has the sounder that was asked for.
    """
    pings: Counter[str] = Counter()
    for content in contents:
        if not choice.sounder:
            join_frequencies(content)
        for name, sounder in content.sounders.items():
            rows = sounder.rows
            good = _is_good(rows, sounder.quality_scale, choice.least_quality)
            # a sounder that repeats one depth does not measure
            pings[name] += int(good.sum()) if len(np.unique(rows[:, 1])) > 1 else 0
    if choice.sounder and choice.sounder.lower() not in {name.lower() for name in pings}:
        raise LogError(f"--sounder {choice.sounder}: no log has it; it can be {', '.join(sorted(pings)) or 'none'}.")
    logs, left_out, last = [], [], None
    for content in contents:
        try:
            logs.append(_chosen(content, choice, pings))
        except LogError as error:
            if all_named:
                raise
            last = error
            left_out.append(f"left out: {error}")
    if not logs:
        raise last or LogError("There is no log.")
    return logs, left_out


def _chosen(content: LogContent, choice: Choice, pings: Counter[str]) -> SurveyLog:
    name = _sounder_of(content, choice, pings)
    positions, position_note = _positions(content, name)
    sounder = content.sounders[name]
    rows = sounder.rows
    good = _is_good(rows, sounder.quality_scale, choice.least_quality)
    content.left_out[f"depths with a quality below {choice.least_quality:g} %"] += int((~good).sum())
    if not good.any():
        raise LogError(
            f"{content.name}: all {len(rows)} depths of {name} have a quality below {choice.least_quality:g} %. "
            "Use them with --min-quality 0."
        )
    rows = rows[good]
    for depth_m in [] if content.is_checked else fill_values(rows[:, 1], apart=APART_IN_LOGS):
        marked = rows[:, 1] == depth_m
        content.left_out[f"depths of {depth_m:g} m, repeated and far from all others"] += int(marked.sum())
        rows = rows[~marked]
    log = SurveyLog(
        name=content.name,
        positions=positions,
        depths=_in_order(rows[:, :2]),
        immersion=_in_order(content.own_depths),
        is_geodetic=content.is_geodetic,
        has_time=content.clock is not Clock.NONE and not content.stood_still,
        is_utc=content.clock in (Clock.UTC, Clock.LOCAL),
        is_checked=content.is_checked,
        position_std_m=content.position_std_m,
        depth_std_m=content.depth_std_m,
        lag_std_s=content.lag_std_s,
        left_out=content.left_out,
        notes=[position_note, f"depths from {name}", *content.notes],
        questions=[*content.questions],
    )
    _refer_to_surface(log, sounder, choice)
    for other, unused in content.sounders.items():
        depths = unused.rows[:, 1]
        if other != name and len(depths):
            log.notes.append(
                f"not used: {counted(len(depths), 'depth')} of {other}, {depths.min():.1f} to {depths.max():.1f} m "
                f'(--sounder "{other}" takes them instead)'
            )
    if content.is_submarine:
        _add_immersion(log, content, choice.density_kgpm3)
    back_s, is_mixed = content.set_back()
    if log.has_time and back_s:
        effect = (
            ", so parts of the log have the same times, and their positions are mixed: split it there, and import one "
            "part"
            if is_mixed
            else ": the times before or after it may be wrong. Split it there, and import one part with --date"
        )
        log.questions.append(f"its clock was set back by {back_s:,.0f} s{effect}")
    return log


def _positions(content: LogContent, sounder: str) -> tuple[Array, str]:
    """The positions of the best kind, the sounder's own if it has any, filled up with those of others; and a remark."""
    found = content.positions
    if not found:
        raise LogError(
            f"{content.name} has no usable positions{_reasons(content)}. A log needs positions and depths together."
        )
    most = max(map(len, found.values()))

    def rank(kind: str) -> tuple[bool, bool, int, int]:
        at = next((i for i, name in enumerate(_POSITIONS) if kind == name or kind[2:] == name), len(_POSITIONS))
        return kind != sounder, len(found[kind]) < _ENOUGH * most, at, -len(found[kind])

    first, *others = sorted(found, key=rank)
    rows, note = found[first], f"positions from {first}"
    if content.position_std_m is not None or content.clock is Clock.NONE:
        return rows, note
    for kind in others:
        times = found[kind][:, 0]
        after = np.searchsorted(rows[:, 0], times)
        apart = np.minimum(
            np.abs(times - rows[after.clip(max=len(rows) - 1), 0]), np.abs(times - rows[(after - 1).clip(0), 0])
        )
        more = found[kind][apart > _FILL_S]
        if len(more):
            rows = _in_order(np.concatenate([rows, more]))
            note += f", {len(more)} of {kind} where those are missing"
    return rows, note


def _sounder_of(content: LogContent, choice: Choice, pings: Counter[str]) -> str:
    """The name of the content's sounder to use."""
    names = [name for name, sounder in content.sounders.items() if len(sounder.pings)]
    if not names:
        raise LogError(
            f"{content.name} has no usable depths{_reasons(content)}. A log needs positions and depths together."
        )
    if choice.sounder:
        asked = [name for name in names if name.lower() == choice.sounder.lower()]
        if not asked:
            raise LogError(f"{content.name} has no sounder {choice.sounder}, but {', '.join(names)}. Leave it out.")
        return asked[0]
    checked = [name for name in names if not content.sounders[name].is_unchecked]
    if not checked:
        raise LogError(
            f"{content.name} has no depths within a range finder's range{_reasons(content)}. "
            f'Use {names[0]} with --sounder "{names[0]}".'
        )
    names = checked
    most = max(pings[name] for name in names)
    # the transducer's depth that the user gives replaces the one that a plotter was set to
    order = _REFERENCES if choice.draught_m is None else (Reference.TRANSDUCER, Reference.SURFACE, Reference.KEEL)

    def rank(name: str) -> tuple[bool, int, int]:
        sounder = content.sounders[name]
        return pings[name] < _ENOUGH * most, order.index(sounder.reference), -pings[name]

    return min(names, key=rank)  # of equal ones the first in the log


def _reasons(content: LogContent) -> str:
    """What was left out, in brackets; "" if nothing."""
    reasons = [counted_as(count, reason) for reason, count in content.left_out.items() if count]
    found = [
        f"{counted(len(sounder.pings) // 3, 'depth')} of {name}"
        for name, sounder in content.sounders.items()
        if len(sounder.pings)
    ]
    found += [f"{counted(len(rows), 'position')} of {kind}" for kind, rows in content.positions.items()]
    return f" ({'; '.join([*reasons, *found])})" if reasons or found else ""


def _is_good(rows: Array, scale: float, least_percent: float) -> Mask:
    """Mask of the pings whose quality suffices.

    Without a scale it is the smallest of 1, 10, 100 and 255 that holds all values. A quality of 0 is "unknown" only
    if the log has no other.
    """
    quality = rows[:, 2]
    known = np.isfinite(quality)
    if not known.any() or not (quality[known] != 0.0).any():
        return np.ones(len(rows), dtype=bool)
    if not scale:
        top = float(quality[known].max())
        scale = next((s for s in (1.0, 10.0, 100.0, 255.0) if top <= s), top)
        if top < least_percent / 100.0 * scale:
            scale = top
    good: Mask = ~known | (quality >= least_percent / 100.0 * scale)
    return good


def _refer_to_surface(log: SurveyLog, sounder: Sounder, choice: Choice) -> None:
    """Adds the transducer's or the keel's depth, and asks for it if it is unknown."""
    if sounder.reference is Reference.SURFACE and choice.draught_m is None:
        log.notes.append("below the surface as the log has it")
        return
    if choice.draught_m is None:
        log.questions.append(
            f"depths are below {sounder.reference.value}, whose depth is unknown: 0 m is assumed; --draught gives it"
        )
        return
    log.depths[:, 1] += choice.draught_m - sounder.offset_m
    if not log.immersion[:, 1].any():
        log.immersion = np.array([[0.0, max(choice.draught_m, 0.0)]])  # of the transducer, at all times
    instead = f" instead of the {sounder.offset_m:g} m that the log states" if sounder.offset_m else ""
    log.notes.append(f"{choice.draught_m:g} m added{instead} (--draught)")


def _add_immersion(log: SurveyLog, content: LogContent, density_kgpm3: float) -> None:
    """The vehicle's depth from the water's barometer: the one that varies most; if none does, beyond the air's."""
    tables = content.pressures
    if not tables:
        raise LogError(
            f"{content.name} is a submarine's log without pressures, and the vehicle's own depth is part of the "
            "water's. Log BARO or SCALED_PRESSURE messages."
        )

    def middle(name: str) -> tuple[float, float]:
        """The pressures (Pa) at the surface and at depth, without single wrong ones."""
        low, high = np.quantile(tables[name][:, 1], (_SURFACE_SHARE, 1.0 - _SURFACE_SHARE))
        return float(low), float(high)

    def rank(name: str) -> tuple[float, bool, float]:
        low, high = middle(name)
        return (high - low if high - low > _HULL_PA else 0.0, low > HIGHEST_AIR_PA, high - low)

    kind = max(tables, key=rank)
    found, lat_deg = tables[kind], float(np.median(log.positions[:, 1]))
    surface_pa = middle(kind)[0]
    depths = [max(depth_of(pa - surface_pa, density_kgpm3, lat_deg), 0.0) for pa in found[:, 1].tolist()]
    log.immersion, log.is_immersion_added = np.column_stack([found[:, 0], depths]), False
    log.immersion = log.immersion[np.isfinite(log.immersion).all(axis=1)]
    log.notes.append(f"the vehicle's own depth from {kind}, with the lowest pressure as the surface")
    if surface_pa > HIGHEST_AIR_PA:
        log.questions.append(
            f"the lowest pressure of {kind} is {surface_pa / 100.0:.0f} hPa, more than the air's. If the log begins "
            "and ends under water, all depths are too small by the vehicle's smallest depth in the log: import the "
            "whole dive, or add that depth to --draught"
        )


def _in_order(rows: Array) -> Array:
    """Rows in order of time."""
    steps = np.diff(rows[:, 0])
    return rows if not math.isnan(steps.sum()) and (steps >= 0.0).all() else rows[np.argsort(rows[:, 0], kind="stable")]
