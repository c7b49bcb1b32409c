"""The NESC check-cases as checks: published checkpoints where there are any, listed results where there are none."""

import functools
import json
from importlib import resources
from typing import Any

from anser.verification.check import Check, Comparison
from anser.verification.nesc_cases import FREE_FLIGHTS, TRIMMED_FLIGHTS, FreeFlight, TrimmedFlight
from anser.verification.nesc_flight import LOG_PERIOD_S, Log, fly_free, fly_trimmed

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
    key = f"{case.number:02d}"
    given = key in _checkpoints()["cases"]
    return Check(
        key=f"nesc-{key}",
        title=f"NESC case {case.number}: {case.title}",
        source=f"{_SOURCE}, case {case.number}",
        why="scatter of sims 04, 05" if given else "no figure given",
        explanation=" ".join(filter(None, [_EXPLANATION if given else _LISTED.strip(), _NOTES.get(case.number, "")])),
        measure=functools.partial(_compared if given else _listed, case),
    )


@functools.cache
def _checkpoints() -> dict[str, Any]:
    text = resources.files("anser.verification").joinpath("data/nesc_checkpoints.json").read_text(encoding="utf-8")
    return json.loads(text)


@functools.cache
def _logs(trimmed: bool) -> dict[int, Log]:
    """All cases of a kind are flown at once; they compile once, too."""
    return fly_trimmed(TRIMMED_FLIGHTS) if trimmed else fly_free(FREE_FLIGHTS)


def _log(case: FreeFlight | TrimmedFlight) -> Log:
    return _logs(isinstance(case, TrimmedFlight))[case.number]


def _compared(case: FreeFlight | TrimmedFlight) -> tuple[Comparison, ...]:
    """Every checkpoint of every column that has a tolerance, against both participants."""
    published = _checkpoints()["cases"][f"{case.number:02d}"]
    log = _log(case)
    return tuple(
        _comparison(name, log, time_s, simulation, column[simulation][k], column["tolerance"])
        for name, column in published["columns"].items()
        if "tolerance" in column
        for simulation in ("sim_04", "sim_05")
        for k, time_s in enumerate(published["times_s"])
    )


def _comparison(name: str, log: Log, time_s: float, simulation: str, expected: float, tolerance: float) -> Comparison:
    obtained = _at(log, name, time_s)
    if name.startswith("eulerAngle"):
        obtained += 360.0 * round((expected - obtained) / 360.0)
    last_digit = float(f"{abs(expected):.{_DIGITS - 1}e}".split("e")[1]) - (_DIGITS - 1) if expected else -300.0
    return Comparison(
        group=name,
        where=f"t {time_s:g} s, {simulation}",
        unit=_unit(name),
        expected=expected,
        obtained=obtained,
        tolerance=tolerance + 0.5 * 10.0**last_digit,
        time_s=float(time_s),
        reference=simulation,
    )


def _listed(case: FreeFlight | TrimmedFlight) -> tuple[Comparison, ...]:
    """Every column at every time of the case."""
    log = _log(case)
    return tuple(
        Comparison(
            group=name,
            where=f"t {time_s:g} s",
            unit=_unit(name),
            expected=None,
            obtained=_at(log, name, time_s),
            tolerance=None,
            time_s=time_s,
        )
        for name in log
        for time_s in case.times_s
    )


def _at(log: Log, name: str, time_s: float) -> float:
    return float(log[name][round(time_s / LOG_PERIOD_S)])


def _unit(column: str) -> str:
    """Unit of a published column, which its name carries."""
    for suffix, unit in _UNITS:
        if suffix in column:
            return unit
    return "1"


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

NESC_CHECKS: tuple[Check, ...] = tuple(_check(case) for case in (*FREE_FLIGHTS, *TRIMMED_FLIGHTS))
"""Cases 1 to 12."""
