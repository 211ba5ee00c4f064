"""The results of a mission in words: lines for a terminal, cards and paragraphs for the report."""

from collections.abc import Callable, Mapping

import numpy as np

from auv_lse_common.mission_file.methods import PAPER_METHODS
from auv_lse_common.support.plurals import area_size, counted, listed
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_common.vocabulary.health import BATTERY_LASTS
from auv_lse_gp.covariance.prior_mean import excluded_level
from auv_lse_gp.map.certainty import FLAT, FOUND, GUESSED, LIKELY, NOT_VISITED, POSITIONS_UNCERTAIN, VISITED_M, Piece
from auv_lse_planner.methods.coverage import follows_isobath
from auv_lse_planner.vehicle.until import plans_to_horizon
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.evaluation import Evaluation, absent_vehicles
from auv_lse_shore.judge.figures_of_merit import SURE
from auv_lse_shore.judge.quantity_names import ACTUAL_LOSS, COST_PER_LOCATION, EXPECTED_LOSS, MAP_RISK
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.report.map_marks import degrees
from auv_lse_shore.report.page import number

#: Number of stretches that the report lists one by one, and the shortest (m) that it lists.
MAX_STRETCHES, MIN_STRETCH_M = 3, 10.0

#: Expected and actual loss agree up to the first factor; up to the second, the map is slightly wrong about them.
EQUAL, CLOSE = 1.1, 1.5

#: Losses (cost per location) below this are all called close: the report shows three digits.
NEGLIGIBLE_LOSS = 5e-4

_REASONS = {
    NOT_VISITED: f"no vehicle measured within {VISITED_M:g} m, or on one side only",
    POSITIONS_UNCERTAIN: "positions were uncertain",
    FLAT: "the ground is too flat to locate the line",
}


def headlines(s: Summary, planned_steps: int, run: RunData | None = None) -> list[str]:
    """The main figures of a mission of `planned_steps` steps, one line each; with its run, why vehicles ended early."""
    loss = "" if s.loss_after is None else f", {ACTUAL_LOSS} {s.loss_after:.3f}"
    lines = [
        *ended_early(s, planned_steps),
        *(_reasons(run) if run else []),
        *opening(s),
        f"{MAP_RISK}: {s.risk_before:.3f} -> {s.risk_after:.3f} ({COST_PER_LOCATION}){_bound_in_brief(s)}",
        f"{EXPECTED_LOSS} {s.loss_expected:.3f}{loss} ({COST_PER_LOCATION})",
        *([_unreachable(s)] if s.unreachable_m2 else []),
    ]
    if s.method in PAPER_METHODS and s.steps:
        bound = "" if s.lower_bound is None else f" (lower bound {s.lower_bound:.0f})"
        lines.append(
            f"the paper's reward: stepwise {s.team_reward:.0f}{bound}; whole path {s.path_reward:.0f} "
            f"(lawnmower {s.lawnmower_value:.0f})"
        )
    if s.vehicles > 1:
        lost = counted(s.packets_lost, "reception")
        lines.append(f"packets: {s.packets_sent:,} sent, {s.packets_received:,} received, {lost} lost")
    return lines


def opening(s: Summary) -> list[str]:
    """What was found, with what accuracy, and what may be missing, beside the truth if it is known: one line each."""
    found, exactly, missing = opening_lines(
        {FOUND: s.isobath_found_m, LIKELY: s.isobath_likely_m, GUESSED: s.isobath_guessed_m},
        s.isobath_found_within_m,
        s.isobath_undiscovered_m,
        s.isobath_undiscovered_limit_m,
    )
    if s.isobath_found is not None and s.isobath_true_m:
        found = found.replace(
            " of isobath", f" of isobath ({_percent(s.isobath_found)} of the true isobath in the area)"
        )
        missing += f" (actually {_m((1.0 - s.isobath_found) * s.isobath_true_m)})"
    if s.isobath_found_within_m is not None and s.isobath_found_error_p95_m is not None:
        exactly += f" (actually {s.isobath_found_error_p95_m:.1f} m)"
    return [found, exactly, missing]


