"""Missions of adaptive aircraft: a fault in the summary, and an aircraft of which no aerodynamic coefficient is known."""

from pathlib import Path

import pytest

import anser
from anser.results.summary_format import format_summary

SCENARIO = Path(__file__).parents[2] / "scenarios" / "single-aircraft.toml"


def fly(adaptation="", event=""):
    """The shipped mission of one aircraft, with the adaptive inversion."""
    text = SCENARIO.read_text().replace("duration_s = 90.0", "duration_s = 40.0")
    aircraft, goal = text.split("[[goal]]")
    tables = f'\n[aircraft.gains]\ninversion = "adaptive"\n[aircraft.adaptation]\n{adaptation}\n'
    return anser.run(anser.loads(f"{aircraft}{tables}\n[[goal]]{goal}\n{event}"))


@pytest.mark.long
def test_the_summary_of_a_mission_names_half_an_elevator():
    """Found within 10 s of the event, with the size within 10 % of the truth; the aircraft still arrives."""
    flown = fly(
        event="""
        [[event]]
        time_s = 8.0
        kind = "aircraft-changes"
        aircraft = "aircraft-1"
        deviation = { surface_effectiveness = { elevator = 0.5 } }
        """
    )
    (entry,) = flown.summary["aircraft"]
    assert entry["status"] == "arrived"
    assert entry["fault"]["name"] == "elevator"
    assert entry["fault"]["unit"] == "of the effectiveness lost"
    assert 8.0 < entry["fault"]["time_s"] < 18.0
    assert abs(entry["fault"]["size"] - 0.5) < 0.05
    assert "fault: elevator" in format_summary(flown.summary)


@pytest.mark.long
def test_an_aircraft_of_known_geometry_alone_flies_the_mission():
    """All requirements are met, no fault is reported, and the load factor stays near 1 while the aircraft learns."""
    flown = fly("aerodynamics_known = false")
    assert flown.met
    (entry,) = flown.summary["aircraft"]
    assert entry["fault"] is None
    learning = flown.dataset.isel(aircraft=0).sel(time=slice(0.0, 6.0))
    assert float(abs(learning["load_factor"] - 1.0).max()) < 0.3
    assert float(abs(learning["bank_deg"]).max()) < 5.0
    assert flown.plot("adaptation").axes
