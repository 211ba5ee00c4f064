"""The paper's claims, one by one, compared with what was measured here.

A claim about a mean is supported if the 95 % confidence interval of the paired difference over seeds lies on its side
of zero, contradicted if it lies on the other side, and undecided if it contains zero. "At least as good" is also
supported by an interval that contains zero but nothing worse than -5 %. Seeds share lakes, sensor errors and channel,
so differences are taken seed by seed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from auv_lse_common.support.plurals import counted
from auv_lse_shore.campaign.rows import Row, by_seed, value_of
from auv_lse_shore.campaign.statistics import Interval, interval, paired
from auv_lse_shore.reproduce.study import OURS

SUPPORTED, CONTRADICTED, UNDECIDED = "supported", "contradicted", "undecided"

#: The prior: a constant depth, or a coarse chart (`study.CHART`).
FLAT, CHART = "flat", "chart"

#: A local map counts as close to the map from all soundings if they differ by less than this share of the risk at
#: the start. The paper says "small" and gives no number.
SMALL = 0.05

#: With fewer seeds than this, verdicts are undecided.
MIN_SEEDS = 5

#: "At least as good" holds if the interval of the difference excludes being worse by more than this share.
MARGIN = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """One measurement for or against a claim.

    Attributes:
        what: What was measured, with its unit.
        value: The result, as text.
        verdict: `SUPPORTED`, `CONTRADICTED` or `UNDECIDED`.
        prior: `FLAT` or `CHART`.
    """

    what: str
    value: str
    verdict: str
    prior: str = FLAT


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A claim of the paper, or of this project, with its evidence.

    Attributes:
        remark: Limits of the evidence.
    """

    text: str
    source: str
    evidence: tuple[Evidence, ...]
    remark: str = ""

    def verdicts(self) -> str:
        """The verdicts with each prior, counted, in one sentence."""
        parts = []
        for prior, name in ((FLAT, "flat prior"), (CHART, "chart as prior")):
            found = [e.verdict for e in self.evidence if e.prior == prior]
            if found:
                counts = ", ".join(
                    f"{found.count(v)} {v}" for v in (SUPPORTED, UNDECIDED, CONTRADICTED) if found.count(v)
                )
                parts.append(f"{name}: {counts}")
        return "; ".join(parts) + "."


def verdict(difference: Interval, more_is_better: bool) -> str:
    """Whether a difference (a - b, a claimed to be better) supports the claim."""
    if difference.count < MIN_SEEDS:
        return UNDECIDED
    low, high = (difference.low, difference.high) if more_is_better else (-difference.high, -difference.low)
    return SUPPORTED if low > 0.0 else CONTRADICTED if high < 0.0 else UNDECIDED


def not_worse(difference: Interval, other: float, more_is_better: bool) -> str:
    """Whether a difference supports "at least as good as `other`": no worse by more than `MARGIN` of it."""
    found = verdict(difference, more_is_better)
    if found == UNDECIDED and difference.count >= MIN_SEEDS:
        low = difference.low if more_is_better else -difference.high
        return SUPPORTED if low > -MARGIN * abs(other) else UNDECIDED
    return found


#: Measures in which methods are compared: column, name with unit, more is better.
COMPARED = (
    ("team_reward", "team reward, stepwise (cost)", True),
    ("path_reward", "path reward (cost)", True),
    ("risk_third", "map risk after a third (cost per location)", False),
    ("risk_after", "final map risk (cost per location)", False),
    ("f1", "F1", True),
    ("isobath_error_m", "isobath error (m)", False),
)


