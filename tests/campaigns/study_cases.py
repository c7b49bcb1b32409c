"""A small study, and synthetic flights computed from scenarios, for tests without simulation."""

import hashlib
from pathlib import Path

import numpy as np

import anser
from anser.campaigns.study import validate_study
from anser.results.flight_rows import FlightRow
from anser.results.variable_labels import convert_series

STUDIES = Path(__file__).parents[2] / "studies"
THREE = anser.load(STUDIES.parent / "scenarios" / "three-aircraft.toml")
WIND = {"path": "wind.speed_m_s", "distribution": "uniform", "low": 0.0, "high": 9.0}


def study_of(**changes):
    values = {"format": 1, "name": "test", "scenario": "three.toml", "seed": 1, "sampling": {"flights": 4}}
    return validate_study({**values, "vary": [WIND], **changes}, "study.toml")


def text_of(scenario="three.toml", flights=4):
    return (
        f'format = 1\nname = "test"\nscenario = "{scenario}"\nseed = 1\n[sampling]\nflights = {flights}\n'
        '[[vary]]\npath = "wind.speed_m_s"\ndistribution = "uniform"\nlow = 0.0\nhigh = 9.0\n'
    )


def made_up(cases, progress=None, batch=None, series=None, precision="float64", outputs=None):
    """Synthetic rows as functions of the scenarios, including failed flights and a failed start."""
    return [_row(case, series, () if outputs is None else outputs.formulas) for case in cases]


def _row(case, selection, formulas):
    scenario = case.scenario
    seed = scenario.seed if case.seed is None else case.seed
    variate = int(hashlib.sha256(f"{seed} {scenario.wind.speed_m_s}".encode()).hexdigest(), 16) % 1000 / 100.0
    if variate < 1.0:
        return FlightRow.failed_start("made up: could not begin")
    aircraft = [
        {"name": config.name, "arrival_s": 60.0 + variate, "miss_m": variate + k, "status": "arrived"}
        for k, config in enumerate(scenario.aircraft)
    ]
    is_met = variate < 8.0
    fleet = {"arrival_spread_s": variate / 100.0, "separation_min_m": 500.0 - variate}
    series = {}
    if selection is not None:
        times, offsets = selection.times_s(scenario), np.arange(3.0)[:, None]
        series = {key: convert_series(key, 0.1 * variate + offsets + 0.01 * times) for key in selection.keys}
    outputs = {name: variate * (k + 1) for k, (name, _) in enumerate(formulas)}
    requirements = [{"name": "miss_max_m", "met": is_met}]
    return FlightRow(aircraft, fleet, requirements, is_met, series=series, outputs=outputs)