def opening_lines(
    length_m: Mapping[str, float], within_m: float | None, undiscovered_m: float, limit_m: float
) -> list[str]:
    """The same three lines for a report or a certificate.

    Args:
        length_m: Length of the isobath in each of `CLASSES`.
        within_m: Distance within which 95 % of the line found is expected of the isobath; None if none is found.
        undiscovered_m: Expected length of isobath that may be missing.
        limit_m: Its upper limit with 95 % probability.
    """
    others = ", ".join(f"{_m(length_m[kind])} {kind}" for kind in (LIKELY, GUESSED) if is_length(length_m[kind]))
    accuracy = (
        "no line found"
        if within_m is None
        else f"95 % of the line found is expected to lie within {within_m:.1f} m of the isobath"
    )
    is_skewed = limit_m < undiscovered_m  # rarely much is missing
    expected = "on average, but" if is_skewed else "expected,"
    missing = f"{_m(undiscovered_m)} of isobath {expected} at most {_m(limit_m)} with 95 % probability"
    return [
        f"found: {_m(length_m[FOUND])} of isobath{'; ' if others else ''}{others}",
        f"accuracy: {accuracy}",
        f"may be missing: {missing if is_length(limit_m) else 'no isobath is expected elsewhere'}",
    ]


def ended_early(s: Summary, planned_steps: int) -> list[str]:
    """One sentence if a mission ended before its last step, or was asked to; else none."""
    if s.steps >= planned_steps:
        late = f"All {planned_steps} steps were travelled: the quality asked for was not reached in time to end earlier"
        return [f"{late} ({s.quality_asked})."] if s.quality_asked else []
    if not s.steps:
        return ["No complete leg is recorded: this is a survey, or the mission ended before or on its first leg."]
    if s.quality_reached:
        return [
            f"The mission ended because the quality asked for was reached, at step {s.steps} of {planned_steps}: "
            f"{s.quality_asked}. {'Each' if s.vehicles > 1 else 'The'} vehicle returned at least "
            f"{counted(planned_steps - s.steps, 'step')} of its budget."
        ]
    return [
        f"The mission ended early, after {s.steps} of {planned_steps} steps. Its results are compared with the "
        "same part of a lawnmower mission."
    ]


def batteries(run: RunData) -> list[str]:
    """Why vehicles ended early, and a sentence for each whose battery's consumption was learned."""
    return _reasons(run) + [
        f"auv{vehicle.vehicle}: a full battery lasts {vehicle.battery[BATTERY_LASTS]}; vehicle.battery_km lets check "
        "and GO compare the next mission with it."
        for vehicle in run.vehicles
        if BATTERY_LASTS in vehicle.battery
    ]


def _reasons(run: RunData) -> list[str]:
    reasons = [f"auv{v.vehicle} ended early: {v.ended_early}." for v in run.vehicles if v.ended_early]
    if absent := absent_vehicles(run):
        names = listed([f"auv{number}" for number in absent], most=8)
        team = counted(len(run.vehicles) + len(absent), "vehicle")
        reasons.append(
            f"{team} flew this mission, but the data of {names} are not here: no bound is compared. "
            "For one report of the whole team: auv_lse adjust --report RUN RUN."
        )
    return reasons


def _bound_in_brief(s: Summary) -> str:
    if s.mowing_risk is None or not s.steps or s.risk_before < NEGLIGIBLE_LOSS:
        return ""
    if not s.map_bound_promised or s.map_bound_kept is None:
        return f"; a lawnmower was expected to reach {s.mowing_risk:.3f}"
    kept = "met" if s.map_bound_kept else "not met (it bounds the mean over lakes)"
    return f"; lawnmower bound {s.mowing_risk:.3f}: {kept}"