def compare(a: Sequence[Row], b: Sequence[Row], team: str, weak: bool) -> list[Evidence]:
    """Evidence that method a is better than b (`weak`: at least as good), in every measure."""
    found = []
    for column, name, more in COMPARED:
        difference = paired(by_seed(a, column), by_seed(b, column))
        if difference.count:
            other = interval([value_of(r, column) for r in b]).mean
            judged = not_worse(difference, other, more) if weak else verdict(difference, more)
            won = _better(by_seed(a, column), by_seed(b, column), more)
            value = (
                f"{difference} ({'more' if more else 'less'} is better; better with {won} of {difference.count} seeds)"
            )
            found.append(Evidence(what=f"{team}: difference in {name}", value=value, verdict=judged))
    return found


def _better(a: Mapping[int, float | None], b: Mapping[int, float | None], more: bool) -> int:
    """Number of seeds with which a is better than b."""
    pairs = [(value, b.get(seed)) for seed, value in a.items()]
    return sum((x > y) if more else (x < y) for x, y in pairs if x is not None and y is not None)


def share(flags: Sequence[bool | None], what: str) -> Evidence | None:
    """Evidence from a share of missions: supported if all, contradicted if fewer than 95 %."""
    known = [flag for flag in flags if flag is not None]
    if not known:
        return None
    held = sum(known)
    judged = SUPPORTED if held == len(known) else CONTRADICTED if held < 0.95 * len(known) else UNDECIDED
    judged = judged if len(known) >= MIN_SEEDS else UNDECIDED
    return Evidence(what=what, value=f"{held} of {len(known)} missions", verdict=judged)


def claims(
    groups: Mapping[tuple[int, str], Sequence[Row]],
    charted: Mapping[tuple[int, str], Sequence[Row]] | None = None,
) -> list[Claim]:
    """Every claim with its evidence, from missions with a flat prior and with a chart.

    Args:
        groups: Finished rows by (number of vehicles, method), with a flat prior.
        charted: The same with a coarse chart as prior.
    """
    found = _claims(groups)
    with_chart = {claim.text: claim for claim in _claims(charted or {})}
    merged = []
    for claim in [*found, *(c for text, c in with_chart.items() if text not in {f.text for f in found})]:
        flat = claim.evidence if claim in found else ()
        more = with_chart[claim.text].evidence if claim.text in with_chart else ()
        merged.append(replace(claim, evidence=(*flat, *(replace(e, prior=CHART) for e in more))))
    return merged


def _claims(groups: Mapping[tuple[int, str], Sequence[Row]]) -> list[Claim]:
    teams = sorted({vehicles for vehicles, _ in groups})
    found = [_augmented_against_plain(groups, teams), _above_the_bound(groups, teams), _local_maps(groups, teams)]
    found += [_against_lawnmower(groups, teams, "augmented"), _ours(groups, teams)]
    return [claim for claim in found if claim.evidence]


def _differences(
    groups: Mapping[tuple[int, str], Sequence[Row]],
    teams: Sequence[int],
    a: str,
    b: str,
    what: str = "",
    weak: bool = False,
) -> list[Evidence]:
    """Evidence that method a is better than b, for each team; `what` follows the team's name."""
    pairs = [(k, groups.get((k, a), ()), groups.get((k, b), ())) for k in teams]
    return [e for k, own, others in pairs for e in compare(own, others, f"{k} AUVs{what}", weak)]


def _augmented_against_plain(groups: Mapping[tuple[int, str], Sequence[Row]], teams: Sequence[int]) -> Claim:
    return Claim(
        text="Planning with the naive path as terminal reward (augmented, m = 3) does at least as well as planning "
        "without it (plain, m = 10).",
        source="section 6, figure of team reward: 'performs no worse ... In fact, it performs better'",
        evidence=tuple(_differences(groups, teams, "augmented", "plain", weak=True)),
        remark="The paper shows one field trial per method and team. Differences are augmented − plain.",
    )


