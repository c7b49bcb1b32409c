"""The limits that each aircraft flies with, as a record carries them: the scenario's or its own, and its stops."""

import json

import numpy as np

from anser.scenario import Scenario
from anser.scenario.build import limits_of
from anser.simulation import Flight


def limits_text(scenario: Scenario, flight: Flight) -> str:
    """JSON: a list with one object for each aircraft of the scenario.

    Parameters
    ----------
    scenario
        As flown.
    flight
        What was built of it; its further aircraft, which only fill it up, are left out.

    Returns
    -------
    str
        Of each aircraft the keys of `[limits]` with the values that hold for it (null: none), and `surfaces_deg`: the
        lower and the upper stop of each control surface by its name, deg; surfaces without finite stops are left out.
    """
    stops: dict[int, dict[str, list[float]]] = {}
    for kind in flight.kinds:
        actuators = kind.vehicles.own.airframe.actuators  # what has one axis is always stacked
        ends = [np.degrees(np.asarray(end)) for end in (actuators.lower, actuators.upper)]
        for row, place in enumerate(kind.members):
            named = zip(actuators.names, *(end[row] for end in ends), strict=True)
            stops[place] = {
                name: [round(float(a), 6), round(float(b), 6)] for name, a, b in named if np.isfinite(a + b)
            }
    each = [
        limits_of(scenario, one).model_dump() | {"surfaces_deg": stops[place]}
        for place, one in enumerate(scenario.aircraft)
    ]
    return json.dumps(each)
