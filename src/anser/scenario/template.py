"""A scenario to start from, with every key, its default and its unit; beside it, the schema for editors."""

import os
from importlib.resources import files
from pathlib import Path

from anser.scenario.new_files import write_new, write_schema_beside
from anser.scenario.schema import Scenario

SCENARIO_SCHEMA = "anser-scenario.schema.json"
"""Name of the JSON Schema beside a scenario, as the first line of the starter has it."""


def starter_scenario() -> str:
    """Text (TOML) of the starter scenario: two aircraft, two drifting buoys, every key commented; a valid one."""
    return files("anser.scenario").joinpath("starter.toml").read_text(encoding="utf-8")


def write_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter scenario to a new file, and its schema for editors beside it; return the scenario's path.

    A schema that is there already is left alone.

    Raises
    ------
    ScenarioError
        If something of this name is there already (it is left alone), or the file cannot be written.
    """
    target = write_new(path, starter_scenario())
    write_schema_beside(target, SCENARIO_SCHEMA, Scenario, "anser scenario")
    return target