def subtitle(e: Evaluation) -> str:
    """What was searched for, by whom, and how long it took."""
    s = e.summary
    team = counted(s.vehicles, "underwater vehicle")
    wall = "" if s.wall_s is None else f", simulated in {s.wall_s:.1f} s of wall-clock time"
    early = f" Ended early: {s.steps} of {e.planned_steps} steps." if s.steps < e.planned_steps else ""
    if s.quality_reached:
        early = f" Ended with the quality asked for: {s.steps} of {e.planned_steps} steps."
    lasted = f"{s.sim_s / 60.0:.1f} min"
    return f"Search for the {_level(e)} isobath, the line along which the water is {_level(e)} deep. {team}, " + (
        f"{lasted} of mission time{wall}.{early}" if s.steps else f"{lasted}, no legs."
    )


def cards(e: Evaluation) -> list[tuple[str, str]]:
    """The main results, for everyone, as pairs of a value and its meaning."""
    s, level = e.summary, _level(e)
    unsure_m = s.isobath_likely_m + s.isobath_guessed_m
    rows: list[tuple[float | None, Callable[[float], str], str]] = [
        (s.isobath_found_m, _m, "of isobath found"),
        (unsure_m if is_length(unsure_m) else None, _m, "of isobath likely or guessed"),
        (s.isobath_found, _percent, "of the true isobath found"),
        (s.isobath_found_error_m, "{:.1f} m".format, "mean error of the isobath found"),
        (s.deep_m2, area_size, f"surely at least {level} deep"),
        (s.shallow_m2, area_size, f"surely shallower than {level}"),
        (s.unsure_m2, area_size, "uncertain"),
    ]
    return _known(rows)


def quality_cards(s: Summary) -> list[tuple[str, str]]:
    """The main measures of map and acoustic link, as pairs of a value and its meaning."""
    lawnmower = f"lawnmower bound on {MAP_RISK}" if s.map_bound_promised else f"{MAP_RISK} expected of a lawnmower"
    risk = f"{_three(s.risk_before)} → {_three(s.risk_after)}"
    rows: list[tuple[float | None, Callable[[float], str], str]] = [
        (s.risk_after, lambda _: risk, f"{MAP_RISK} before → after ({COST_PER_LOCATION})"),
        (s.mowing_risk if s.steps else None, _three, lawnmower),
        (s.loss_expected, _three, f"{EXPECTED_LOSS} ({COST_PER_LOCATION})"),
        (s.loss_after, _three, f"{ACTUAL_LOSS} ({COST_PER_LOCATION})"),
        (s.delivery, _percent, f"of packets received ({s.packets_sent:,} sent)"),
    ]
    return _known(rows)


def _known(rows: list[tuple[float | None, Callable[[float], str], str]]) -> list[tuple[str, str]]:
    return [(shown(value), meaning) for value, shown, meaning in rows if value is not None]


def findings(e: Evaluation) -> list[str]:
    """What was found, and what remains uncertain and why."""
    return [text for text in (_found(e), _missing(e), _sides(e), _unreachable(e.summary), _uncertain(e)) if text]


def paragraphs(e: Evaluation) -> list[str]:
    """Whether the bound was met, what wrong calls cost, and what the acoustic link and positions did to the map."""
    s = e.summary
    return [text for text in (_bound(e), _voids(s), _loss(s), _link(s), _position(s), _outside(e)) if text]


def _found(e: Evaluation) -> str:
    s = e.summary
    if s.isobath_length_m == 0.0:
        true = "" if s.isobath_true_m is None else f" The true isobath is {_m(s.isobath_true_m)} long."
        if s.isobath_true_m == 0.0:
            true = " The true ground has none either."
        limit = ""
        if is_length(s.isobath_undiscovered_limit_m):
            limit = f" With 95 % probability, at most {_m(s.isobath_undiscovered_limit_m)} of it is missing."
        return f"The map shows no {_level(e)} isobath.{limit}{true}"
    some = is_length(s.isobath_found_m)
    text = f"{_team(s)} found {_m(s.isobath_found_m) if some else 'none'} of the {_level(e)} isobath."
    other = " another" if some else ""
    if is_length(s.isobath_likely_m) and is_length(s.isobath_guessed_m):
        text += (
            f"{other.title()} {_m(s.isobath_likely_m)} is likely, and {_m(s.isobath_guessed_m)} is a guess with little "
            "data behind it."
        )
    elif is_length(s.isobath_likely_m):
        text += f"{other.title()} {_m(s.isobath_likely_m)} is likely."
    elif is_length(s.isobath_guessed_m):
        text += f"{other.title()} {_m(s.isobath_guessed_m)} is a guess with little data behind it."
    if not some:
        return text
    if s.isobath_found_error_m is not None and s.isobath_found_error_p95_m is not None:
        text += (
            f" The mean error of the part found is {s.isobath_found_error_m:.1f} m, and 95 % of it is within "
            f"{s.isobath_found_error_p95_m:.1f} m of the true isobath."
        )
    if s.isobath_found is not None and s.isobath_true_m:
        found, whole = _percent(s.isobath_found), _m(s.isobath_true_m)
        text += f" It covers {found} of the true isobath in the area, which is {whole} long."
    return text


