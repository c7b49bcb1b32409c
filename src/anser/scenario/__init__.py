"""Scenarios: the schema of their files, loading with plain errors, building a flight. Input units end here."""

from anser.scenario.build import build_environment, build_flight, build_path_limits
from anser.scenario.cautions import cautions
from anser.scenario.errors import Problem, ScenarioError
from anser.scenario.library import AIRFRAMES, BODIES, VARIANTS, load_airframe, load_body
from anser.scenario.load import load, loads
from anser.scenario.schema import Scenario, scenario_hash, validate
from anser.scenario.template import starter_scenario, write_starter

__all__ = [
    "AIRFRAMES",
    "BODIES",
    "VARIANTS",
    "Problem",
    "Scenario",
    "ScenarioError",
    "build_environment",
    "build_flight",
    "build_path_limits",
    "cautions",
    "load",
    "load_airframe",
    "load_body",
    "loads",
    "scenario_hash",
    "starter_scenario",
    "validate",
    "write_starter",
]
