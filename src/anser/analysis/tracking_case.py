"""Published test of path tracking: a climb of 1000 m with a turn of 60 degrees, flown by velocity commands alone."""

import tomllib
from importlib import resources
from typing import Any

from anser.aircraft_files.library import is_aircraft_path
from anser.aircraft_files.sources import VARIANTS
from anser.analysis.step_flights import StepCase, default_flight_point, step_case
from anser.analysis.step_tests import STEP_S
from anser.analysis.trim_points import Inversion, resolve_airframe
from anser.missions.runs import FlightResult, run
from anser.scenario.schema import Scenario, validate

CLIMB_AND_TURN = "climb-and-turn.toml"
"""Copy of the shipped scenario; a test keeps both equal."""
_CLIMB_SHARE = 0.4
"""Mean climb rate of the climb-and-turn, as a fraction of the aircraft's greatest.

The peak climb rate is 1.9 times the mean."""


def climb_and_turn(
    variant: str = "textbook",
    inversion: Inversion = "model",
    aircraft: str = "f16",
    start_point: tuple[float, float] | None = None,
) -> Scenario:
    """Return the scenario of the climb-and-turn (theory section 5).

    Other aircraft than the F-16 fly at their airspeed. Lengths and the allowed error scale with the distance flown in a
    time constant of the velocity loop, and the climb is within the aircraft's capability.

    Raises ScenarioError if aircraft, variant or inversion is unknown, and ConditionError if the aircraft has no level
    flight at the start.

    Parameters
    ----------
    aircraft
        Name of an airframe, or the path of an aircraft file.
    start_point
        Airspeed (m/s) and altitude (m) of the start for another aircraft than the F-16; None: `default_flight_point`.
    """
    text = resources.files("anser.analysis").joinpath(f"data/{CLIMB_AND_TURN}").read_text(encoding="utf-8")
    values = tomllib.loads(text)
    aircraft_table = values["aircraft"][0]
    aircraft_table["gains"] = {"inversion": inversion}
    if aircraft in VARIANTS:
        aircraft_table["variant"] = variant
    else:
        aircraft_table["airframe" if is_aircraft_path(aircraft) else "type"] = aircraft
        airframe = resolve_airframe(aircraft, variant)[0]
        speed_m_s, altitude_m = default_flight_point(airframe) if start_point is None else start_point
        _scale_case(values, step_case(airframe, speed_m_s, altitude_m, inversion), speed_m_s, altitude_m)
    return validate(values, CLIMB_AND_TURN)


def _scale_case(values: dict[str, Any], case: StepCase, speed_m_s: float, altitude_m: float) -> None:
    """Scale the lengths of the case to an aircraft's capability."""
    if case.derived_defaults is None:
        raise TypeError("an F-16 flies the case as published")
    aircraft_table, goal = values["aircraft"][0], values["goal"][0]
    time_scale = case.time_scale.velocity
    scale = speed_m_s / values["fleet"]["speed_m_s"] * time_scale
    stand_off_up = aircraft_table["rendezvous"]["stand_off_up_m"]
    climb = scale * (goal["altitude_m"] + stand_off_up - aircraft_table["start"]["altitude_m"])
    approach_time_s = scale * (goal["north_m"] ** 2 + goal["east_m"] ** 2) ** 0.5 / speed_m_s
    climb = min(climb, _CLIMB_SHARE * case.derived_defaults.capability.climb_rate_max * approach_time_s)
    values["timing"]["duration_s"] = round(round(values["timing"]["duration_s"] * time_scale / STEP_S) * STEP_S, 9)
    values["fleet"]["speed_m_s"] = speed_m_s
    aircraft_table["start"] |= {"speed_m_s": speed_m_s, "altitude_m": altitude_m}
    goal |= {"north_m": scale * goal["north_m"], "east_m": scale * goal["east_m"]}
    goal["altitude_m"] = altitude_m + climb - stand_off_up
    values["requirements"] = {key: scale * value for key, value in values["requirements"].items()}


def fly_climb_and_turn(variant: str = "textbook", inversion: Inversion = "model") -> FlightResult:
    """Fly the F-16's climb-and-turn; see `climb_and_turn`."""
    return run(climb_and_turn(variant, inversion))
