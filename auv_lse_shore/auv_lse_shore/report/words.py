"""What a mission achieved, in words: the lines that a terminal shows, and the paragraphs of the report."""

from __future__ import annotations

import numpy as np

from auv_lse_common.mission_file.methods import PAPER_METHODS
from auv_lse_shore.judge.certainty import FLAT, FOUND, NOT_VISITED, PLACES_UNCERTAIN, VISITED_M, Piece
from auv_lse_shore.judge.evaluation import SURE, Evaluation
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.report.page_parts import number

#: Stretches that the report names one by one, at most.
NAMED = 3

#: A stretch shorter than this (m) is not named.
NAMED_FROM_M = 10.0

#: The map's risk is called honest if the loss is within this factor of it.
HONEST = 1.5

_WHY = {
    NOT_VISITED: f"nobody measured within {VISITED_M:g} m of it",
    PLACES_UNCERTAIN: "the vehicles that measured there were unsure of their own places",
    FLAT: "the ground is so flat there that a small error in depth moves the line far",
}


def headlines(s: Summary) -> list[str]:
    """The main figures of a mission, one line each."""
    off = "" if s.isobath_found_error_m is None else f", {s.isobath_found_error_m:.1f} m off on average"
    share = "" if s.isobath_found is None else f"; {100.0 * s.isobath_found:.0f} % of the true isobath"
    lines = [
        f"isobath: {s.isobath_found_m:,.0f} m found{off}{share}; {s.isobath_likely_m:,.0f} m more likely, "
        f"{s.isobath_guessed_m:,.0f} m guessed"
    ]
    mowing = "" if s.mowing_risk is None else f" (expected of mowing the lawn: {s.mowing_risk:.3f}{_held(s)})"
    loss = "" if s.loss_after is None else f"; it really is {s.loss_after:.3f}"
    lines.append(f"map: Bayes risk {s.risk_before:.3f} -> {s.risk_after:.3f} per place{mowing}")
    lines.append(f"wrong calls: the map expects {s.loss_expected:.3f} of cost per place{loss}")
    if s.method in PAPER_METHODS:
        bound = "" if s.lower_bound is None else f", its printed bound {s.lower_bound:.0f}"
        lines.append(
            f"the paper's own reward: stepwise {s.team_reward:.0f}{bound}; as one path {s.path_reward:.0f}, "
            f"mowing the lawn {s.lawnmower_value:.0f} (docs/results.md says what these mean)"
        )
    lines.append(f"packets: {s.packets_sent} sent, {s.packets_received} received{_lost(s)}")
    return lines


def paragraphs(e: Evaluation) -> list[str]:
    """What was found, what is unsure and why, whether the bound held, and what the acoustic link cost."""
    s = e.summary
    texts = [_found(e), _sides(e), _unsure(e), _bound(s)]
    texts += [text for text in (_loss(s), _link(e), _navigation(s)) if text]
    return texts


def _found(e: Evaluation) -> str:
    s, level = e.summary, e.settings[0].level_set.level_m
    if s.isobath_length_m == 0.0:
        none = "" if s.isobath_true_m is None else f" The true one is {_m(s.isobath_true_m)} long."
        return f"The map shows no {level:g} m isobath at all.{none}"
    text = (
        f"{_m(s.isobath_found_m)} of the {level:g} m isobath were found. Another {_m(s.isobath_likely_m)} are likely, "
        f"and {_m(s.isobath_guessed_m)} are a guess that the data hardly support."
    )
    if s.isobath_true_m is None or s.isobath_found is None:
        return text
    if s.isobath_found_error_m is not None and s.isobath_found_error_p95_m is not None:
        text += (
            f" What was found is {s.isobath_found_error_m:.1f} m from the true isobath on average, and 95 % of it is "
            f"within {s.isobath_found_error_p95_m:.1f} m."
        )
    return text + (
        f" It passes within 10 m of {100.0 * s.isobath_found:.0f} % of the true isobath, which is "
        f"{_m(s.isobath_true_m)} long."
    )


def _sides(e: Evaluation) -> str:
    s, level = e.summary, e.settings[0].level_set.level_m
    return (
        f"{_area(s.deep_m2)} are at least {level:g} m deep and {_area(s.shallow_m2)} are shallower, each with a "
        f"probability of {100.0 * SURE:.0f} % or more. On the other {_area(s.unsure_m2)} "
        f"({100.0 * s.unsure_m2 / max(s.area_m2, 1.0):.0f} % of the area) the map cannot tell yet."
    )


def _unsure(e: Evaluation) -> str:
    s = e.summary
    lengths = {
        NOT_VISITED: s.isobath_not_visited_m,
        PLACES_UNCERTAIN: s.isobath_places_uncertain_m,
        FLAT: s.isobath_flat_m,
    }
    reasons = [(_m(length), f"because {_WHY[reason]}") for reason, length in lengths.items() if length >= 1.0]
    if not reasons:
        return "No part of the line is left unsure." if s.isobath_length_m else "So nothing of it can be unsure."
    longest = sorted((p for p in e.pieces if p.kind != FOUND), key=lambda p: p.length_m, reverse=True)
    named = [_stretch(p) for p in longest[:NAMED] if p.length_m >= NAMED_FROM_M]
    where = f" The longest stretches: {'; '.join(named)}." if named else ""
    return f"Of the line, {_listed(reasons, 'are not found')}.{where}"


