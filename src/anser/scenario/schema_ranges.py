"""Limits and the ranges of aircraft: where a scenario gives no limit, the aircraft's own file does."""

import copy

from anser.scenario.airframe_range import AirframeRange
from anser.scenario.errors import Problem, plain
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_base import misordered
from anser.scenario.schema_settings import Limits

_KEYS = (
    ("speed_min_m_s", "speed_max_m_s", "airspeed_m_s", "m/s"),
    ("altitude_min_m", "altitude_max_m", "altitude_m", "m"),
    ("alpha_min_deg", "alpha_max_deg", "alpha_deg", "deg"),
)


def limits_for(limits: Limits, own: AirframeRange) -> Limits:
    """Limits of one aircraft: airspeeds and angles of attack that the scenario leaves out are those of its file.

    An aircraft without a file has the limits of the scenario.
    """
    if not own.by_file:
        return limits
    meant = copy.copy(limits)
    for low_key, high_key, name, _ in _KEYS:
        ends = getattr(own, name)
        if ends is None or name == "altitude_m":
            continue
        # as the planner that is meant: the file does not hold them, and what is written again must not either
        if low_key not in limits.model_fields_set:
            value = ends[0] if name == "airspeed_m_s" else max(ends[0], getattr(limits, low_key))
            object.__setattr__(meant, low_key, value)
        if high_key not in limits.model_fields_set:
            value = ends[1] if name == "airspeed_m_s" else min(ends[1], getattr(limits, high_key))
            object.__setattr__(meant, high_key, value)
    return meant


def order_problems(limits: Limits) -> list[Problem]:
    """Find limits of airspeed and angle of attack without a width."""
    found = [
        *misordered(limits, "speed_min_m_s", "speed_max_m_s", "m/s"),
        *misordered(limits, "alpha_min_deg", "alpha_max_deg", "deg"),
    ]
    return [Problem(f"limits.{one.path}", one.arrived, one.expected) for one in found]


def range_problems(aircraft: tuple[Aircraft, ...], limits: Limits) -> list[Problem]:
    """Find limits that let an aircraft fly where its data do not hold; altitudes beyond them are only marked."""
    found: dict[str, Problem] = {}
    for one in dict.fromkeys(each.range for each in aircraft):
        for problem in _beyond(one, limits_for(limits, one)):
            found.setdefault(problem.path, problem)
    return list(found.values())


def _beyond(own: AirframeRange, limits: Limits) -> list[Problem]:
    found = []
    for low_key, high_key, name, unit in _KEYS:
        ends = getattr(own, name)
        if ends is None or name == "altitude_m":
            continue
        for key, bad, words in (
            (low_key, getattr(limits, low_key) < ends[0], f"at least {plain(ends[0])} {unit}"),
            (high_key, getattr(limits, high_key) > ends[1], f"at most {plain(ends[1])} {unit}"),
        ):
            if bad:
                arrived = plain(getattr(limits, key))
                found.append(Problem(f"limits.{key}", arrived, f"{words}, where the data of {own.name} hold"))
    return found
