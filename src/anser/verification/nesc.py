"""NESC check-cases as checks against published checkpoints; cases without checkpoints list logged results."""

import functools
from typing import Any

from anser.verification.checks import NOT_JUDGED, Check, Comparison, half_of_significant, load_published
from anser.verification.nesc_cases import (
    FREE_FLIGHTS,
    LAW_FLIGHTS,
    TRIMMED_FLIGHTS,
    FreeFlight,
    LawFlight,
    LawName,
    TrimmedFlight,
    column_unit,
)
from anser.verification.nesc_flight import LOG_PERIOD_S, Log, fly_free, trimmed_logs
from anser.verification.nesc_laws import fly_laws

_Case = FreeFlight | TrimmedFlight | LawFlight

_SOURCE = "NASA/TM-2015-218675"
_DIGITS = 10
"""Significant digits of the checkpoints."""

_EXPLANATION = (
    "The reference is participants 04 and 05 of the published data, which agree best with one another; each "
    "tolerance comes from the scatter between the two, plus half a unit of the tenth digit, with which the figures are "
    "given: the inertial position, 2e7 ft, is known to 0.005 ft only."
)
_LAW_EXPLANATION = (
    "Flown in anser's closed loop by the law of {law}.dml, sampled at 800 Hz, from a trim as in case 11; surfaces and "
    "power follow within a sample. The law feeds back body rates relative to the rotating Earth. {feed_forward} "
)
_FEED_FORWARD = {
    "F16_control": "Its feed-forward of stick and throttle is solved so that it holds the start.",
    "F16_gnc": "Its feed-forward of stick and throttle is the trim.",
}
_LAW_REFERENCE = (
    "Each tolerance is four times the greatest difference of participants 04 and 05 at the judged times, plus half a "
    "unit of the tenth digit. Flown, not judged: {times}, where one participant's law already acts and the other's "
    "does not."
)
_LOGGED_ONLY = "Flown from the published definition, not judged: no figures for it come with this package. "
_SETTLED = (
    "Of the published flights, only the airspeed at which they settle comes with this package: these two figures are "
    "judged, all else is flown, not judged. The tolerance is four times the difference of the two and half the last "
    "digit. "
)
_SETTLED_TOLERANCE_KT = 4.0 * 0.06 + 0.005
_NOTES: dict[int | str, str] = {
    3: "The damping acts on the rates relative to the rotating air, as with participant 05; 04 takes the inertial "
    "rates, 0.0038 deg/s apart.",
    4: "Sphere of 6371007.1809 m at rest with inverse-square gravitation.",
    5: "Sphere of 6371007.1809 m rotating with 7.292115e-5 rad/s, inverse-square gravitation.",
    8: "East wind component -20 + 0.003 h ft/s.",
    11: "Trimmed with wings level and without sideslip, so that Coriolis and the turning of the meridians turn it "
    "slowly; controls and power held, no lags, no engine momentum. The scatter is that of the participants' trims.",
    12: "As case 11, with the subsonic tables held at their ends: the thrust is that of Mach 1.",
    "13.1": "Altitude command +100 ft at 5 s.",
    "13.2-5kt": "Airspeed command -5 KEAS at 5 s, as participants 04 and 05 flew it.",
    "13.2-10kt": "Airspeed command -10 KEAS at 5 s, as participant 02 flew it. Here it settles at 278.00 KEAS, with "
    "that participant, of whose start no figure comes with this package, at 277.02.",
    "13.3": "Course command +15 deg at 15 s. Sampled at 400 Hz instead of 800 Hz the judged figures move by less than "
    "0.35 of a tolerance.",
    "13.4": "Course line 2000 ft to the right from 20 s on. From then on, as with the participants, the deviation from "
    "it is the integral of the ground speed across it.",
    "15": "Anticlockwise around the North Pole at 3 nmi from 89.95 deg North.",
    "16": "Anticlockwise around the equator's crossing with the date line at 3 nmi.",
}


def _key(case: _Case) -> str:
    """Return the number of a case as in the check's key: 09, 13.1."""
    return f"{case.number:02d}" if isinstance(case.number, int) else case.number