def _stretch(piece: Piece) -> str:
    north, east = np.mean(piece.line, axis=0)
    return f"{_m(piece.length_m)} about north {north:.0f} m, east {east:.0f} m ({piece.kind}, {piece.reason})"


def _bound(s: Summary) -> str:
    text = f"The mean Bayes risk of a place fell from {number(s.risk_before, 3)} to {number(s.risk_after, 3)}."
    if s.mowing_risk is None or s.map_bound_kept is None:
        return text
    text += f" Mowing the lawn for as long was expected to leave {number(s.mowing_risk, 3)}"
    share = 100.0 * abs(1.0 - s.risk_after / s.mowing_risk) if s.mowing_risk > 0.0 else 0.0
    if not s.map_bound_promised:
        beside = "below" if s.map_bound_kept else "above"
        return f"{text}: this mission ended {share:.0f} % {beside} that. The method {s.method} promises nothing of it."
    text += ", the bound that the vehicles keep an account of: "
    if s.map_bound_kept:
        return text + f"it held, with {share:.0f} % less."
    return text + (
        f"this mission ended {share:.0f} % above it. The bound is an expectation over lakes like the prior's: a single "
        "lake can be harder than that."
    )


def _loss(s: Summary) -> str:
    if s.loss_after is None:
        return ""
    expects = (
        "These risks are by the prior's standard deviation, which planners need wide. By the one that its soundings "
        f"show, the map expects its wrong calls to cost {number(s.loss_expected, 3)} per place"
    )
    if s.loss_expected > HONEST * s.loss_after:
        return f"{expects}; they really cost {number(s.loss_after, 3)}: it is better than it believes."
    if s.loss_after > HONEST * s.loss_expected:
        return f"{expects}; they really cost {number(s.loss_after, 3)}: it trusts itself too much."
    return f"{expects}; they really cost {number(s.loss_after, 3)}, about as much."


def _link(e: Evaluation) -> str:
    s = e.summary
    if s.vehicles < 2:
        return ""
    possible = s.packets_sent * (s.vehicles - 1)
    if not possible:
        return "No packet was sent, so each vehicle mapped alone."
    lost = possible - s.packets_received
    text = (
        f"The acoustic link: {s.packets_sent} packets were sent, and each could be heard by "
        f"{'the other vehicle' if s.vehicles == 2 else f'{s.vehicles - 1} others'}. Of these {possible} receptions, "
    )
    if lost:
        text += f"{lost} were lost ({100.0 * lost / possible:.0f} %). The others"
    else:
        text += "none was lost. They"
    text += f" brought {s.samples_received:,} samples of mates."
    alone, own = np.mean(s.alone_risk), np.mean(s.local_risk)
    return text + (
        f" With its own soundings alone a vehicle's map would have kept a risk of {number(float(alone), 3)} per place "
        f"on average; with the mates' samples it kept {number(float(own), 3)}. The map of all soundings, which nobody "
        f"had under water, has {number(s.risk_after, 3)}: the difference is what the link cost."
    )


def _navigation(s: Summary) -> str:
    if s.navigation_error_m is None:
        return ""
    text = f"The vehicles' own place error was {number(s.navigation_error_m, 2)} m RMS."
    if s.isobath_error_true_positions_m is None or s.isobath_error_m is None:
        return text
    return text + (
        f" With the soundings at their true places the whole line, guesses included, would be off by "
        f"{s.isobath_error_true_positions_m:.1f} m instead of {s.isobath_error_m:.1f} m."
    )


def paper_paragraphs(s: Summary) -> list[str]:
    """The paper's own reward and its printed bound, explained; nothing for other methods."""
    if s.method not in PAPER_METHODS:
        return []
    texts = [
        "The paper rewards a path by the drop of Bayes risk at the path's own places, not over the map. Summed leg by "
        f"leg as printed, this mission earned {number(s.team_reward)}."
    ]
    if s.lower_bound is not None:
        texts.append(
            f"The largest printed lower bound was {number(s.lower_bound)}. It credits the whole naive path against "
            "today's data at all its places, while a leg is credited only with what was left when it was travelled: "
            "the two do not add up, and the sum ends below that bound in nearly every mission, good or bad."
        )
    texts.append(
        f"Taken as one path, the mission earned {number(s.path_reward)}, where mowing the lawn was expected to earn "
        f"{number(s.lawnmower_value)}. Nearly every path earns nearly the most possible in this reading, since it "
        "knows its own places in the end; so it hardly tells good missions from bad ones. The map does."
    )
    return texts


def _held(s: Summary) -> str:
    if not (s.map_bound_promised and s.map_bound_kept is not None):
        return ""
    return "; the bound held" if s.map_bound_kept else "; the bound did not hold on this lake"


def _lost(s: Summary) -> str:
    lost = s.packets_sent * (s.vehicles - 1) - s.packets_received
    return f", {lost} receptions lost" if s.vehicles > 1 else ""


def _listed(parts: list[tuple[str, str]], verb: str) -> str:
    """`5 m are not found because ..., 3 m because ..., and 2 m because ...`."""
    (length, why), *others = parts
    texts = [f"{length} {verb} {why}", *(" ".join(part) for part in others)]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])}, and {texts[-1]}"


def _m(length_m: float) -> str:
    return f"{length_m:,.0f} m"


def _area(area_m2: float) -> str:
    return f"{area_m2 / 1e4:.1f} ha"
