"""The published tracking case: a climb of 1000 m with a turn of 60 degrees, on velocity commands alone."""

import tomllib
from importlib import resources
from typing import Any

from anser.aircraft_files.library import is_aircraft_path
from anser.aircraft_files.sources import VARIANTS
from anser.analysis.step_flights import StepCase, default_flight_point, step_case
from anser.analysis.trim_points import Inversion, resolve_airframe
from anser.missions.runs import FlightResult, run
from anser.scenario.schema import Scenario, validate

CLIMB_AND_TURN = "climb-and-turn.toml"
"""The case: a copy of the shipped scenario, which a test holds equal to it."""
_CLIMB_PART = 0.4
"""Part of the greatest climb rate that the climb takes in the mean: its greatest is 1.9 times that."""


def climb_and_turn(
    variant: str = "textbook",
    inversion: Inversion = "model",
    aircraft: str = "f16",
    at: tuple[float, float] | None = None,
) -> Scenario:
    """Scenario of the climb-and-turn (theory section 5).

    Another aircraft than the F-16 flies it at its own airspeed, all lengths and the error allowed as much shorter as it
    goes in the time constants of its slow loop, and climbs no more than it can.

    Parameters
    ----------
    variant, inversion
        Of the F-16, and of the autopilot.
    aircraft
        Name of an airframe, or the path of an aircraft file.
    at
        Airspeed (m/s) and altitude (m) of the start, of another aircraft than the F-16; None: `default_flight_point`.

    Raises
    ------
    ScenarioError
        No such aircraft, variant or inversion.
    ConditionError
        It does not fly level there.
    """
    text = resources.files("anser.analysis").joinpath(f"data/{CLIMB_AND_TURN}").read_text(encoding="utf-8")
    values = tomllib.loads(text)
    one = values["aircraft"][0]
    one["gains"] = {"inversion": inversion}
    if aircraft in VARIANTS:
        one["variant"] = variant
    else:
        one["airframe" if is_aircraft_path(aircraft) else "type"] = aircraft
        airframe = resolve_airframe(aircraft, variant)[0]
        speed_m_s, altitude_m = default_flight_point(airframe) if at is None else at
        _suit(values, step_case(airframe, speed_m_s, altitude_m, inversion), speed_m_s, altitude_m)
    return validate(values, CLIMB_AND_TURN)


def _suit(values: dict[str, Any], case: StepCase, speed_m_s: float, altitude_m: float) -> None:
    """Shorten all lengths of the case to what an aircraft flies."""
    if case.derived_defaults is None:
        raise TypeError("an F-16 flies the case as published")
    one, goal = values["aircraft"][0], values["goal"][0]
    pace = case.pace.velocity
    scale = speed_m_s / values["fleet"]["speed_m_s"] * pace
    above = one["rendezvous"]["stand_off_up_m"]
    climb = scale * (goal["altitude_m"] + above - one["start"]["altitude_m"])
    time_s = scale * (goal["north_m"] ** 2 + goal["east_m"] ** 2) ** 0.5 / speed_m_s
    climb = min(climb, _CLIMB_PART * case.derived_defaults.capability.climb_rate_max * time_s)
    values["timing"]["duration_s"] *= pace
    values["fleet"]["speed_m_s"] = speed_m_s
    one["start"] |= {"speed_m_s": speed_m_s, "altitude_m": altitude_m}
    goal |= {"north_m": scale * goal["north_m"], "east_m": scale * goal["east_m"]}
    goal["altitude_m"] = altitude_m + climb - above
    values["requirements"] = {key: scale * value for key, value in values["requirements"].items()}


def fly_climb_and_turn(variant: str = "textbook", inversion: Inversion = "model") -> FlightResult:
    """Fly the F-16's climb-and-turn; see `climb_and_turn`."""
    return run(climb_and_turn(variant, inversion))
