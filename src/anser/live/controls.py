"""Sliders, arrival rules and new tables (aircraft, goal, keep-out) that the page offers for a scenario."""

from typing import Any

from anser.scenario.build_aircraft import resolve_fleet
from anser.scenario.schema import Scenario
from anser.scenario.schema_settings import Limits

_SLIDERS = (
    # key, label, unit, least and greatest value, step
    ("wind.speed_m_s", "Wind speed", "m/s", 0.0, 40.0, 0.5),
    ("wind.from_deg", "Wind from", "deg", 0.0, 360.0, 5.0),
    ("fleet.speed_m_s", "Fleet airspeed", "m/s", 10.0, 300.0, 1.0),
    ("limits.bank_max_deg", "Greatest bank", "deg", 5.0, 80.0, 1.0),
    ("limits.speed_min_m_s", "Least airspeed", "m/s", 5.0, 250.0, 1.0),
    ("limits.speed_max_m_s", "Greatest airspeed", "m/s", 10.0, 340.0, 1.0),
    ("limits.climb_rate_max_m_s", "Greatest climb rate", "m/s", 1.0, 150.0, 1.0),
    ("limits.altitude_min_m", "Least altitude", "m", 0.0, 5000.0, 10.0),
    ("limits.altitude_max_m", "Greatest altitude", "m", 100.0, 15240.0, 20.0),
    ("separation.horizontal_m", "Separation", "m", 0.0, 3000.0, 10.0),
    ("separation.vertical_m", "Vertical separation", "m", 0.0, 1000.0, 10.0),
)
RULES = (
    {"value": "together", "label": "all together", "keys": []},
    {"value": "earliest", "label": "all as early as possible", "keys": []},
    {"value": "at", "label": "all at one time", "keys": ["arrival.time_s"]},
    {"value": "sequence", "label": "one after another", "keys": ["arrival.spacing_s", "arrival.order"]},
    {"value": "times", "label": "each at its own time", "keys": ["aircraft[].arrive_s"]},
    {
        "value": "windows",
        "label": "each within its window",
        "keys": ["aircraft[].arrive_from_s", "aircraft[].arrive_to_s"],
    },
)
"""Arrival rules with their labels and the keys that each needs; `aircraft[]` stands for every aircraft."""
GOAL_KINDS = ("surface", "airborne")


def sliders(scenario: Scenario) -> list[dict[str, Any]]:
    """Return the sliders of the page: key, label, unit, range, step, and the value in the scenario or its default.

    Sliders of limits show the limits of the first aircraft. A key without a value and a wind of layers have no slider.
    """
    tables = {
        "wind": scenario.wind,
        "fleet": scenario.fleet,
        "limits": resolve_fleet(scenario)[0].limits or Limits(),
        "separation": scenario.separation,
    }
    entries = []
    for key, label, unit, least, greatest, step in _SLIDERS:
        table, name = key.split(".")
        value = getattr(tables[table], name)
        # layers instead of one wind, or another form of the airspeed: the slider would contradict them
        if value is None or (table == "wind" and scenario.wind.layers is not None):
            continue
        value = float(value)
        entries.append(
            {
                "key": key,
                "label": label,
                "unit": unit,
                "min": min(least, value),
                "max": max(greatest, value),
                "step": step,
                "value": value,
            }
        )
    return entries


def new_tables(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Return the tables that the page adds for a new aircraft, goal or keep-out; the page sets names and positions."""
    first = scenario.aircraft[0]
    return {
        "aircraft": {
            "name": "aircraft",
            "goal": first.goal,
            "start": {
                "north_m": 0.0,
                "east_m": 0.0,
                "altitude_m": first.start.altitude_m,
                "speed_m_s": scenario.speed_for(first),
                "course_deg": 0.0,
            },
            "rendezvous": {"stand_off_up_m": 300.0},
        },
        "goal": {"name": "goal", "kind": "surface", "north_m": 0.0, "east_m": 0.0},
        "keep_out": {"name": "keep-out", "north_m": 0.0, "east_m": 0.0, "radius_m": 800.0},
    }
