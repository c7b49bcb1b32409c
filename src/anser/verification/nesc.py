"""Checks of the NESC check-cases against published simulation results at certain times ("checkpoints").

The references are the simulations 04 and 05 of the study. Cases without checkpoints are listed and not judged.
"""

import functools
import math
from typing import Any

from anser.units import FOOT_M
from anser.verification.checks import (
    NOT_JUDGED,
    Check,
    Comparison,
    half_of_significant,
    load_definitions,
    load_published,
)
from anser.verification.nesc_cases import (
    FREE_FLIGHTS,
    LAW_FLIGHTS,
    TRIMMED_FLIGHTS,
    FreeFlight,
    LawFlight,
    LawName,
    TrimmedFlight,
    TrimmedStart,
    column_unit,
)
from anser.verification.nesc_flight import LOG_PERIOD_S, Log, fly_free, fly_laws, trimmed_logs

_Case = FreeFlight | TrimmedFlight | LawFlight

_DIGITS = 10
"""Number of significant digits of the published checkpoints."""
_SIMULATIONS = ("sim_04", "sim_05")
_ZERO_SHARE = 1e-3
"""Greatest value of a quantity that counts as zero, relative to its tolerance; the published ones have at most 2e-7."""
_SETTLED_TOLERANCE_KT = 4.0 * 0.06 + 0.005


def _key(case: _Case) -> str:
    """Return the number of a case as in the check's key: 09, 13.1."""
    return f"{case.number:02d}" if isinstance(case.number, int) else case.number


def _check(case: _Case) -> Check:
    published, is_law = _checkpoints(case), isinstance(case, LawFlight)
    scatter = "4 times the scatter of sims 04, 05" if is_law else "scatter of sims 04, 05"
    return Check(
        key=f"nesc-{_key(case)}",
        title=f"NESC case {case.number}: {case.title}",
        source=f"NASA/TM-2015-218675, case {str(case.number).partition('-')[0]}",
        tolerance_reason=scatter if published is not None or _settled(case) else NOT_JUDGED,
        explanation=_explanation(case, published),
        measure=functools.partial(_measure, case),
        long=is_law,
    )


def _settled(case: _Case) -> tuple[tuple[str, float], ...]:
    return case.settled_keas if isinstance(case, LawFlight) else ()


def _explanation(case: _Case, published: dict[str, Any] | None) -> str:
    texts = load_definitions("nesc_cases")["texts"]
    sentences = [texts["logged_only" if published is None else "published"]]
    if isinstance(case, LawFlight):
        law = [texts["law"].format(law=case.law), texts[case.law]]
        if published is None:
            sentences = [texts["settled" if case.settled_keas else "logged_only"], *law]
        else:
            times = " and ".join(f"{t:g} s" for t in published["not_judged_s"])
            sentences = [*law, texts["law_reference"].format(times=times)]
    if published is not None:
        zero, within_scatter = _column_names(published)
        figures = len(zero) * len(_SIMULATIONS) * len(_judged_indices(published))
        sentences += [texts["zeros"].format(figures=figures)] if zero else []
        sentences += [texts["within_scatter"].format(columns=", ".join(within_scatter))] if within_scatter else []
    if isinstance(case, TrimmedStart):
        speed_ft_s = math.hypot(*case.velocity_ft_s)
        altitude_m, speed_m_s = FOOT_M * case.altitude_ft, FOOT_M * speed_ft_s
        values = {"altitude_ft": case.altitude_ft, "speed_ft_s": speed_ft_s}
        sentences.append(texts["start"].format(altitude_m=altitude_m, speed_m_s=speed_m_s, **values))
    return " ".join(" ".join([*sentences, case.note]).split())


def _checkpoints(case: _Case) -> dict[str, Any] | None:
    return load_published("nesc_checkpoints")["cases"].get(_key(case).replace(".", "p"))


@functools.cache
def _logs(case_class: type[_Case], law: LawName | None = None) -> dict[int | str, Log]:
    """Fly all cases of a class, or only those under the control law `law`, and return logs by case number; cached."""
    if case_class is LawFlight:
        return fly_laws([case for case in LAW_FLIGHTS if case.law == law])
    return trimmed_logs() if case_class is TrimmedFlight else fly_free(FREE_FLIGHTS)