def _above_the_bound(groups: Mapping[tuple[int, str], Sequence[Row]], teams: Sequence[int]) -> Claim:
    evidence: list[Evidence | None] = []
    for k in teams:
        rows, lawn = groups.get((k, "augmented"), ()), groups.get((k, "lawnmower"), ())
        team = f"{k} AUVs: "
        for column, text in (
            ("bound_kept", "stepwise reward at least the largest time-varying lower bound"),
            ("path_bound_kept", "path reward at least the value expected of the lawnmower"),
        ):
            evidence.append(share([r[column] for r in rows], team + text))
        for column, name in (("team_reward", "stepwise reward"), ("path_reward", "path reward")):
            difference = paired(by_seed(rows, column), by_seed(lawn, column))
            if difference.count:
                text = f"{team}{name} less that of a lawnmower over the same lakes (cost)"
                value = f"{difference} ({counted(difference.count, 'seed')})"
                floor = interval([value_of(r, column) for r in lawn]).mean
                evidence.append(Evidence(what=text, value=value, verdict=not_worse(difference, floor, True)))
    return Claim(
        text="The mission's reward stays above the lower bound, which is the reward of a lawnmower mission.",
        source="section 6: 'the lower bound guarantee ... may be achieved despite non-idealities'",
        evidence=tuple(e for e in evidence if e is not None),
        remark="The stepwise reward does not telescope: the bound credits the whole naive part against today's data, "
        "the reward credits each leg against all data before it. The first line is the figure's literal comparison; "
        "the others compare like with like.",
    )


def _local_maps(groups: Mapping[tuple[int, str], Sequence[Row]], teams: Sequence[int]) -> Claim:
    evidence: list[Evidence] = []
    for k in teams:
        for method in ("augmented", "plain"):
            rows = groups.get((k, method), ())
            if not rows:
                continue
            error = interval([value_of(r, "local_risk_error") for r in rows])
            before = interval([value_of(r, "risk_before") for r in rows]).mean
            after = interval([value_of(r, "risk_after") for r in rows]).mean
            delivery = interval([value_of(r, "delivery") for r in rows])
            judged = UNDECIDED
            if error.count >= MIN_SEEDS:
                limit = SMALL * before
                judged = SUPPORTED if error.high < limit else CONTRADICTED if error.low > limit else UNDECIDED
            evidence.append(
                Evidence(
                    what=f"{k} AUVs, {method}: mean |own risk − risk given all| (cost per location), "
                    f"at {100.0 * delivery.mean:.0f} % of packets delivered",
                    value=f"{error}: {100.0 * error.mean / before:.1f} % of the risk before, "
                    f"{100.0 * error.mean / after:.0f} % of the risk after",
                    verdict=judged,
                )
            )
    return Claim(
        text="Given the limited bandwidth and lost packets, the error of each vehicle's local map is small.",
        source="section 6, figure of posterior risk error",
        evidence=tuple(evidence),
        remark=f"The paper gives no number; here small means less than {100 * SMALL:.0f} % of the risk at the start.",
    )


def _against_lawnmower(groups: Mapping[tuple[int, str], Sequence[Row]], teams: Sequence[int], method: str) -> Claim:
    return Claim(
        text="The area is searched more efficiently than with a lawnmower mission of the same length.",
        source="introduction: 'allowing the area to be searched much more quickly and efficiently'",
        evidence=tuple(_differences(groups, teams, method, "lawnmower")),
        remark=f"Differences are {method} − lawnmower; each vehicle mows its own strip.",
    )


def _ours(groups: Mapping[tuple[int, str], Sequence[Row]], teams: Sequence[int]) -> Claim:
    evidence: list[Evidence] = []
    for k in teams:
        for other in ("augmented", "plain", "lawnmower"):
            found = _differences(groups, [k], OURS, other, f", {other}")
            evidence += [e for e in found if "reward" not in e.what]
    return Claim(
        text=f"Our own method ('{OURS}') maps better than the paper's two and the lawnmower.",
        source="not in the paper: this project's claim",
        evidence=tuple(evidence),
        remark=f"Differences are {OURS} − the other method.",
    )