def _missing(e: Evaluation) -> str:
    patches = [patch for patch in e.team_map.undiscovered.patches() if patch[2] >= MIN_STRETCH_M][:MAX_STRETCHES]
    if not patches:
        return ""
    listed = "; ".join(f"{_m(length)} near {_location(north, east, e.run.origin)}" for north, east, length in patches)
    return f"Isobath that may be missing, by location and expected length: {listed}."


def _sides(e: Evaluation) -> str:
    s = e.summary
    shallower = "shallower" if _is_area(s.deep_m2, s) else f"shallower than {_level(e)}"
    known = {f"at least {_level(e)} deep": s.deep_m2, shallower: s.shallow_m2}
    sides = [f"{area_size(size)} is {what}" for what, size in known.items() if _is_area(size, s)]
    sure = (
        f"{', and '.join(sides)}, with at least {_percent(SURE)} probability" if sides else "No location is classified"
    )
    rest = f"{area_size(s.unsure_m2)} ({_percent(s.unsure_m2 / max(s.area_m2, 1.0))}) remains uncertain"
    return f"{sure}. {rest if _is_area(s.unsure_m2, s) else 'No location remains uncertain'}."


def _unreachable(s: Summary) -> str:
    if not s.unreachable_m2:
        return ""
    return (
        f"{area_size(s.unreachable_m2)} of the area cannot be reached from the starts: no safe turn and no "
        "leg leads there. No figure includes it."
    )


def _uncertain(e: Evaluation) -> str:
    s = e.summary
    if s.isobath_length_m == 0.0:
        return ""
    lengths = {
        NOT_VISITED: s.isobath_not_visited_m,
        POSITIONS_UNCERTAIN: s.isobath_positions_uncertain_m,
        FLAT: s.isobath_flat_m,
    }
    reasons = [f"{_m(length)} where {_REASONS[reason]}" for reason, length in lengths.items() if length >= 1.0]
    if not reasons:
        return f"No part of the line remains uncertain{_missing_note(s)}."
    longest = sorted((p for p in e.pieces if p.kind != FOUND), key=lambda p: p.length_m, reverse=True)
    listed = [_stretch(p, e.run.origin) for p in longest[:MAX_STRETCHES] if p.length_m >= MIN_STRETCH_M]
    where = f" Longest stretches: {'; '.join(listed)}." if listed else ""
    return f"Line not found: {'; '.join(reasons)}.{where}"


def _missing_note(s: Summary) -> str:
    """What a line without uncertain parts still lacks; "" if that is less than `MIN_STRETCH_M`."""
    if s.isobath_found is None or s.isobath_true_m is None:
        expected = s.isobath_undiscovered_m
        return "" if expected < MIN_STRETCH_M else f", but {_m(expected)} of isobath is expected to be missing"
    unfound = (1.0 - s.isobath_found) * s.isobath_true_m
    return "" if unfound < MIN_STRETCH_M else f", but {_m(unfound)} of the true isobath was not found"


def _stretch(piece: Piece, origin: tuple[float, float] | None) -> str:
    north, east = np.mean(piece.line, axis=0)
    return f"{_m(piece.length_m)} near {_location(north, east, origin)}: {piece.kind}, {piece.reason}"


