"""Limits in a record: the control surface stops of each aircraft, and the scenario's limits."""

import json

from anser.missions.runs import limits_text
from support.made_scenario import made_scenario
from support.mixed_flight import NAMES, mixed_flight
from support.other_surfaces import ELEVONS


def test_each_aircraft_has_its_stops_and_its_effective_limits():
    scenario = made_scenario(NAMES, ("boat", "buoy"), limits={"bank_max_deg": 42.0})
    light, fighter = json.loads(limits_text(scenario, mixed_flight()))
    assert light["bank_max_deg"] == fighter["bank_max_deg"] == 42.0
    assert light["acceleration_max_m_s2"] is None
    assert set(light["surfaces_deg"]) == set(ELEVONS)
    assert fighter["surfaces_deg"] == {"elevator": [-25.0, 25.0], "aileron": [-21.5, 21.5], "rudder": [-30.0, 30.0]}
