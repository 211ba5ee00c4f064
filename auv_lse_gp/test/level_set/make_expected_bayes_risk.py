"""Makes expected_bayes_risk.csv, the reference values of the search objective, by integration with 55 digits.

The expected Bayes risk after planned measurements is integrated as it is defined, not by the closed form that the
package uses: E = integral over mu of N(mu; mean, std_of_mean^2) r(mu), with r(mu) = min(c1 P(f < l), c2 P(f >= l)) the
Bayes risk of a depth f that is normal with mean mu and standard deviation std_after. Gauss-Legendre quadrature in
pieces (mpmath), cut at the location where the best call changes; a value is accepted when a rule of half the nodes
agrees with it to 30 digits.

    python auv_lse_gp/test/make_expected_bayes_risk.py               # writes the table, in some minutes
    python auv_lse_gp/test/make_expected_bayes_risk.py --check FILE  # compares another table of the same columns
"""

from __future__ import annotations

import argparse
import csv
import functools
import itertools
import math
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
from mpmath import mp, mpf

COLUMNS = (
    "mean_m",
    "std_of_mean_m",
    "std_after_m",
    "level_m",
    "cost_false_safe",
    "cost_false_unsafe",
    "expected_bayes_risk",
)
TABLE = Path(__file__).with_name("expected_bayes_risk.csv")
#: Decimal digits of the arithmetic, and of the values in the table.
DIGITS, TABLE_DIGITS = 55, 20

#: Mean, std_of_mean, std_after, level, c1, c2.
Case = tuple[float, float, float, float, float, float]

#: Degenerate and extreme cases.
SPECIAL: list[Case] = [
    (15.0, 1.0, 1.0, 15.0, 10.0, 10.0),  # 2 c T(0, 1) = 2.5
    (15.0, 0.0, 2.0, 15.0, 10.0, 4.0),  # nothing is learned, at the level: min(c1, c2) / 2
    (13.0, 0.0, 2.0, 15.0, 10.0, 4.0),  # nothing is learned
    (15.0, 3.0, 0.0, 15.0, 10.0, 4.0),  # all will be known: 0
    (14.0, 0.0, 0.0, 15.0, 10.0, 4.0),  # all is known: 0
    (15.0, 0.0, 0.0, 15.0, 10.0, 10.0),  # all is known, at the level: 0
    (15.0, 1e-8, 1.0, 15.0, 10.0, 4.0),  # nearly nothing is learned
    (15.5, 1e-6, 1.0, 15.0, 10.0, 10.0),
    (15.0, 1.0, 1e-8, 15.0, 10.0, 4.0),  # nearly all will be known
    (15.5, 1.0, 1e-6, 15.0, 10.0, 10.0),
    (15.0, 3.0, 2.0, 15.0, 10.0, 4.0),  # at the level, unequal costs
    (15.0, 3.0, 2.0, 15.0, 4.0, 10.0),
    (15.0, 1e-5, 1e-5, 15.0, 10.0, 10.0),  # tiny deviations
    (15.00001, 1e-5, 2e-5, 15.0, 1.0, 30.0),
    (14.0, 300.0, 200.0, 15.0, 10.0, 10.0),  # huge deviations
    (500.0, 40.0, 90.0, 450.0, 2.0, 7.0),
    (23.0, 1.0, 0.5, 15.0, 10.0, 10.0),  # far from the level
    (7.0, 0.5, 1.0, 15.0, 10.0, 10.0),
    (25.0, 1.0, 1.0, 15.0, 10.0, 1.0),
    (5.0, 1.0, 0.2, 15.0, 1.0, 10.0),
    (15.3, 1.0, 1.0, 15.0, 1e4, 1.0),  # very unequal costs
    (15.3, 1.0, 1.0, 15.0, 1.0, 1e4),
    (12.0, 2.0, 0.1, 15.0, 1e-3, 1e3),
    (16.0, 0.1, 2.0, 15.0, 1e3, 1e-3),
    (14.9, 2.0, 3.0, 15.0, 1e-6, 1e-6),  # small and large costs
    (14.9, 2.0, 3.0, 15.0, 1e6, 1e6),
    (15.0, 2.0, 1.0, 15.0, 10.0, 10.000001),  # nearly equal costs
    (15.2, 2.0, 1.0, 15.0, 10.0, 9.999999),
]


