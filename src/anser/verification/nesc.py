"""The NESC check-cases as checks: published checkpoints where there are any, listed results where there are none."""

import functools
from typing import Any

from anser.verification.check import Check, Comparison
from anser.verification.nesc_cases import FREE_FLIGHTS, TRIMMED_FLIGHTS, FreeFlight, TrimmedFlight
from anser.verification.nesc_flight import LOG_PERIOD_S, Log, fly_free, fly_trimmed
from anser.verification.published import half_of_significant, published

_SOURCE = "NASA/TM-2015-218675"
_DIGITS = 10
"""Significant digits with which the checkpoints are given."""

_EXPLANATION = (
    "The reference is participants 04 and 05 of the published data, which agree best with one another; each "
    "tolerance comes from the scatter between the two, plus half a unit of the tenth digit, with which the figures are "
    "given: the inertial position, 2e7 ft, is known to 0.005 ft only."
)
_LISTED = "Flown from the published definition; no figures for it come with this package. "
_NOTES = {
    3: "The damping acts on the rates relative to the rotating air, as with participant 05; 04 takes the inertial "
    "rates, 0.0038 deg/s apart.",
    4: "Sphere of 6371007.1809 m at rest with inverse-square gravitation.",
    5: "Sphere of 6371007.1809 m rotating with 7.292115e-5 rad/s, inverse-square gravitation.",
    8: "East wind component -20 + 0.003 h ft/s.",
    11: "Trimmed with wings level and without sideslip, so that Coriolis and the turning of the meridians turn it "
    "slowly; controls and power held, no lags, no engine momentum. The scatter is that of the participants' trims.",
    12: "As case 11, with the subsonic tables held at their ends: the thrust is that of Mach 1.",
}


def _check(case: FreeFlight | TrimmedFlight) -> Check:
    given = _checkpoints(case) is not None
    return Check(
        key=f"nesc-{case.number:02d}",
        title=f"NESC case {case.number}: {case.title}",
        source=f"{_SOURCE}, case {case.number}",
        why="scatter of sims 04, 05" if given else "no figure given",
        explanation=" ".join(filter(None, [_EXPLANATION if given else _LISTED.strip(), _NOTES.get(case.number, "")])),
        measure=functools.partial(_measure, case),
    )


def _checkpoints(case: FreeFlight | TrimmedFlight) -> dict[str, Any] | None:
    """Published figures of a case; None where there are none."""
    return published("nesc_checkpoints")["cases"].get(f"{case.number:02d}")


@functools.cache
def _logs(trimmed: bool) -> dict[int, Log]:
    """All cases of a kind are flown at once; they compile once, too."""
    return fly_trimmed(TRIMMED_FLIGHTS) if trimmed else fly_free(FREE_FLIGHTS)


def _measure(case: FreeFlight | TrimmedFlight) -> tuple[Comparison, ...]:
    """Every checkpoint of every column that has a tolerance, against both participants; or all that is logged."""
    log, given = _logs(isinstance(case, TrimmedFlight))[case.number], _checkpoints(case)
    if given is None:
        return tuple(_comparison(name, log, time_s) for name in log for time_s in case.times_s)
    return tuple(
        _comparison(name, log, time_s, simulation, column[simulation][k], column["tolerance"])
        for name, column in given["columns"].items()
        if "tolerance" in column
        for simulation in ("sim_04", "sim_05")
        for k, time_s in enumerate(given["times_s"])
    )


def _comparison(
    name: str, log: Log, time_s: float, simulation: str = "", expected: float | None = None, tolerance: float = 0.0
) -> Comparison:
    """One column at a time, against a participant where a figure is given."""
    obtained = float(log[name][round(time_s / LOG_PERIOD_S)])
    if expected is not None and name.startswith("eulerAngle"):
        obtained += 360.0 * round((expected - obtained) / 360.0)
    half_digit = half_of_significant(expected, _DIGITS) if expected else 0.0
    return Comparison(
        group=name,
        where=f"t {time_s:g} s, {simulation}" if simulation else f"t {time_s:g} s",
        unit=next((unit for suffix, unit in _UNITS if suffix in name), "1"),
        expected=expected,
        obtained=obtained,
        tolerance=None if expected is None else tolerance + half_digit,
        time_s=float(time_s),
        reference=simulation,
    )


_UNITS = (
    ("_ft_s2", "ft/s^2"),
    ("_ft_s", "ft/s"),
    ("_ft_min", "ft/min"),
    ("_ftlbf", "ft lbf"),
    ("_lbf_ft2", "lbf/ft^2"),
    ("_lbf", "lbf"),
    ("_slug_ft3", "slug/ft^3"),
    ("_deg_s", "deg/s"),
    ("_dgR", "deg R"),
    ("_nmi_h", "nmi/h"),
    ("_deg", "deg"),
    ("_ft", "ft"),
)
"""Units that the names of the published columns carry."""

NESC_CHECKS: tuple[Check, ...] = tuple(_check(case) for case in (*FREE_FLIGHTS, *TRIMMED_FLIGHTS))
"""Cases 1 to 12."""