def _location(north: float, east: float, origin: tuple[float, float] | None) -> str:
    location = f"north {north:.0f} m, east {east:.0f} m"
    if origin is not None:
        latitude, longitude = geodetic_from_local(north, east, *origin)
        location += f" ({degrees(float(latitude), 5, 'NS')}, {degrees(float(longitude), 5, 'EW')})"
    return location


def _bound(e: Evaluation) -> str:
    s, first = e.summary, e.settings[0]
    if s.risk_before < NEGLIGIBLE_LOSS:
        return "Map risk was negligible from the start: the prior leaves no doubt about any location."
    change, why = "fell", ""
    if s.risk_after > s.risk_before:
        change, why = "rose", ": the soundings are nearer to the isobath's depth than the prior expected"
    text = (
        f"Map risk, the mean Bayes risk per location, {change} from {_three(s.risk_before)} to "
        f"{_three(s.risk_after)}{why}."
    )
    if s.mowing_risk is None or not s.steps:
        return text
    apart = abs(1.0 - s.risk_after / s.mowing_risk) if s.mowing_risk > 0.0 else 0.0
    share = _percent(apart) if apart >= 0.01 else "less than 1 %"
    beside = f"{share} {'below' if s.risk_after <= s.mowing_risk else 'above'}"
    if s.steps < e.planned_steps:
        flown = "" if s.flown_risk is None else f" The path flown was expected to reach {_three(s.flown_risk)}."
        return (
            f"{text}{flown} The first {s.steps} of {e.planned_steps} steps of a lawnmower mission were expected to "
            f"reach {_three(s.mowing_risk)}; this mission was {beside} that when it ended. Bounds hold for complete "
            f"missions only.{_quality_note(s)}"
        )
    lanes = " with lanes that just cover the area" if follows_isobath(first) else ""
    bound = f"A lawnmower mission of the same length{lanes} was expected to reach {_three(s.mowing_risk)}"
    if not s.map_bound_promised:
        who = "A mission that is planned for a share found" if plans_to_horizon(first) else f"The method {s.method}"
        return f"{text} {bound}; this mission ended {beside} that. {who} guarantees no such bound."
    if s.map_bound_kept:
        return f"{text} {bound}. This bound was met: the mission ended {beside} it."
    text = f"{text} {bound}. This bound was not met: the mission ended {beside} it."
    if excluded := excluded_level(first.gp, first.level_set.level_m, e.area.polygon):
        return (
            f"{text} The prior of the mission file nearly excludes this isobath: {_level(e)} is {excluded.sigmas:.1f} "
            f"standard deviations from its mean. So the bound is too low. Set gp.signal_std_m to "
            f"{excluded.wide_enough_m:g} or more."
        )
    return f"{text} The bound is an expectation over all lakes that the prior allows, so single missions can miss it."


def _quality_note(s: Summary) -> str:
    """The quality that ended a mission, and that of the team's final map; "" if it ended otherwise."""
    if not s.quality_reached:
        return ""
    both_m = s.isobath_found_m + s.isobath_undiscovered_m
    within = (
        "" if s.isobath_found_within_m is None else f", 95 % of the line found within {s.isobath_found_within_m:.1f} m"
    )
    return (
        f" This mission promised a quality instead: {s.quality_asked}. The final map of all soundings has "
        f"{_percent(s.isobath_found_m / both_m if both_m else 0.0)} found, at most "
        f"{_m(s.isobath_undiscovered_limit_m)} undiscovered (with 95 % probability){within}."
    )


def _voids(s: Summary) -> str:
    count = sum(s.void_plans or ())
    if not count:
        return ""
    return (
        f"{counted(count, 'plan')} {'was' if count == 1 else 'were'} discarded on the way, because the map, the "
        "area's border or a current made the next legs impossible. What that costs is charged to the bound."
    )


def _outside(e: Evaluation) -> str:
    s = e.summary
    if not any(s.outside_s):
        return ""
    tracks = "true" if all(len(v.truth) for v in e.run.vehicles) else "estimated"
    return (
        f"{'Vehicles were' if s.vehicles > 1 else 'The vehicle was'} outside the area for up to "
        f"{max(s.outside_s):.0f} s, by up to {max(s.outside_max_m):.1f} m "
        f"({tracks} tracks)."
    )


