"""Limits in the panels of a flight report."""

import json

from anser.report.flight_data import page_sections


def _roll_rate_limits(dataset):
    panels = [panel for section in page_sections(dataset) for panel in section["panels"]]
    (roll_rate_panel,) = [panel for panel in panels if panel["response"] == "roll_rate_deg_s"]
    return roll_rate_panel["limits"]


def test_the_roll_rate_panel_has_the_command_limit_if_set(flight):
    dataset = flight[0].copy()
    fleet = dataset.sizes["aircraft"]
    dataset.attrs["limits"] = json.dumps([{"roll_rate_max_deg_s": 5.0}] * fleet)
    assert _roll_rate_limits(dataset) == [-5.0, 5.0]
    dataset.attrs["limits"] = json.dumps([{"roll_rate_max_deg_s": None}] * fleet)
    assert _roll_rate_limits(dataset) == []