def _measure(case: _Case) -> tuple[Comparison, ...]:
    """Compare a case with both reference simulations at the judged checkpoints.

    Checkpoints that are not judged, the second group of `_column_names`, and cases without checkpoints are listed
    without published values. If only settled airspeeds are published, the airspeeds at the flight's end are compared.
    """
    log, published = _logs(type(case), getattr(case, "law", None))[case.number], _checkpoints(case)
    if published is None:
        logged = (_comparison(name, log, time_s) for name in log for time_s in case.times_s)
        return (*logged, *(_compare_settled(log, case.times_s[-1], *airspeed) for airspeed in _settled(case)))
    judged, (_, within_scatter) = _judged_indices(published), _column_names(published)
    return tuple(
        _comparison(name, log, time_s, simulation, column[simulation][k], column["tolerance"])
        if simulation
        else _comparison(name, log, time_s)
        for name, column in _columns(published).items()
        for k, time_s in enumerate(published["times_s"])
        for simulation in (_SIMULATIONS if k in judged and name not in within_scatter else ("",))
    )


def _columns(published: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the published columns (quantities) that have a tolerance, by name."""
    return {name: column for name, column in published["columns"].items() if "tolerance" in column}


def _judged_indices(published: dict[str, Any]) -> list[int]:
    return [k for k, time_s in enumerate(published["times_s"]) if time_s not in published.get("not_judged_s", ())]


def _column_names(published: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Return the names of columns that are zero up to rounding, and of columns that are zero within the tolerance.

    The second group is not judged, because a computed zero would agree with each published value.
    """
    zero, within_scatter = [], []
    for name, column in _columns(published).items():
        values = [abs(column[simulation][k]) for simulation in _SIMULATIONS for k in _judged_indices(published)]
        if max(values) <= _ZERO_SHARE * column["tolerance"]:
            zero.append(name)
        elif max(values) <= column["tolerance"]:
            within_scatter.append(name)
    return zero, within_scatter


def _comparison(
    name: str, log: Log, time_s: float, simulation: str = "", expected: float | None = None, tolerance: float = 0.0
) -> Comparison:
    """Compare the value of a logged column at a time (s) with the published value `expected` of a simulation, if any.

    Angles are compared modulo 360 deg. Half a unit of the last significant digit of `expected` is added to `tolerance`.
    """
    obtained = float(log[name][round(time_s / LOG_PERIOD_S)])
    if expected is not None and name.startswith(_PERIODIC_COLUMNS):
        obtained += 360.0 * round((expected - obtained) / 360.0)
    half_digit = half_of_significant(expected, _DIGITS) if expected else 0.0
    return Comparison(
        group=name,
        point=f"t {time_s:g} s, {simulation}" if simulation else f"t {time_s:g} s",
        unit=column_unit(name),
        expected=expected,
        obtained=obtained,
        tolerance=None if expected is None else tolerance + half_digit,
        time_s=float(time_s),
        reference=simulation,
    )


def _compare_settled(log: Log, time_s: float, simulation: str, expected: float) -> Comparison:
    """Compare the equivalent airspeed, kt, at the flight's end, `time_s`, with a simulation's settled airspeed."""
    obtained = float(log[_KEAS][round(time_s / LOG_PERIOD_S)])
    point = f"settled, {simulation}"
    return Comparison(f"{_KEAS}, settled", point, column_unit(_KEAS), expected, obtained, _SETTLED_TOLERANCE_KT)


_KEAS = "equivalentAirspeed_nmi_h"
_PERIODIC_COLUMNS = ("eulerAngle", "longitude")
"""Prefixes of the names of angle columns, which are compared modulo 360 deg."""
NESC_CHECKS: tuple[Check, ...] = tuple(_check(case) for case in (*FREE_FLIGHTS, *TRIMMED_FLIGHTS, *LAW_FLIGHTS))
"""Checks of the NESC cases 1 to 13, 15 and 16."""
