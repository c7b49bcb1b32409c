"""Messages of a refused trim about the validity ranges of an aircraft's data."""

import dataclasses
from types import SimpleNamespace
from typing import Any

from anser.analysis.trim_points import resolve_airframe
from anser.steady.trim_diagnosis import _beyond_validity
from support.light_aircraft import light_aircraft

AEROSONDE: Any = resolve_airframe("aerosonde", "textbook", None)[0]
SLOW_AND_HIGH: Any = SimpleNamespace(V=12.0, altitude=6000.0, mach=0.04)
WITHIN: Any = SimpleNamespace(V=20.0, altitude=500.0, mach=0.06)


def test_each_exceeded_validity_range_is_named():
    airspeed_message = "airspeed 12 m/s: outside the aircraft's data, which hold from 13 to 40 m/s"
    assert _beyond_validity(AEROSONDE, SLOW_AND_HIGH) == [airspeed_message]
    assert _beyond_validity(AEROSONDE, WITHIN) == []
    ranges = dataclasses.replace(AEROSONDE.validity, altitude=(0.0, 5000.0), mach=(0.1, 0.3))
    airframe = dataclasses.replace(AEROSONDE, validity=ranges)
    assert _beyond_validity(airframe, SLOW_AND_HIGH) == [
        airspeed_message,
        "altitude 6000 m: outside the aircraft's data, which hold from 0 to 5000 m",
        "Mach 0.04: outside the aircraft's data, which hold from 0.1 to 0.3",
    ]


def test_an_aircraft_without_ranges_names_none():
    assert _beyond_validity(light_aircraft(), SLOW_AND_HIGH) == []