def _loss(s: Summary) -> str:
    if s.loss_after is None:
        return ""
    verdict = "the two agree"
    less, more = sorted((s.loss_expected, s.loss_after))
    if more >= NEGLIGIBLE_LOSS and more > EQUAL * less:
        much = "" if more > CLOSE * less else "slightly "
        verdict = f"the map is {much}{'conservative' if more == s.loss_expected else 'overconfident'}"
    return (
        f"Expected loss {_three(s.loss_expected)} per location, actual loss {_three(s.loss_after)}: {verdict}. Loss "
        "counts wrong calls by the standard deviation that the soundings show; map risk uses the prior's, which is "
        "wider."
    )


def _link(s: Summary) -> str:
    if s.vehicles < 2:
        return ""
    if not s.packets_sent:
        return "No packet was sent, so each vehicle mapped alone."
    possible = s.packets_received + s.packets_lost
    text = f"Acoustic link: {counted(s.packets_sent, 'packet')} sent"
    if possible:
        text += (
            f"; {s.packets_lost:,} of {counted(possible, 'possible reception')} lost "
            f"({_percent(s.packets_lost / possible)})"
        )
    if not s.samples_received:
        return f"{text}. No sample was received, so each vehicle mapped alone."
    return (
        f"{text}. The vehicles received {counted(s.samples_received, 'sample')} from each other, which cut the mean "
        f"map risk of a vehicle's own map from {_three(float(np.mean(s.alone_risk)))} to "
        f"{_three(float(np.mean(s.local_risk)))}; the team's final map has {_three(s.risk_after)}."
    )


def _position(s: Summary) -> str:
    if s.navigation_error_m is None:
        return ""
    text = f"RMS position error of the vehicle{'s' if s.vehicles > 1 else ''}: {number(s.navigation_error_m, 2)} m."
    if s.isobath_error_true_positions_m is None or s.isobath_error_m is None:
        return text
    now, ideal = f"{s.isobath_error_m:.1f} m", f"{s.isobath_error_true_positions_m:.1f} m"
    if now == ideal:
        return f"{text} With every sounding at its true position, the error of the whole line would be the same, {now}."
    return text + (
        " With every sounding at its true position, the error of the whole line, guesses included, would be "
        f"{ideal} instead of {now}."
    )


def paper_paragraphs(s: Summary) -> list[str]:
    """The paper's reward and its lower bound, explained; nothing for other methods."""
    if s.method not in PAPER_METHODS or not s.steps:
        return []
    texts = [
        "The paper rewards a path by the drop of Bayes risk at the path's own locations, not over the map. Summed leg "
        f"by leg, as the paper defines it, this mission earned {number(s.team_reward)}."
    ]
    if s.lower_bound is not None:
        texts.append(
            f"The largest lower bound was {number(s.lower_bound)}. The bound credits the whole naive path against "
            "today's data, while a leg is credited only with the risk left when it was travelled. The two do not add "
            "up, so the sum ends below the bound in nearly every mission, good or bad."
        )
    texts.append(
        f"As one whole path the mission earned {number(s.path_reward)}; a lawnmower was expected to earn "
        f"{number(s.lawnmower_value)}. Nearly every path comes close to the maximum here, because its own locations "
        "are measured in the end. Map risk separates good missions from bad ones; this reward hardly does."
    )
    return texts


def _level(e: Evaluation) -> str:
    return f"{e.settings[0].level_set.level_m:g} m"


def _team(s: Summary) -> str:
    return "The vehicles" if s.vehicles > 1 else "The vehicle"


def _m(length_m: float) -> str:
    return f"{length_m:,.0f} m"


def is_length(length_m: float) -> bool:
    """Whether a length is shown as more than 0 m."""
    return length_m > 0.5


def _is_area(area_m2: float, s: Summary) -> bool:
    """Whether an area is large enough to be named: 500 m2, or half a percent of a small operating area."""
    return area_m2 > min(500.0, 0.005 * s.area_m2)


def _three(value: float) -> str:
    return number(value, 3)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"
