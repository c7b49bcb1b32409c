"""Refusing starts without steady flight."""

from typing import Any

import numpy as np

from anser.scenario import Problem, Scenario, ScenarioError
from anser.simulation import Flight, nearest_trims


def refuse_untrimmable(scenario: Scenario, flight: Flight, steady: Any) -> None:
    """Refuse starts without steady flight: say which limit stops it and where the nearest trim points are.

    Parameters
    ----------
    scenario, flight
        What is to be flown.
    steady
        Whether each aircraft of the flight has one, as `TrimmedFleet` says; those that only fill the fleet up too.
    """
    problems = []
    for k in np.flatnonzero(~np.asarray(steady)[: len(scenario.aircraft)]):
        vehicle, target, _ = flight.aircraft(int(k))
        found = nearest_trims(vehicle.airframe, flight.environment, target)
        aircraft, start = scenario.aircraft[k], scenario.aircraft[k].start
        asked = f"{start.speed_m_s:g} m/s at {start.altitude_m:g} m, path angle {start.path_angle_deg:g} deg"
        nearest = "; ".join(near.message() for near in found.nearest) or "none by speed, path angle or turn rate alone"
        problems.append(
            Problem(
                f"aircraft[{k}].start",
                f"{asked}, where no steady flight exists ({'; '.join(found.violations)})",
                f"a start with steady flight (all else unchanged: {nearest})",
                f'aircraft "{aircraft.name}"',
            )
        )
    if problems:
        raise ScenarioError(scenario.name, problems)