def _check(case: _Case) -> Check:
    published = _checkpoints(case)
    return Check(
        key=f"nesc-{_key(case)}",
        title=f"NESC case {case.number}: {case.title}",
        source=f"{_SOURCE}, case {str(case.number).partition('-')[0]}",
        tolerance_reason=_tolerance_reason(case) if published is not None or _settled(case) else NOT_JUDGED,
        explanation="".join(_sentences(case, published)).strip(),
        measure=functools.partial(_measure, case),
        long=isinstance(case, LawFlight),
    )


def _settled(case: _Case) -> tuple[tuple[str, float], ...]:
    return case.settled_keas if isinstance(case, LawFlight) else ()


def _tolerance_reason(case: _Case) -> str:
    return "4 times the scatter of sims 04, 05" if isinstance(case, LawFlight) else "scatter of sims 04, 05"


def _sentences(case: _Case, published: dict[str, Any] | None) -> tuple[str, ...]:
    note = _NOTES.get(case.number, "")
    if not isinstance(case, LawFlight):
        return (_LOGGED_ONLY if published is None else f"{_EXPLANATION} ", note)
    law = _LAW_EXPLANATION.format(law=case.law, feed_forward=_FEED_FORWARD[case.law])
    if published is None:
        return (_SETTLED if case.settled_keas else _LOGGED_ONLY, law, note)
    times = " and ".join(f"{t:g} s" for t in published["not_judged_s"])
    return (law, _LAW_REFERENCE.format(times=times), " ", note)


def _checkpoints(case: _Case) -> dict[str, Any] | None:
    """Return the published checkpoints of a case, or None."""
    return load_published("nesc_checkpoints")["cases"].get(_key(case).replace(".", "p"))


@functools.cache
def _logs(case_class: type[_Case], law: LawName | None = None) -> dict[int | str, Log]:
    """Fly the cases of a class, or of a law, in one batch, compiled once."""
    if case_class is LawFlight:
        return {**fly_laws([case for case in LAW_FLIGHTS if case.law == law])}
    return {**(trimmed_logs() if case_class is TrimmedFlight else fly_free(FREE_FLIGHTS))}


def _measure(case: _Case) -> tuple[Comparison, ...]:
    """Compare a case with both participants at the judged checkpoints; without checkpoints, list the logged values."""
    log, published = _logs(type(case), getattr(case, "law", None))[case.number], _checkpoints(case)
    if published is None:
        logged = (_comparison(name, log, time_s) for name in log for time_s in case.times_s)
        return (
            *logged,
            *(_compare_settled(log, case.times_s[-1], *settled_airspeed) for settled_airspeed in _settled(case)),
        )
    not_judged = published.get("not_judged_s", ())
    return tuple(
        _comparison(name, log, time_s, simulation, column[simulation][k], column["tolerance"])
        if time_s not in not_judged
        else _comparison(name, log, time_s)
        for name, column in published["columns"].items()
        if "tolerance" in column
        for simulation in ("sim_04", "sim_05")
        for k, time_s in enumerate(published["times_s"])
        if time_s not in not_judged or simulation == "sim_04"
    )


def _comparison(
    name: str, log: Log, time_s: float, simulation: str = "", expected: float | None = None, tolerance: float = 0.0
) -> Comparison:
    """Compare a logged column at a time (s) with a participant's value, if any."""
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
    """Compare the equivalent airspeed at the end of the flight with a participant's."""
    obtained = float(log[_KEAS][round(time_s / LOG_PERIOD_S)])
    point = f"settled, {simulation}"
    return Comparison(f"{_KEAS}, settled", point, column_unit(_KEAS), expected, obtained, _SETTLED_TOLERANCE_KT)


_KEAS = "equivalentAirspeed_nmi_h"
_PERIODIC_COLUMNS = ("eulerAngle", "longitude")
"""Prefixes of the names of angle columns, which are compared up to whole turns."""
NESC_CHECKS: tuple[Check, ...] = tuple(_check(case) for case in (*FREE_FLIGHTS, *TRIMMED_FLIGHTS, *LAW_FLIGHTS))
"""Checks of the NESC cases 1 to 13, 15 and 16."""
