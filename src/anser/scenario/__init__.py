"""Scenarios: the schema of their files, loading with plain errors, building a flight. Input units end here.

Reading and checking a scenario needs no JAX; what builds arrays is loaded on first use.
"""

import importlib
from typing import TYPE_CHECKING, Any

from anser.scenario.airframe_file import AirframeFile, read_airframe
from anser.scenario.airframe_names import AIRFRAMES, BODIES, VARIANTS
from anser.scenario.cautions import cautions
from anser.scenario.converting import convert
from anser.scenario.errors import Problem, ScenarioError
from anser.scenario.file_schema import json_schema
from anser.scenario.load import as_scenario, load, loads
from anser.scenario.replacing import value_at
from anser.scenario.schema import Scenario, scenario_hash, validate
from anser.scenario.template import starter_scenario, write_starter

if TYPE_CHECKING:
    from anser.scenario.airframe_file.build import build_airframe
    from anser.scenario.build import build_flight
    from anser.scenario.build_air import build_environment
    from anser.scenario.build_limits import build_path_limits
    from anser.scenario.library import load_airframe, load_body, load_f16

__all__ = [
    "AIRFRAMES",
    "BODIES",
    "VARIANTS",
    "AirframeFile",
    "Problem",
    "Scenario",
    "ScenarioError",
    "as_scenario",
    "build_airframe",
    "build_environment",
    "build_flight",
    "build_path_limits",
    "cautions",
    "convert",
    "json_schema",
    "load",
    "load_airframe",
    "load_body",
    "load_f16",
    "loads",
    "read_airframe",
    "scenario_hash",
    "starter_scenario",
    "validate",
    "value_at",
    "write_starter",
]

_WHERE = {
    "build_airframe": "anser.scenario.airframe_file.build",
    "build_environment": "anser.scenario.build_air",
    "build_flight": "anser.scenario.build",
    "build_path_limits": "anser.scenario.build_limits",
    "load_airframe": "anser.scenario.library",
    "load_body": "anser.scenario.library",
    "load_f16": "anser.scenario.library",
}


def __getattr__(name: str) -> Any:
    """Load what builds arrays on first use."""
    if name not in _WHERE:
        raise AttributeError(f"module 'anser.scenario' has no attribute {name!r}")
    return getattr(importlib.import_module(_WHERE[name]), name)
