"""Panels of a flight report have the limits that the aircraft flew with."""

import json

from anser.report.flight_data import page_sections


def _roll_rate(dataset):
    panels = [panel for section in page_sections(dataset) for panel in section["panels"]]
    (found,) = [panel for panel in panels if panel["response"] == "roll_rate_deg_s"]
    return found["limits"]


def test_the_roll_rate_has_its_command_limit_where_there_is_one(flight):
    dataset = flight[0].copy()
    fleet = dataset.sizes["aircraft"]
    dataset.attrs["limits"] = json.dumps([{"roll_rate_max_deg_s": 5.0}] * fleet)
    assert _roll_rate(dataset) == [-5.0, 5.0]
    dataset.attrs["limits"] = json.dumps([{"roll_rate_max_deg_s": None}] * fleet)
    assert _roll_rate(dataset) == []
