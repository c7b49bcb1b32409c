"""Checks for the tests: an agreeing one, a deviating one, a failing one, one with nonsense, one without figures."""

import math

from anser.verification import Check
from anser.verification.checks import Comparison


def _check(key: str, measure) -> Check:
    return Check(key, f"{key}, made up", "[XY] tab. 1", "half the last digit", "Made up for a test.", measure)


def _broken():
    raise ArithmeticError("no such [figure]")


GOOD = _check(
    "good",
    lambda: (
        Comparison("alpha", "V 300 ft/s", "deg", 8.49, 8.4926, 0.005),
        Comparison("alpha", "V 400 ft/s", "deg", 4.16, 4.1571, 0.005, time_s=30.0, reference="sim_05"),
        Comparison("altitude_ft", "t 0 s", "ft", None, 30000.0, None),
        Comparison("altitude_ft", "t 30 s", "ft", None, 15598.9, None),
    ),
)
WRONG = _check(
    "wrong",
    lambda: (
        Comparison("alpha", "V 300 ft/s", "deg", 8.49, 8.4926, 0.005),
        Comparison("alpha", "V 400 ft/s", "deg", 4.17, 4.1571, 0.005),
        Comparison("alpha", "V 500 ft/s", "deg", 2.18, 2.1434, 0.005, tolerance_reason="my own"),
    ),
)
BROKEN = _check("broken", _broken)
EMPTY = _check("empty", lambda: ())
NONSENSE = _check(
    "nonsense",
    lambda: (
        Comparison("x", "here", "m", 1.0, math.nan, 0.1),
        Comparison("y", "here", "m", None, -math.inf, None),
        Comparison("z", "here", "m", 2.0, 2.0, 0.1),
    ),
)
FLOWN = _check(
    "flown",
    lambda: (
        Comparison("altitude_ft", "t 0 s", "ft", None, 30000.0, None, time_s=0.0),
        Comparison("altitude_ft", "t 30 s", "ft", None, 15598.9, None, time_s=30.0),
    ),
)
"""Nothing to compare with."""
ALL = (GOOD, WRONG, BROKEN, EMPTY, NONSENSE)
