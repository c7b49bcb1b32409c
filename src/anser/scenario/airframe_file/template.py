"""An aircraft file to start from, with its keys, their defaults and units."""

import os
from importlib.resources import files
from pathlib import Path

from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.new_files import write_new, write_schema_beside

AIRCRAFT_SCHEMA = "anser-aircraft.schema.json"
"""Name of the JSON Schema beside an aircraft file, as the first line of the starter has it."""


def airframe_starter() -> str:
    """Text (TOML) of the starter: a light aircraft, every key commented; a valid one."""
    return files("anser.scenario.airframe_file").joinpath("starter.toml").read_text(encoding="utf-8")


def write_airframe_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter to a new file, and its schema beside it; as `anser.scenario.write_starter`."""
    target = write_new(path, airframe_starter())
    write_schema_beside(target, AIRCRAFT_SCHEMA, AirframeFile, "anser aircraft")
    return target