def cases() -> list[Case]:
    """The special cases, and random ones of a fixed seed over all scales that a mission may meet, and beyond."""
    rng = random.Random(1)
    drawn: list[Case] = []
    for number in range(73):
        wide = number % 3 == 0
        total, share = 10.0 ** rng.uniform(-2.0, 1.5), rng.random()
        of_mean, after = total * math.sqrt(share), total * math.sqrt(1.0 - share)
        if wide:
            of_mean, after = total, total * 10.0 ** rng.uniform(-3.0, 3.0)
        gap = math.hypot(of_mean, after) * rng.gauss(0.0, 3.0 if wide else 1.0)
        c1 = 10.0 ** rng.uniform(-1.0, 2.0) if number % 2 else 10.0
        c2 = c1 if number % 4 == 0 else 10.0 ** rng.uniform(-1.0, 2.0)
        drawn.append((15.0 + gap, of_mean, after, 15.0, c1, c2))
    return SPECIAL + drawn


def p_below(x: Any) -> Any:
    """P(X < x) of a standard normal X."""
    return mpmath.erfc(-x / mpmath.sqrt(2)) / 2


def risk(mu: Any, std: Any, level: Any, c1: Any, c2: Any) -> Any:
    """Bayes risk of the best call about a normal depth; nothing is at risk where the depth is known."""
    if std == 0:
        return mpf(0)
    h = (level - mu) / std
    return min(c1 * p_below(h), c2 * p_below(-h))


def expected_risk(case: Case) -> Any:
    """The expected Bayes risk of a case, in the working precision.

    Raises:
        ArithmeticError: if two rules of integration differ.
    """
    mean, of_mean, after, level, c1, c2 = (mpf(value) for value in case)  # a double is exact
    if of_mean == 0:
        return risk(mean, after, level, c1, c2)
    if after == 0:
        return mpf(0)
    z = mpmath.sqrt(2) * mpmath.erfinv((c2 - c1) / (c1 + c2))  # P(f < l) = c2 / (c1 + c2) where the best call changes
    kink = level - z * after
    # Beyond so many standard deviations the integrand is less than 1e-50 of its largest value.
    far = abs(level - mean) / mpmath.sqrt(of_mean**2 + after**2) + abs(z) + 16
    low, high = max(mean - far * of_mean, level - far * after), min(mean + far * of_mean, level + far * after)
    steps = range(-int(far), int(far) + 1)
    cuts = sorted({*(mean + k * of_mean for k in steps), *(level + k * after for k in steps)})
    # Where both deviations are alike, cuts of one are enough; the ends and the kink always stay.
    ends, apart = [x for x in (low, kink, high) if low <= x <= high], min(of_mean, after) / 4
    for x in cuts:
        if low < x < high and all(abs(x - end) > apart for end in ends):
            ends.append(x)
    ends.sort()

    def integrand(mu: Any) -> Any:
        density = mpmath.exp(-(((mu - mean) / of_mean) ** 2) / 2) / (of_mean * mpmath.sqrt(2 * mpmath.pi))
        return density * risk(mu, after, level, c1, c2)

    rough, value = (
        mpmath.fsum(integral(integrand, a, b, rule(degree)) for a, b in itertools.pairwise(ends)) for degree in (5, 6)
    )
    if abs(rough - value) > mpf(10) ** -30 * abs(value):
        raise ArithmeticError(f"{case}: two rules differ: {rough} and {value}")
    return value


def integral(function: Callable[[Any], Any], a: Any, b: Any, nodes: list[tuple[Any, Any]]) -> Any:
    """Integral from a to b by a Gauss-Legendre rule."""
    half, middle = (b - a) / 2, (a + b) / 2
    return half * mpmath.fsum(weight * function(middle + half * x) for x, weight in nodes)


@functools.cache
def rule(degree: int) -> list[tuple[Any, Any]]:
    """Nodes and weights of the Gauss-Legendre rule with 3 * 2^(degree - 1) nodes."""
    nodes: list[tuple[Any, Any]] = mpmath.calculus.quadrature.GaussLegendre(mp).calc_nodes(degree, mp.prec)
    return nodes


def as_text(value: Any) -> str:
    """A value as it stands in the table."""
    return str(mpmath.nstr(value, TABLE_DIGITS, strip_zeros=False) if value else "0.0")


def main() -> int:
    """Command line. Returns 1 if a checked table differs by more than 1e-18 of the costs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", type=Path, metavar="FILE", help="compare a table of the same columns")
    options = parser.parse_args()
    mp.dps = DIGITS
    if options.check is None:
        with TABLE.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for case in cases():
                writer.writerow([*map(repr, case), as_text(expected_risk(case))])
        return 0
    largest = mpf(0)
    with options.check.open(newline="") as file:
        for row in csv.DictReader(file):
            case = tuple(float(row[name]) for name in COLUMNS[:-1])
            value = expected_risk(case)  # type: ignore[arg-type]  # six numbers
            largest = max(largest, abs(value - mpf(row[COLUMNS[-1]])) / (mpf(case[4]) + mpf(case[5])))
    print(f"largest difference / (c1 + c2): {mpmath.nstr(largest, 3)}")
    return int(largest > mpf(10) ** -18)


if __name__ == "__main__":
    sys.exit(main())
